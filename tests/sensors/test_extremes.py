"""The far ends of what may be asked for, each with the behaviour that it must have."""

import math

import numpy as np
import pytest

import tactemu as tt
from tactemu.base.errors import SceneError
from tests.sensors.rig import depth_of, scene_with

MM = 1e-3
LINE = np.stack([np.linspace(-5, 5, 11) * MM, np.zeros(11), np.zeros(11)], -1)


def test_radius_zero_is_as_if_the_probe_were_not_there():
    radii = np.full(11, 2 * MM)
    radii[[0, 4, 10]] = 0.0
    ball = {"position": (0, 0, 9 * MM)}
    with_fillers = depth_of(tt.Sphere(radius=10 * MM), LINE, radii, **ball)
    without = depth_of(tt.Sphere(radius=10 * MM), LINE[radii > 0], 2 * MM, **ball)
    assert (with_fillers[radii == 0] == 0).all()
    assert np.array_equal(with_fillers[radii > 0], without)


@pytest.mark.parametrize(
    "shape", [tt.Sphere(radius=1.0), tt.Capsule(radius=1.0, length=1.0), tt.Cylinder(radius=1.0, length=4.0)]
)
def test_where_there_is_no_normal_the_taxels_own_is_used(shape):
    model = tt.KinematicTaxel(positions=[[0, 0, 0]], normals=(0, 0, 1), radius=1e-3, normal_stiffness=1.0)
    sim, _body, skin = scene_with(shape, model)
    sim.step()
    force = skin.read().force[0]
    assert np.isfinite(force).all() and np.linalg.norm(force) == pytest.approx(1.001)
    if not isinstance(shape, tt.Cylinder):  # at a cylinder's axis the radial normal is what is missing
        assert force == pytest.approx([0, 0, -1.001])


def test_a_normal_of_no_length_is_refused():
    with pytest.raises(SceneError, match=r"normals\[1\] has length zero"):
        scene_with(tt.Plane(), tt.ContactProbe(positions=np.zeros((2, 3)), normals=[(0, 0, 1), (0, 0, 0)]))


@pytest.mark.parametrize(("dtype", "real"), [("float32", np.float32), ("float64", np.float64)])
@pytest.mark.parametrize("threshold", [1e-4, 0.1])
def test_depth_exactly_at_the_threshold_is_no_touch(dtype, real, threshold):
    """A probe on a plane reads its radius, so that depth can be set to the last bit."""
    at = real(threshold)
    for radius, expected in ((np.nextafter(at, real(0)), False), (at, False), (np.nextafter(at, real(1)), True)):
        model = tt.ContactProbe(positions=[[0, 0, 0]], radius=float(radius), contact_threshold=threshold)
        sim, _body, skin = scene_with(tt.Plane(), model, dtype=dtype)
        sim.step()
        assert bool(skin.read()[0]) is expected


@pytest.mark.parametrize(("dtype", "real"), [("float32", np.float32), ("float64", np.float64)])
def test_release_exactly_at_the_threshold_lets_go(dtype, real):
    release = real(0.25)
    for depth, expected in ((np.nextafter(release, real(1)), True), (release, False)):
        model = tt.ContactProbe(positions=[[0, 0, 0]], radius=0.5, contact_threshold=0.4, release_threshold=0.25)
        sim, plane, skin = scene_with(tt.Plane(), model, dtype=dtype)
        sim.step()
        assert skin.read()[0]
        sim.set_pose(plane, position=(0, 0, float(depth) - 0.5))
        sim.step()
        assert bool(skin.read()[0]) is expected


SHAPES = {
    "sphere": lambda s: tt.Sphere(radius=10 * s),
    "box": lambda s: tt.Box(size=(20 * s, 14 * s, 18 * s)),
    "capsule": lambda s: tt.Capsule(radius=8 * s, length=6 * s),
    "cylinder": lambda s: tt.Cylinder(radius=9 * s, length=17 * s),
}


@pytest.mark.parametrize("kind", SHAPES)
@pytest.mark.parametrize("query", ["sdf", "ray", "voxel"])
@pytest.mark.parametrize("scale", [1e-9, 1e-6, 1.0, 1e3])
def test_a_scaled_scene_reads_the_same_scaled(kind, query, scale):
    """Compared with millimetres, to 1e-5 of the largest reading."""
    readings = []
    for unit in (MM, scale * MM):
        readings.append(
            depth_of(
                SHAPES[kind](unit), LINE / MM * unit, 2 * unit, position=(1 * unit, -2 * unit, 7.5 * unit),
                quaternion=(1, 0.2, 0.1, 0), depth_query=query,
            )
            / unit
        )  # fmt: skip
    assert readings[0].max() > 1
    assert np.abs(readings[0] - readings[1]).max() < 1e-5 * readings[0].max()


