"""Any allowed options, layout and motion: readings are finite, fillers read 0, and a step never raises."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import tactemu as tt
from tests.fuzz import examples

TOP = 0.01
SHAPES = [
    tt.Sphere(radius=0.012),
    tt.Box(size=(0.01, 0.02, 0.015)),
    tt.Capsule(radius=0.006, length=0.02),
    tt.Cylinder(radius=0.008, length=0.02),
]


def numbers(low: float, high: float):
    return st.floats(low, high, allow_nan=False, width=64)


def magnitudes(low: int, high: int):
    """0, or a power of ten between."""
    return st.one_of(st.just(0.0), st.floats(low, high).map(lambda e: 10.0**e))


layouts = st.one_of(
    st.tuples(st.integers(1, 6), st.integers(1, 6)),
    st.integers(0, 12).map(lambda n: (n,)),
)
poses = st.lists(
    st.tuples(
        st.tuples(numbers(-0.03, 0.03), numbers(-0.03, 0.03), numbers(0.0, 0.03)),
        st.tuples(*[numbers(-2, 2)] * 4).filter(lambda q: np.linalg.norm(q) > 1e-3),
    ),
    min_size=1,
    max_size=4,
)
elastomers = st.fixed_dictionaries(
    {
        "lambda_d": magnitudes(-3, 12),
        "lambda_s": magnitudes(-3, 12),
        "dilate_scale": st.sampled_from([0.0, 1.0, 1e3]),
        "shear_scale": st.sampled_from([0.0, 1.0, 1e3]),
        "normal_exponent": st.sampled_from([0.5, 1.0, 1.5, 2.0, 3.0]),
        "compressibility": numbers(0, 1),
        "elastomer_thickness": magnitudes(-9, 6),
        "contact_threshold": st.sampled_from([0.0, 1e-5, 1e-3]),
        "release_threshold": st.sampled_from([-1e-2, -1e-4, 0.0]),
        "n_sample_points": st.integers(1, 60),
        "area_weighted": st.booleans(),
    }
)
proximities = st.fixed_dictionaries(
    {
        "stiffness": magnitudes(-3, 6),
        "density_scalar": magnitudes(-3, 6),
        "shear_coupling": magnitudes(-3, 3),
        "twist_scalar": magnitudes(-3, 3),
        "n_sample_points": st.integers(1, 60),
        "convention": st.sampled_from([None, "skin", "genesis"]),
    }
)


@st.composite
def skins(draw, models):
    """A layout with jitter, bends, turned normals and fillers, and a model's options."""
    layout = draw(layouts)
    n = int(np.prod(layout))
    rng = np.random.default_rng(draw(st.integers(0, 2**31)))
    pitch = 10.0 ** draw(st.floats(-4, -2))
    i, j = np.indices(layout if len(layout) == 2 else (1, n))
    positions = np.stack([j * pitch, i * pitch * draw(numbers(0.5, 2.0)), np.full(i.shape, TOP)], -1)
    positions = positions + draw(st.sampled_from([0.0, 0.0, 1e-7, 1e-3])) * rng.normal(size=positions.shape)
    normals = np.array([0, 0, 1.0]) + draw(st.sampled_from([0.0, 0.0, 0.5])) * rng.normal(size=(n, 3))
    radius = np.where(rng.random(n) < draw(st.sampled_from([0.0, 0.3, 1.0])), 0.0, draw(st.sampled_from([1e-3, 2e-2])))
    options = draw(models)
    options["positions"] = positions.reshape(*layout, 3)
    options["normals"] = normals if n else (0, 0, 1.0)
    options["radius"] = radius if n else 1e-3
    return options


def play(model, shape, where, dtype):
    scene = tt.Scene(dt=1e-3)
    pad = scene.add_body(tt.Box(size=(0.06, 0.06, 2 * TOP)))
    body = scene.add_body(shape)
    skin = scene.add_sensor(model, link=pad)
    sim = scene.build(n_envs=2, dtype=dtype)
    for position, quaternion in where:
        sim.set_pose(body, position=position, quaternion=quaternion, angular_velocity=(1.0, -2.0, 3.0))
        sim.step()
    readings = skin.read()
    sim.reset(envs=[0])
    return readings if isinstance(readings, tuple) else (readings,)


dtypes = st.sampled_from(["float32", "float64"])


def check(readings, options):
    layout = options["positions"].shape[:-1]
    filler = np.broadcast_to(np.asarray(options["radius"]) == 0, int(np.prod(layout)))
    for reading in readings:
        assert reading.shape == (2, *layout, 3)
        assert np.isfinite(reading).all()
        assert np.array_equal(reading[0], reading[1])
        assert not reading.reshape(2, -1, 3)[:, filler].any()


@examples(25)
@given(skins(elastomers), st.sampled_from(SHAPES), poses, dtypes)
def test_elastomer(options, shape, where, dtype):
    check(play(tt.ElastomerTaxel(**options), shape, where, dtype), options)


@examples(25)
@given(skins(proximities), st.sampled_from(SHAPES), poses, dtypes)
def test_proximity(options, shape, where, dtype):
    check(play(tt.ProximityTaxel(**options), shape, where, dtype), options)
