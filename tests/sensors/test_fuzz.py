"""Whatever is asked of the public interface, it answers with numbers that make sense or with an error of ours."""

import itertools

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import tactemu as tt
from tactemu.base.errors import PoseError, SceneError
from tests.fuzz import examples

length = st.floats(1e-4, 1.0)
coordinate = st.floats(-2.0, 2.0)
vector = st.tuples(coordinate, coordinate, coordinate)
direction = vector.filter(lambda v: np.linalg.norm(v) > 0.1)
quaternion = st.tuples(*[coordinate] * 4).filter(lambda q: np.linalg.norm(q) > 0.1)
anything = st.floats(allow_nan=True, allow_infinity=True, width=64)
SHAPES = ("sphere", "box", "capsule", "cylinder", "plane")


def unit(q):
    return np.asarray(q, float) / np.linalg.norm(q)


def rotate(q, v):
    v = np.asarray(v, float)
    u = np.broadcast_to(q[1:], v.shape)
    t = 2 * np.cross(u, v)
    return v + q[0] * t + np.cross(u, t)


def multiply(a, b):
    w = a[0] * b[0] - a[1:] @ b[1:]
    return np.array([w, *(a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:]))])


@st.composite
def shapes(draw):
    """One of each kind: always the same kernels."""
    return (
        tt.Sphere(radius=draw(length)),
        tt.Box(size=(draw(length), draw(length), draw(length))),
        tt.Capsule(radius=draw(length), length=draw(length)),
        tt.Cylinder(radius=draw(length), length=draw(length)),
        tt.Plane(),
    )


@st.composite
def poses(draw):
    return [(np.array(draw(vector)), unit(draw(quaternion))) for _ in SHAPES]


@st.composite
def probes(draw):
    n = draw(st.integers(1, 6))
    return {
        "positions": [draw(vector) for _ in range(n)],
        "normals": [draw(direction) for _ in range(n)],
        "radius": draw(st.lists(st.one_of(st.just(0.0), length), min_size=n, max_size=n)),
    }


HERE = (np.zeros(3), np.array([1.0, 0, 0, 0]))


def read(model, bodies, placed, *, link=HERE, order=range(5), dtype="float64"):
    scene = tt.Scene()
    frame = scene.add_body(position=link[0], quaternion=link[1])
    for k in order:
        scene.add_body(bodies[k], position=placed[k][0], quaternion=placed[k][1])
    skin = scene.add_sensor(model, link=frame)
    scene.build(dtype=dtype).step()
    return skin.read()


NUDGES = 1e-6 * np.array([(1, 1, 1), (-1, -1, -1), (1, -1, 1), (-1, 1, -1), (1, 1, -1)])
ALONG_A_FACE = (
    (tt.Sphere(radius=1.0), tt.Box(size=(1, 1, 1)), tt.Capsule(radius=1.0, length=1.0),
     tt.Cylinder(radius=1.0, length=1.0), tt.Plane()),
    [(np.zeros(3), np.array([0, 0, 0, 1.0]))] * 4 + [(np.zeros(3), np.array([4.46521068e-240, 0, 1, 0]))],
    {"positions": [(0.0, 0.0, 0.0)], "normals": [(-1.0, 0.0, 0.0)], "radius": [1.0]},
    (0.0, 0.0, 0.0),
    (0.0, 1.0, 0.0, 1.0),
)  # fmt: skip


ON_THE_SURFACE = (
    *ALONG_A_FACE[:1],
    [(np.zeros(3), np.array([0, 0, 0, 1.0]))] * 4 + [(np.array([1.0, 0, 0]), np.array([0, 0, 1.0, 0]))],
    {"positions": [(0.0, 0.0, 0.0)], "normals": [(0.0, 0.0, -1.0)], "radius": [1.0]},
    (0.0, 0.0, 0.0),
    (1.0, 0.0, 1.0, 0.0),
)


@examples(20)
@given(shapes(), poses(), probes(), vector, quaternion)
@example(*ALONG_A_FACE)
@example(*ON_THE_SURFACE)
def test_a_scene_moved_as_a_whole_reads_the_same(bodies, placed, options, shift, turn):
    shift, turn = np.array(shift) * 1000.0, unit(turn)
    moved = [(rotate(turn, at) + shift, multiply(turn, q)) for at, q in placed]
    here = read(tt.ContactDepthProbe(**options), bodies, placed)
    assert np.abs(here - read(tt.ContactDepthProbe(**options), bodies, moved, link=(shift, turn))).max() <= 1e-9
    along = tt.ContactDepthProbe(**options, depth_query="ray", ray_reach=5.0)
    here = read(along, bodies, placed)
    grazing = np.zeros(here.shape, bool)  # lines along a face or just at an edge, probes just on a surface
    for tilt, push in itertools.product(NUDGES, NUDGES):
        normals = np.array(options["normals"]) + np.array(tilt)
        moved_by = np.array(options["positions"]) + np.array(push)
        tilted = {**options, "normals": normals, "positions": moved_by}
        tilted = read(tt.ContactDepthProbe(**tilted, depth_query="ray", ray_reach=5.0), bodies, placed)
        grazing |= np.abs(here - tilted) > 1e-3
    assert np.abs(here - read(along, bodies, moved, link=(shift, turn)))[~grazing].max(initial=0) < 1e-3


@examples(20)
@given(shapes(), poses(), probes(), st.permutations(range(5)))
def test_the_order_of_bodies_changes_no_depth(bodies, placed, options, order):
    model = tt.ContactDepthProbe(**options)
    assert np.array_equal(read(model, bodies, placed), read(model, bodies, placed, order=order))


