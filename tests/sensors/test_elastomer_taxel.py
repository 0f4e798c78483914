"""ElastomerTaxel at the extremes, and independent of pitch and sample count where it is asked to be."""

import numpy as np
import pytest
import warp as wp

import tactemu as tt
from tactemu.base.errors import PoseError, SceneError
from tactemu.plan.launches import record
from tactemu.sensors.probes.taxel_depth import box_kernel

TOP = 0.01


def grid(rows, cols, du=2e-3, dv=None, at=(0.0, 0.0)):
    """Taxels on top of the pad, ``(rows, cols, 3)``."""
    dv = dv or du
    x, y = np.meshgrid((np.arange(cols) - (cols - 1) / 2) * du + at[0], (np.arange(rows) - (rows - 1) / 2) * dv + at[1])
    return np.stack([x, y, np.full_like(x, TOP)], -1)


def build(dtype="float64", *, n_envs=None, shape=None, size=1.0, **options):
    """A ball (or another shape) over a pad with one ElastomerTaxel; lengths times ``size``."""
    scene = tt.Scene(dt=1e-3)
    pad = scene.add_body(tt.Box(size=(0.08 * size, 0.08 * size, 0.02 * size)))
    ball = scene.add_body(shape or tt.Sphere(radius=0.015 * size), name="ball")
    skin = scene.add_sensor(tt.ElastomerTaxel(**{"shear_scale": 0.0, "lambda_d": 2e4, **options}), link=pad)
    return scene.build(n_envs=n_envs, dtype=dtype), skin, ball


def press(positions, *, depth=1.5e-3, slide=0.0, dtype="float64", **options):
    """Reading after pressing a ball and sliding it along x."""
    sim, skin, ball = build(dtype, positions=positions, **options)
    for x in np.linspace(0.0, slide, 5) if slide else [0.0]:
        sim.set_pose(ball, position=(x, 0.0, TOP + 0.015 - depth))
        sim.step()
    return skin.read()


def expected(positions, lambda_d, depth=1.5e-3):
    """The Gaussian sums, one by one."""
    p = positions.reshape(-1, 3)
    h = np.maximum(0.015 - np.linalg.norm(p - [0, 0, TOP + 0.015 - depth], axis=1), 0)
    o = p[:, None] - p[None]
    g = np.exp(-lambda_d * (o**2).sum(-1))
    u = (o * (g * h)[..., None]).sum(1)
    u[:, 2] = (g * h**2).sum(1)
    return u.reshape(positions.shape)


@pytest.mark.parametrize("lambda_d", [0.0, 700.0, 2e4, 1e9])
@pytest.mark.parametrize("shape", [(1, 9), (9, 1), (2, 2), (7, 12), (16, 16)])
def test_gaussian_dilation_is_the_sum_over_taxels(lambda_d, shape):
    """Also the limits: lambda 0 sums all depths alike, a huge lambda leaves each taxel its own."""
    positions = grid(*shape, du=1.5e-3, dv=2.5e-3)
    assert press(positions, lambda_d=lambda_d) == pytest.approx(expected(positions, lambda_d), rel=1e-9, abs=1e-16)


@pytest.mark.parametrize(
    "options",
    [{"compressibility": 0.0}, {"compressibility": 0.4, "elastomer_thickness": 3e-3, "area_weighted": True}],
)
def test_swapping_the_axes_is_the_transpose(options):
    positions = grid(6, 11, du=1.5e-3, dv=2.5e-3)
    transposed = np.ascontiguousarray(positions.transpose(1, 0, 2))
    u = press(positions, **options)
    assert press(transposed, **options).transpose(1, 0, 2) == pytest.approx(u, abs=1e-9 * np.abs(u).max())


@pytest.mark.parametrize("slide", [0.0, 2e-3])
def test_fillers_read_zero_and_take_part_in_nothing(slide):
    positions = grid(6, 6).reshape(-1, 3)
    radius = np.where(np.arange(36) % 5 == 0, 0.0, 1e-3)
    shear = {"shear_scale": 1.0 if slide else 0.0, "slide": slide}
    some = press(positions, radius=radius, **shear)
    rest = press(positions[radius > 0], radius=1e-3, **shear)
    assert not some[radius == 0].any() and rest.any()
    assert np.array_equal(some[radius > 0], rest)
    as_grid = press(positions.reshape(6, 6, 3), radius=radius, **shear).reshape(-1, 3)
    assert not as_grid[radius == 0].any() and as_grid == pytest.approx(some, rel=1e-12)