@pytest.mark.parametrize("far", [1e3, 1e5])
def test_far_from_the_origin_nothing_is_lost(far):
    """Relative poses are formed in float64: at 100 km the depth is right to 10 nm."""
    offset = far * np.array([0.6, -0.7, 0.387])
    turn = np.array([0.8, 0.1, -0.5, 0.3])
    readings = []
    for at in (0 * offset, offset):
        scene = tt.Scene()
        link = scene.add_body(name="link", position=at, quaternion=turn)
        ball = scene.add_body(tt.Sphere(radius=10 * MM))
        skin = scene.add_sensor(tt.ContactDepthProbe(positions=LINE, radius=2 * MM), link=link)
        sim = scene.build()
        q = turn / np.linalg.norm(turn)
        u = np.broadcast_to(q[1:], (3,))
        local = np.array([0, 0, 9 * MM])
        t = 2 * np.cross(u, local)
        sim.set_pose(ball, position=at + local + q[0] * t + np.cross(u, t))
        sim.step()
        readings.append(skin.read())
    assert readings[0].max() == pytest.approx(3 * MM, abs=1e-8)
    assert np.abs(readings[0] - readings[1]).max() < 1e-8


def test_the_length_of_a_step_changes_no_reading():
    readings = []
    for dt in (0.0, 1e-9, 1e-3, 1.0, 1e6):
        sim, ball, skin = scene_with(tt.Sphere(radius=10 * MM), tt.KinematicTaxel(positions=LINE, normal_stiffness=1e9))
        sim.set_pose(ball, position=(0, 0, 9 * MM), linear_velocity=(0.1, 0, -0.3))
        sim.step(dt=dt)
        readings.append(skin.read().force)
    assert all(np.array_equal(readings[0], other) for other in readings)


@pytest.mark.parametrize("exponent", [0.0, -1.0, math.nan, math.inf])
def test_exponents_that_are_not_positive_are_refused(exponent):
    with pytest.raises(SceneError, match="normal_exponent must be > 0"):
        scene_with(tt.Plane(), tt.KinematicTaxel(normal_exponent=exponent))


@pytest.mark.parametrize("exponent", [0.5, 1.0, 1.5])
def test_force_is_zero_without_depth_and_grows_from_there(exponent):
    model = tt.KinematicTaxel(positions=[[0, 0, 0]], radius=1 * MM, normal_exponent=exponent)
    sim, plane, skin = scene_with(tt.Plane(), model, dtype="float64")
    for gap, depth in ((1 * MM, 0.0), (1 * MM - 1e-12, 1e-12), (0.0, 1 * MM)):
        sim.set_pose(plane, position=(0, 0, -gap))
        sim.step()
        expected = 1000.0 * depth**exponent
        assert skin.read().force[0, 2] == pytest.approx(expected, rel=1e-3, abs=1e-15)


@pytest.mark.parametrize("kind", [tt.ContactProbe, tt.ContactDepthProbe, tt.KinematicTaxel, tt.ElasticLayerTaxel])
@pytest.mark.parametrize("n_envs", [None, 2])
def test_no_taxel_at_all_reads_an_empty_array(kind, n_envs):
    sim, _body, skin = scene_with(tt.Sphere(radius=1.0), kind(positions=np.zeros((0, 3))), n_envs=n_envs)
    sim.step()
    reading = skin.read()
    head = () if n_envs is None else (n_envs,)
    if hasattr(reading, "force"):
        assert reading.force.shape == (*head, 0, 3)
    else:
        assert reading.shape == (*head, 0)
    sim.reset()
    assert skin.quantity(skin.quantities[0]).shape[0] == 0


def test_a_million_taxels():
    x = np.linspace(-10, 10, 1000) * MM
    grid = np.stack([*np.meshgrid(x, x), np.zeros((1000, 1000))], -1)
    sim, ball, skin = scene_with(tt.Sphere(radius=10 * MM), tt.ContactDepthProbe(positions=grid, radius=1 * MM))
    sim.set_pose(ball, position=(0, 0, 9 * MM))
    sim.step()
    depth = skin.read()
    exact = np.maximum(11 * MM - np.sqrt((grid[..., :2] ** 2).sum(-1) + (9 * MM) ** 2), 0)
    assert depth.shape == (1000, 1000) and np.abs(depth - exact).max() < 2e-9


def test_more_taxels_than_a_launch_can_count_are_refused():
    grid = np.zeros((100_000, 3))
    with pytest.raises(SceneError, match="build fewer environments"):
        scene_with(tt.Sphere(radius=1.0), tt.ContactDepthProbe(positions=grid), n_envs=21475)