@examples(20)
@given(shapes(), poses(), probes())
def test_float32_is_float64_rounded(bodies, placed, options):
    model = tt.ContactDepthProbe(**options)
    exact, rounded = read(model, bodies, placed), read(model, bodies, placed, dtype="float32")
    assert rounded.dtype == np.float32 and np.abs(exact - rounded).max() < 1e-5


@examples(20)
@given(shapes(), poses(), probes())
def test_along_the_normal_is_at_least_as_deep_where_it_is_in_touch(bodies, placed, options):
    radius = np.asarray(options["radius"])
    nearest = read(tt.ContactDepthProbe(**options), bodies, placed)
    along = read(tt.ContactDepthProbe(**options, depth_query="ray"), bodies, placed)
    inside = nearest > radius + 1e-9
    assert (along[inside] >= nearest[inside] - 1e-6).all()
    assert (along[radius == 0] == 0).all() and (along >= 0).all() and np.isfinite(along).all()


number = st.one_of(coordinate, anything)


@examples(20)
@given(
    st.lists(
        st.tuples(
            st.integers(0, 5),  # body
            st.tuples(number, number, number),
            st.tuples(number, number, number, number),
            st.tuples(number, number, number),
            st.sampled_from(["pose", "reset", "step", "still"]),
            st.sets(st.integers(0, 2)),
        ),
        min_size=1,
        max_size=8,
    ),
    st.sampled_from(["float32", "float64"]),
)
@example([(1, (0.0, 0.0, float("nan")), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), "pose", {1})], "float32")
@example([(0, (0.0, 0.0, 1e39), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), "pose", {0, 2})], "float32")
@example([(2, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), "pose", {0, 2})], "float64")
@example([(1, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (1e200, 0.0, 0.0), "pose", {0})], "float64")
def test_readings_are_numbers_or_the_step_says_whose_pose_is_not(calls, dtype):
    scene = tt.Scene()
    link = scene.add_body()
    for shape in (
        tt.Sphere(radius=0.5),
        tt.Box(size=(1, 1, 1)),
        tt.Capsule(radius=0.3, length=1),
        tt.Cylinder(radius=0.3, length=1),
        tt.Plane(),
    ):
        scene.add_body(shape)
    at = np.random.default_rng(0).uniform(-1, 1, (7, 3))
    depth = scene.add_sensor(tt.ContactDepthProbe(positions=at, radius=0.2), link=link)
    ray = scene.add_sensor(tt.ContactDepthProbe(positions=at, radius=0.2, depth_query="ray"), link=link)
    springs = scene.add_sensor(tt.KinematicTaxel(positions=at, radius=0.2, normal_exponent=1.5), link=link)
    touch = scene.add_sensor(tt.ContactProbe(positions=at, radius=0.2), link=link)
    sim = scene.build(3, dtype=dtype)
    for body, position, turn, velocity, action, envs in calls:
        if action == "pose":
            sim.set_pose(
                body, position=position, quaternion=turn, linear_velocity=velocity, angular_velocity=velocity,
                envs=sorted(envs),
            )  # fmt: skip
        elif action == "reset":
            sim.reset(sorted(envs))
        bad = False
        try:
            sim.step(dt=0.0 if action == "still" else None)
        except PoseError as error:
            assert "environment" in str(error) and f"step {sim.step_count}" in str(error)
            bad = True
        values = [depth.read(), ray.read(), *springs.read()]
        world = sim._world.download()
        fine = np.isfinite(world).all((1, 2)) & (np.abs(world) < 1e12).all((1, 2))
        fine &= (np.linalg.norm(world[..., 3:7], axis=-1) >= 1e-6).all(1)
        assert not (bad and fine.all())
        for value in values:
            assert np.isfinite(value[fine]).all()
        for value in values[:2]:
            assert not (value < 0).any()
        assert touch.read().dtype == bool


OPTIONS = (
    "radius", "normal_exponent", "normal_stiffness", "shear_scalar", "voxel_size", "ray_reach", "position",
    "quaternion", "normals",
)  # fmt: skip


@examples(20)
@given(
    st.dictionaries(st.sampled_from(OPTIONS), st.one_of(anything, st.tuples(anything, anything, anything)), max_size=3)
)
@example({"radius": 14.0, "normal_exponent": 266.0})  # overflows, and must not read as 'no contact'
@example({"voxel_size": (0.0, 0.0, 0.0)})
@example({"normal_stiffness": (0.0, 0.0, 0.0)})
@example({"normals": (0.0, 0.0, 1e-320)})
def test_options_work_or_are_refused(options):
    scene = tt.Scene()
    link = scene.add_body()
    scene.add_body(tt.Sphere(radius=0.5))
    try:
        skin = scene.add_sensor(tt.KinematicTaxel(positions=[[0, 0, 0.4]], **options), link=link)
        scene.build(dtype="float64").step()
    except (SceneError, OverflowError) as error:
        assert str(error)
        return
    sane = all(np.all(np.abs(np.asarray(value, float)) < 1e30) for value in options.values())
    force = skin.read().force
    if sane and options.get("normal_exponent", 1.0) < 8:
        assert np.isfinite(force).all()
    elif not np.isfinite(force).all():
        assert not (np.nan_to_num(force, nan=1.0) == 0).all()


@pytest.mark.parametrize("wrong", ["radius", None, [[1.0], [2.0, 3.0]]])
def test_options_of_the_wrong_type_are_refused(wrong):
    scene = tt.Scene()
    link = scene.add_body()
    with pytest.raises((SceneError, TypeError, ValueError)):
        scene.add_sensor(tt.ContactDepthProbe(radius=wrong), link=link)
        scene.build()