@pytest.mark.parametrize("n", [0, 1])
def test_no_taxels_and_one(n):
    positions = np.array([[0.0, 0.0, TOP]])[:n]
    u = press(positions, slide=1e-3, shear_scale=1.0)
    assert u.shape == (n, 3)
    if n:
        assert u[0, 2] > 0 and np.isfinite(u).all()


def test_a_million_taxels():
    positions = grid(1000, 1000, du=5e-5)
    sim, skin, ball = build("float32", positions=positions, lambda_d=2e5, compressibility=0.0)
    sim.set_pose(ball, position=(0, 0, TOP + 0.015 - 2e-6))
    sim.step()
    u = skin.read()
    p = positions.reshape(-1, 3)
    h = np.maximum(0.015 - np.linalg.norm(p - [0, 0, TOP + 0.015 - 2e-6], axis=1), 0)
    pressed, some = np.flatnonzero(h), np.arange(0, len(p), 91_003)
    o = (p[some, None] - p[None, pressed])[..., :2]
    by_hand = (o * (h[pressed] / ((o**2).sum(-1) + 5e-5**2))[..., None]).sum(1)
    assert u.reshape(-1, 3)[some, :2] == pytest.approx(by_hand, abs=2e-5 * float(np.abs(u[..., :2]).max()))


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("area_weighted", [False, True])
def test_thickness_has_no_jumps(dtype, area_weighted):
    """From a film of a nanometre to an unbounded body, and finite everywhere."""
    positions = grid(8, 8)
    for thickness in np.logspace(-9, 6, 6):
        options = {"compressibility": 0.0, "area_weighted": area_weighted, "dtype": dtype, "lambda_d": 1e7}
        u = press(positions, elastomer_thickness=thickness, **options)[..., :2]
        v = press(positions, elastomer_thickness=thickness * 1.001, **options)[..., :2]
        assert np.isfinite(u).all()
        assert np.abs(u - v).max() <= 1e-2 * np.abs(u).max()


@pytest.mark.parametrize("size", [1e-9, 1e-3, 1e3])
@pytest.mark.parametrize("options", [{}, {"compressibility": 0.3, "elastomer_thickness": 2e-3}])
def test_a_scaled_scene_reads_the_same_scaled(size, options):
    """In float32; the shear (depth times way) scales with the square, the blend (depth) with the length."""
    exponent = 1 if options else 2
    readings = []
    for s in (1.0, size):
        scaled = {name: value * (s if name == "elastomer_thickness" else 1) for name, value in options.items()}
        rates = {"lambda_d": 2e4 / s**2, "lambda_s": 8e3 / s**2, "normal_exponent": float(exponent)}
        thresholds = {"contact_threshold": 1e-5 * s, "release_threshold": -1e-4 * s}
        sim, skin, ball = build(
            "float32", size=s, positions=grid(8, 8) * s, shear_scale=s ** (exponent - 2), n_sample_points=200,
            **scaled, **rates, **thresholds,
        )  # fmt: skip
        for x in (0.0, 1e-3, 2e-3):
            sim.set_pose(ball, position=(x * s, 0, (TOP + 0.0135) * s))
            sim.step()
        readings.append(skin.read().astype(float) / s**exponent)
    assert readings[1] == pytest.approx(readings[0], abs=2e-5 * np.abs(readings[0]).max())


def test_far_from_the_origin():
    """A skin at 100 km feels as at home: 1e-8 m in depth."""
    readings = []
    for origin in (np.zeros(3), np.array([1e5, -7e4, 3e4])):
        sim, skin, ball = build("float32", positions=grid(8, 8), shear_scale=1.0)
        for x in (0.0, 1e-3):
            sim.set_pose(0, position=origin)
            sim.set_pose(ball, position=origin + np.array([x, 0, TOP + 0.0135]))
            sim.step()
        readings.append(skin.read())
    assert readings[1] == pytest.approx(readings[0], abs=1e-4 * float(np.abs(readings[0]).max()))