def test_a_quaternion_of_any_length_is_the_same_rotation():
    """|q| = 1.01, unnormalised, would be 0.68 mm off at a lever of 10 cm."""
    points = LINE + np.array([0.1, 0, 0])
    readings = []
    for length in (1.0, 1.01, 1e-3, 1e3, -2.0):
        q = length * np.array([math.cos(0.3), 0, math.sin(0.3), 0])
        readings.append(
            depth_of(tt.Box(size=(0.3, 0.3, 0.3)), points, 2 * MM, position=(0, 0, 0.11), quaternion=q, dtype="float64")
        )
    assert readings[0].max() > 0
    assert all(np.abs(readings[0] - other).max() < 1e-12 for other in readings)


def test_counters_go_past_31_bits():
    model = tt.ContactDepthProbe(positions=LINE, electronics=tt.ElectronicsOptions(noise=1e-5))
    sim, _ball, skin = scene_with(tt.Sphere(radius=10 * MM), model)
    sim.context.step.fill_(2**31 - 2)
    sim.context.time_ns.fill_((2**31 - 2) * 1_000_000)
    sim.step_count, sim.time_ns = 2**31 - 2, (2**31 - 2) * 1_000_000
    seen = []
    for _ in range(4):
        sim.step()
        seen.append(skin.read())
    assert sim.step_count == 2**31 + 2 == int(sim.context.step.numpy()[0])
    assert sim.time_ns == (2**31 + 2) * 1_000_000 == int(sim.context.time_ns.numpy()[0])
    assert len({reading.tobytes() for reading in seen}) == 4


def test_dampers_take_energy_and_pull_only_if_allowed():
    rng = np.random.default_rng(0)
    for clamp in (False, True):
        model = tt.KinematicTaxel(
            positions=LINE, radius=2 * MM, normal_stiffness=0.0 if not clamp else 10.0,
            normal_damping=50.0, clamp_adhesion=clamp, twist_scalar=0.0,
        )  # fmt: skip
        sim, plane, skin = scene_with(tt.Plane(), model, dtype="float64")
        for velocity in rng.normal(size=(20, 3)):
            sim.set_pose(plane, position=(0, 0, 0), linear_velocity=velocity)
            sim.step()
            force = skin.read().force
            if clamp:  # the plane lies below: a push on the skin is upwards
                assert (force[:, 2] >= 0).all()
            else:  # the body works on the skin, never the skin on the body
                assert (force @ velocity >= 0).all()


def test_a_contact_narrower_than_the_pitch_needs_a_radius_of_half_of_it():
    blade = tt.Box(size=(0.2 * MM, 40 * MM, 10 * MM))
    between = {"position": (0.5 * MM, 0, 4.9 * MM)}
    assert depth_of(blade, LINE, 0.3 * MM, **between).max() == 0
    assert depth_of(blade, LINE, 0.5 * MM, **between).max() > 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"positions": np.zeros((2, 2))}, "positions must have shape"),
        ({"positions": [[0, 0, np.nan]]}, "positions must be finite"),
        ({"radius": -1.0}, "radius must be >= 0"),
        ({"radius": [1.0, 2.0]}, "radius must be one number or 1, got 2"),
        ({"sense": 7}, r"this scene has no body 7 \(bodies: 0: link, 1: body\)"),
        ({"sense": "link"}, "names its own link"),
        ({"depth_query": "sonar"}, "depth_query"),
        ({"depth_query": "voxel", "voxel_size": 0.0}, "voxel_size must be > 0"),
        ({"ray_reach": -1.0}, "ray_reach"),
    ],
)
def test_wrong_options_are_named(options, message):
    with pytest.raises(SceneError, match=message):
        scene_with(tt.Box(size=(1, 1, 1)), tt.ContactDepthProbe(**options))


@pytest.mark.parametrize(
    "make",
    [
        lambda: tt.Sphere(radius=0.0),
        lambda: tt.Box(size=(1, 1)),
        lambda: tt.Capsule(radius=1.0, length=-1.0),
        lambda: tt.Cylinder(radius=math.nan, length=1.0),
        lambda: tt.Scene(dt=0.0),
        lambda: tt.Scene().build(0),
        lambda: tt.Scene().build(dtype="float16"),
        lambda: tt.Scene().build(device="cuda:99"),
        lambda: tt.Scene().add_body(quaternion=(0, 0, 0, 0)),
        lambda: tt.Scene().add_body(position=(0, 0)),
        lambda: tt.Scene().add_body("sphere"),
        lambda: tt.Scene().add_sensor(tt.KinematicTaxel, link=0),
        lambda: tt.Scene().add_sensor(tt.KinematicTaxel(), link=0),
    ],
)
def test_wrong_scenes_are_refused(make):
    with pytest.raises(SceneError):
        make()