def test_a_pose_that_is_not_finite():
    """The environment reads NaN and is named; the others are the same to the bit."""
    positions = grid(8, 8)
    readings = {}
    for bad in (False, True):
        sim, skin, ball = build("float32", n_envs=3, positions=positions, shear_scale=1.0)
        for x in (0.0, 1e-3):
            sim.set_pose(ball, position=(x, 0, TOP + 0.0135))
            if bad and x:
                sim.set_pose(ball, position=(np.nan, 0, TOP), envs=[1])
                with pytest.raises(PoseError, match=r"ball.*environment 1, step 2"):
                    sim.step()
            else:
                sim.step()
        readings[bad] = skin.read()
    assert np.isnan(readings[True][1]).any(axis=-1).all()
    assert np.array_equal(readings[True][[0, 2]], readings[False][[0, 2]])


def test_an_environment_reads_the_same_alone_and_in_a_batch():
    positions = grid(8, 8)
    places = [(0.0, 0.0), (3e-3, 1e-3), (0.03, 0.03), (1.0, 0.0)]
    together, skin_together, ball = build("float32", n_envs=4, positions=positions, shear_scale=1.0)
    alone = [build("float32", positions=positions, shear_scale=1.0) for _ in places]
    for slide in (0.0, 1e-3):
        where = np.array([(x + slide, y, TOP + 0.0135) for x, y in places])
        together.set_pose(ball, position=where)
        together.step()
        for (sim, _, one), place in zip(alone, where):
            sim.set_pose(one, position=place)
            sim.step()
    for env, (_, skin, _) in enumerate(alone):
        assert np.array_equal(skin_together.read()[env], skin.read())
    assert not skin_together.read()[3].any()


def test_reset_lets_go_only_in_the_environments_named():
    sim, skin, ball = build("float64", n_envs=2, positions=grid(6, 6), shear_scale=1.0, dilate_scale=0.0)
    for x in (0.0, 1e-3):
        sim.set_pose(ball, position=(x, 0, TOP + 0.0135))
        sim.step()
    before = skin.read()
    assert before[0].any()
    sim.reset(envs=[1])
    sim.set_pose(ball, position=(1e-3, 0, TOP + 0.0135))
    sim.step()
    assert np.array_equal(skin.read()[0], before[0]) and not skin.read()[1].any()


def test_points_latch_beyond_the_threshold_not_at_it():
    """Strictly deeper than the threshold latches; one float less does not."""
    for depth, latches in ((1e-5, False), (np.nextafter(1e-5, 1), True)):
        scene = tt.Scene()
        pad = scene.add_body(tt.Plane())
        tip = scene.add_body(tt.Sphere(radius=1e-3))
        model = tt.ElastomerTaxel(positions=[(0, 0, 0)], dilate_scale=0.0, points=[(0, 0, 0)], contact_threshold=1e-5)
        skin = scene.add_sensor(model, link=pad)
        sim = scene.build(dtype="float64")
        for x in (0.0, 1e-4):
            sim.set_pose(tip, position=(x, 0, -depth))
            sim.step()
        assert skin.read().any() == latches


def test_grid_and_direct_sums_agree_on_the_same_taxels():
    """Gaussian and global weights, shear; a flat list of the grid's taxels is summed one by one."""
    positions = grid(7, 9)
    for options in ({}, {"compressibility": 0.0}, {"compressibility": 0.5}):
        shared = {"slide": 1e-3, "shear_scale": 1.0, **options}
        u = press(positions, **shared)
        flat = press(positions.reshape(-1, 3), **shared).reshape(u.shape)
        if not options:
            assert flat == pytest.approx(u, abs=1e-12 * np.abs(u).max())
        assert flat[..., 2] == pytest.approx(u[..., 2], rel=1e-9)


@pytest.mark.parametrize(
    "options",
    [
        {"compressibility": 1.0, "lambda_d": 2e5},
        {"compressibility": 0.0, "elastomer_thickness": 4e-3, "lambda_d": 2e5},
        {"compressibility": 0.5, "elastomer_thickness": 4e-3, "lambda_d": 2e5},
    ],
)
@pytest.mark.parametrize("free", [False, True])
def test_halving_the_pitch_changes_nothing_when_areas_weigh(options, free):
    """On the taxels that both layouts share; without weights the reading would grow fourfold."""
    coarse, fine = grid(13, 13, du=1.5e-3), grid(25, 25, du=0.75e-3)
    arrange = (lambda p: p.reshape(-1, 3)) if free else (lambda p: p)
    u = press(arrange(coarse), area_weighted=True, **options).reshape(13, 13, 3)
    v = press(arrange(fine), area_weighted=True, **options).reshape(25, 25, 3)[::2, ::2]
    for part in (slice(0, 2), slice(2, 3)):
        assert v[..., part] == pytest.approx(u[..., part], abs=0.03 * np.abs(v[..., part]).max())
    unweighted = [np.abs(press(p, **options | {"compressibility": 1.0})).max() for p in (coarse, fine)]
    assert unweighted[1] > 3.5 * unweighted[0]


def test_grid_and_free_layouts_agree_on_a_layer_when_areas_weigh():
    """Genesis's two paths differ a thousandfold on a layer of known thickness; see docs/differences.md."""
    positions = grid(13, 13, du=1.5e-3)
    options = {"compressibility": 0.0, "elastomer_thickness": 4e-3}
    area = 1.5e-3**2
    u = press(positions, area_weighted=True, **options)[..., :2]
    v = press(positions.reshape(-1, 3), area_weighted=True, taxel_area=area, **options)[:, :2].reshape(u.shape)
    assert v == pytest.approx(u, abs=1e-5 * np.abs(u).max())
    genesis_grid = np.abs(press(positions, **options)[..., :2]).max()
    genesis_free = np.abs(press(positions.reshape(-1, 3), **options)[:, :2]).max()
    assert genesis_free > 300 * genesis_grid


@pytest.mark.parametrize("dilate_scale", [0.0, 1.0])
@pytest.mark.parametrize("shape", [(3, 3), (9, 17)])
def test_three_ways_to_the_same_shear(shape, dilate_scale, monkeypatch):
    """Tables (a CPU's), blocks of a grid (a GPU's), taxel by taxel; with fillers."""
    from tactemu.sensors.elastomer import elastomer_taxel
    from tactemu.sensors.elastomer import shear as shear_motion

    positions = grid(*shape)
    radius = np.where(np.arange(positions.size // 3) % 4 == 1, 0.0, 1e-3)
    shared = {"slide": 1e-3, "shear_scale": 3.0, "dilate_scale": dilate_scale, "radius": radius}
    tables = press(positions, **shared)
    monkeypatch.setattr(elastomer_taxel, "tabulated_shear_motion", shear_motion.grid_shear_motion)
    blocks = press(positions, **shared)
    one_by_one = press(positions.reshape(-1, 3), **shared).reshape(tables.shape)
    assert tables[..., 0].any()
    assert blocks == pytest.approx(tables, abs=1e-13 * np.abs(tables).max())
    assert one_by_one == pytest.approx(tables, abs=1e-13 * np.abs(tables).max())


def drag_box(n_sample_points, **options):
    """A box of 16 mm pressed by 0.5 mm and dragged by 1 mm."""
    shared = {"dilate_scale": 0.0, "shear_scale": 1.0, "lambda_s": 8e3, "shape": tt.Box(size=(0.016, 0.016, 0.016))}
    sim, skin, body = build(positions=grid(9, 9), n_sample_points=n_sample_points, **shared, **options)
    for x in (0.0, 1e-3):
        sim.set_pose(body, position=(x, 0.0, TOP + 0.0075))
        sim.step()
    return skin.read()


def test_doubling_the_points_changes_little_when_areas_weigh():
    u, v = (drag_box(n, area_weighted=True) for n in (1500, 3000))
    assert v == pytest.approx(u, abs=0.03 * np.abs(u).max())
    counted = [np.abs(drag_box(n)).max() for n in (1500, 3000)]
    assert counted[1] > 1.9 * counted[0]


def test_a_bent_grid_is_summed_one_by_one(caplog):
    positions = grid(6, 6)
    positions[..., 2] -= 20 * positions[..., 0] ** 2
    u = press(positions)
    flat = press(positions.reshape(-1, 3))
    assert "no flat, even grid" in caplog.text
    assert np.array_equal(u.reshape(-1, 3), flat)


@pytest.mark.parametrize(
    "option, value",
    [
        ("lambda_d", -1.0), ("lambda_s", np.nan), ("normal_exponent", 0.0), ("compressibility", 1.1),
        ("elastomer_thickness", -1e-3), ("contact_threshold", -1.0), ("shear_scale", np.inf), ("n_sample_points", 0),
        ("points", [(0, 0, np.nan)]), ("taxel_area", [1.0, 2.0]),
    ],
)  # fmt: skip
def test_wrong_options_are_named(option, value):
    with pytest.raises(SceneError, match=option):
        build(positions=grid(2, 3).reshape(-1, 3), area_weighted=True, **{"shear_scale": 1.0, option: value})


def test_only_what_is_switched_on_is_in_the_plan():
    names = {}
    for dilate, shear in ((1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (0.0, 0.0)):
        sim, *_ = build(positions=grid(4, 4), dilate_scale=dilate, shear_scale=shear)
        names[dilate, shear] = [stage.name.split(": ")[-1] for stage in sim.plan.stages if "Elastomer" in stage.name]
    assert names[1.0, 0.0] == ["depth", "dilation"] and names[0.0, 1.0] == ["anchors", "shear"]
    assert names[1.0, 1.0] == ["depth", "dilation", "anchors", "shear"] and names[0.0, 0.0] == []


@pytest.mark.parametrize("layout", [(8, 8), (64,)])
def test_depth_along_the_normal_goes_beyond_the_middle_of_a_plate(layout):
    """A plate of 1 mm pressed by 0.6 mm: the nearest surface is 0.4 mm away, along the normal it is 0.6 mm."""
    largest = {}
    for query in ("sdf", "ray"):
        model = {"lambda_d": 1e12, "normal_exponent": 1.0, "depth_query": query}
        positions = grid(8, 8).reshape(*layout, 3)
        sim, skin, plate = build(positions=positions, shape=tt.Box(size=(0.03, 0.03, 1e-3)), **model)
        sim.set_pose(plate, position=(0, 0, TOP + 0.5e-3 - 0.6e-3))
        sim.step()
        largest[query] = skin.read()[..., 2].max()
    assert largest["sdf"] == pytest.approx(0.4e-3) and largest["ray"] == pytest.approx(0.6e-3)


@pytest.mark.gpu
@pytest.mark.parametrize("layout", [(8, 8), (64,)])
def test_a_pose_that_is_not_finite_on_a_gpu(layout):
    positions = grid(8, 8).reshape(*layout, 3)
    readings = {}
    for bad in (False, True):
        scene = tt.Scene()
        pad = scene.add_body(tt.Box(size=(0.08, 0.08, 0.02)))
        ball = scene.add_body(tt.Sphere(radius=0.015))
        skins = [
            scene.add_sensor(tt.ElastomerTaxel(positions=positions), link=pad),
            scene.add_sensor(tt.ProximityTaxel(positions=positions), link=pad),
        ]
        sim = scene.build(n_envs=3, device="cuda:0")
        for x in (0.0, 1e-3, 2e-3, 3e-3):
            sim.set_pose(ball, position=(x, 0, TOP + 0.0135))
            if bad and x == 3e-3:
                sim.set_pose(ball, position=(np.nan, 0, TOP), envs=[1])
            sim.step()
        if bad:
            with pytest.raises(PoseError, match="environment 1, step 4"):
                skins[0].read()
        readings[bad] = [skins[0].read(), skins[1].read().force]
    for good, spoilt in zip(readings[False], readings[True]):
        assert np.isnan(spoilt[1]).any(axis=-1).all()
        assert np.array_equal(spoilt[[0, 2]], good[[0, 2]])


@pytest.mark.parametrize("real", [wp.float32, wp.float64])
def test_the_box_that_a_gpu_finds_is_that_around_what_touches(real):
    """The lanes of an environment look over all of its taxels; here it is one lane."""
    rows, cols, rng = 7, 11, np.random.default_rng(5)
    depth = np.where(rng.random((40, rows, cols)) < 0.03, rng.random((40, rows, cols)), 0.0)
    depth[:2], depth[2, 3, 4] = 0.0, np.nan
    box = wp.zeros((40, 4), dtype=wp.int32, device="cpu")
    flat = wp.array(depth.reshape(40, -1), dtype=real, device="cpu")
    record(box_kernel(real, 1), (40, 1), [0, flat, cols], [box], "cpu")()
    for found, env in zip(box.numpy(), depth):
        y, x = np.nonzero(~(env <= 0))
        if not len(y):
            assert found[0] > found[1] and found[2] > found[3]
        else:
            assert found.tolist() == [y.min(), y.max(), x.min(), x.max()]
