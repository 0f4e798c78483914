"""ProximityTaxel against sums written out, and at the extremes."""

import numpy as np
import pytest

import tactemu as tt
from tactemu.base.errors import PoseError, SceneError
from tactemu.base.option_groups import from_flat
from tactemu.plan.plan import Stage
from tactemu.sensors.points.proximity_patches import record_patches
from tactemu.sensors.points.table import upload_clouds


def scene_of(points, *, dtype="float64", n_envs=None, shape=None, **options):
    scene = tt.Scene(dt=1e-3)
    pad = scene.add_body(tt.Box(size=(0.1, 0.1, 0.02)))
    body = scene.add_body(shape or tt.Sphere(radius=0.01), name="body")
    skin = scene.add_sensor(from_flat(tt.ProximityTaxel, {"points": points, **options}), link=pad)
    return scene.build(n_envs=n_envs, dtype=dtype), skin, body


def rotation(q):
    w, x, y, z = np.asarray(q) / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def by_hand(points, probes, normals, radius, pad, body, *, stiffness, density, shear, twist):
    """The formulas of the module, pair by pair, in the world's frame."""
    (xp, qp, vp, wp_), (xb, qb, vb, wb) = pad, body
    to_world, of_body = rotation(qp), rotation(qb)
    x = xb + points @ of_body.T
    scale = density / len(points)
    force, torque = [], []
    for r, a in zip(probes, normals):
        p, a = xp + to_world @ r, to_world @ a
        d = x - p
        overlap = np.maximum(radius - np.linalg.norm(d, axis=1), 0)
        v = vb + np.cross(wb, x - xb) - (vp + np.cross(wp_, p - xp))
        v -= np.outer(v @ a, a)
        f = -stiffness * scale * overlap.sum() * a + shear * scale * (overlap[:, None] * v).sum(0)
        spin = (wb - wp_) @ a if overlap.any() else 0.0
        force.append(to_world.T @ f)
        torque.append(to_world.T @ (np.cross(p - xp, f) + twist * spin * a))
    return np.array(force), np.array(torque)


@pytest.mark.parametrize("dtype, tolerance", [("float64", 1e-12), ("float32", 2e-5)])
@pytest.mark.parametrize("radius", [2e-3, 8e-3, 0.5])
def test_force_and_torque_are_the_sums_over_points(dtype, tolerance, radius):
    rng = np.random.default_rng(1)
    points = rng.normal(size=(333, 3)) * 0.006
    probes = rng.uniform(-0.02, 0.02, size=(40, 3))
    normals = rng.normal(size=(40, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    numbers = {"stiffness": 150.0, "density": 120.0, "shear": 3.0, "twist": 0.05}
    sim, skin, body = scene_of(
        points, dtype=dtype, positions=probes, normals=normals, radius=radius, stiffness=150.0,
        density_scalar=120.0, shear_coupling=3.0, twist_scalar=0.05,
    )  # fmt: skip
    pad_pose = (np.array([0.3, -0.2, 1.0]), rng.normal(size=4), rng.normal(size=3), rng.normal(size=3))
    body_pose = (pad_pose[0] + [0.01, 0.0, 0.01], rng.normal(size=4), rng.normal(size=3), rng.normal(size=3))
    for which, (x, q, v, w) in ((0, pad_pose), (body, body_pose)):
        sim.set_pose(which, position=x, quaternion=q, linear_velocity=v, angular_velocity=w)
    sim.step()
    expected = by_hand(points, probes, normals, radius, pad_pose, body_pose, **numbers)
    for got, want in zip(skin.read(), expected):
        assert want.any()
        assert got == pytest.approx(want, abs=tolerance * np.abs(want).max())


def test_mean_overlap_of_an_even_plate():
    """Closed form: points of density 1/A on a plane through the probe sum up to pi r^3 / (3 A)."""
    i = np.arange(20_000)
    x = 0.04 * np.stack([(i + 0.5) / len(i) - 0.5, (i * (np.sqrt(5) - 1) / 2) % 1 - 0.5, 0 * i], -1)
    sim, skin, _ = scene_of(x, positions=[(0, 0, 0)], radius=0.01, stiffness=1.0, density_scalar=1.0)
    sim.step()
    assert skin.read().force[0, 2] == pytest.approx(-np.pi * 0.01**3 / (3 * 0.04**2), rel=4e-3)


def test_a_point_at_the_probe_counts_fully():
    """And one at the very radius not at all; the seed leaves the first one out."""
    sim, skin, _ = scene_of(
        [(0, 0, 0), (0, 0, 0.005)], positions=[(0, 0, 0)], radius=0.005, stiffness=2.0, density_scalar=2.0
    )
    sim.step()
    assert skin.read().force[0] == pytest.approx([0, 0, -2.0 * 0.005], rel=1e-12)


def test_fillers_and_no_taxels():
    points = np.zeros((5, 3))
    sim, skin, _ = scene_of(points, positions=[(0, 0, 0), (0, 0, 0)], radius=[0.0, 0.01])
    sim.step()
    force, torque = skin.read()
    assert not force[0].any() and not torque[0].any() and force[1, 2] < 0
    sim, skin, _ = scene_of(points, positions=np.zeros((0, 3)))
    sim.step()
    assert skin.read().force.shape == (0, 3)


def test_the_convention_of_genesis_turns_the_normal_and_twist_parts():
    points = np.array([(0.001, 0, 0.002)])
    options = {"positions": [(0, 0, 0)], "shear_coupling": 1.0, "twist_scalar": 0.1}
    forces = []
    for convention in ("genesis", "skin"):
        sim, skin, body = scene_of(points, convention=convention, **options)
        sim.set_pose(body, linear_velocity=(0.1, 0, 0), angular_velocity=(0, 0, 3.0))
        sim.step()
        forces.append(skin.read())
    assert forces[1].force[0, 2] == -forces[0].force[0, 2] < 0  # a push is along -normal
    assert forces[1].force[0, :2] == pytest.approx(forces[0].force[0, :2])  # dragged along with the body
    assert forces[1].torque[0, 2] == -forces[0].torque[0, 2] > 0


def test_gain_multiplies_the_sums_and_not_the_twist():
    points = np.array([(0.001, 0, 0.002), (0.0, 0.002, 0.001)])
    options = {"positions": [(0, 0, 0)], "shear_coupling": 1.0, "twist_scalar": 0.1, "gain": 1.5}
    sim, skin, body = scene_of(points, **options)
    sim.set_pose(body, linear_velocity=(0.1, 0, 0), angular_velocity=(0, 0, 3.0))
    sim.step()
    measured, truth = skin.read(), skin.read_ground_truth()
    assert measured.force == pytest.approx(1.5 * truth.force)
    assert measured.torque == pytest.approx(truth.torque)  # at the origin there is only twist
    assert truth.torque[0, 2] == pytest.approx(0.3)


@pytest.mark.parametrize("size", [1e-9, 1e-3, 1e3])
def test_a_scaled_scene_reads_the_same_scaled(size):
    rng = np.random.default_rng(0)
    points, probes = rng.normal(size=(100, 3)), rng.normal(size=(20, 3))
    readings = []
    for s in (1.0, size):
        sim, skin, _ = scene_of(points * s, dtype="float32", positions=probes * s, radius=1.2 * s)
        sim.step()
        readings.append((skin.read().force / s).astype(float))
    assert readings[1] == pytest.approx(readings[0], abs=1e-5 * np.abs(readings[0]).max())


def test_a_pose_that_is_not_finite():
    points = np.zeros((5, 3))
    readings = {}
    for bad in (False, True):
        sim, skin, body = scene_of(points, n_envs=3, dtype="float32", positions=[(0, 0, 0.001)])
        if bad:
            sim.set_pose(body, position=(0, np.inf, 0), envs=[2])
            with pytest.raises(PoseError, match="environment 2, step 1"):
                sim.step()
        else:
            sim.step()
        readings[bad] = skin.read().force
    assert np.isnan(readings[True][2]).any()
    assert np.array_equal(readings[True][:2], readings[False][:2])


def test_every_shape_with_a_surface_is_sampled():
    probe = {"positions": [(0, 0, 0)], "radius": 0.1}
    shapes = [
        tt.Sphere(radius=0.01), tt.Box(size=(0.01, 0.02, 0.03)), tt.Capsule(radius=0.01, length=0.02),
        tt.Cylinder(radius=0.01, length=0.02), tt.Mesh(source=(np.eye(3), [[0, 1, 2]])),
    ]  # fmt: skip
    for shape in shapes:
        sim, skin, _ = scene_of(None, shape=shape, n_sample_points=64, **probe)
        sim.step()
        assert np.isfinite(skin.read().force).all()
    for shape in (tt.Plane(), tt.VoxelGrid(values=np.ones((2, 2, 2)), origin=(0, 0, 0), cell=1.0)):
        with pytest.raises(SceneError, match="points"):
            scene_of(None, shape=shape, **probe)


@pytest.mark.parametrize(
    "option, value",
    [
        ("stiffness", -1.0),
        ("twist_scalar", np.nan),
        ("n_sample_points", 0),
        ("n_sample_points", [3, 4]),
        ("points", [[(0, 0)]]),
    ],
)  # fmt: skip
def test_wrong_options_are_named(option, value):
    with pytest.raises(SceneError, match=option):
        scene_of(**{"points": None, "positions": [(0, 0, 0)], option: value})


def test_the_same_seed_gives_the_same_points():
    forces = []
    for seed in (3, 3, 4):
        scene = tt.Scene()
        pad = scene.add_body(tt.Box(size=(0.1, 0.1, 0.02)))
        scene.add_body(tt.Sphere(radius=0.01), position=(0, 0, 0.018))
        skin = scene.add_sensor(tt.ProximityTaxel(positions=[(0, 0, 0.01)], radius=0.004), link=pad)
        sim = scene.build(seed=seed)
        sim.step()
        forces.append(skin.read().force)
    assert np.array_equal(forces[0], forces[1]) and not np.array_equal(forces[0], forces[2])


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("spoiled", [{}, {"gain": 1.1}, {"gain": 1.1, "radius_noise": 5e-4}])
def test_the_kernel_for_a_gpu_reads_the_same_bits(monkeypatch, dtype, spoiled):
    """A CPU leaves out points that are out of reach, a GPU adds zeros for them."""
    points = np.random.default_rng(0).normal(size=(333, 3)) * 0.006
    probes = np.random.default_rng(1).uniform(-0.02, 0.02, size=(40, 3))

    def readings():
        scene = tt.Scene(dt=1e-3)
        pad = scene.add_body(tt.Box(size=(0.1, 0.1, 0.02)), name="pad")
        ball = scene.add_body(tt.Sphere(radius=0.01), name="ball")
        options = {"positions": probes, "radius": 5e-3, "points": points, "shear_coupling": 2.0, **spoiled}
        skin = scene.add_sensor(from_flat(tt.ProximityTaxel, options), link=pad, name="skin")
        sim = scene.build(3, dtype=dtype)
        places = np.array([[0.002, 0.0, 0.01], [0.0, 0.004, -0.01], [1.0, 0.0, 0.0]])
        turn = (0.8, 0.1, 0.3, -0.4)
        sim.set_pose(ball, position=places, quaternion=turn, linear_velocity=(0.1, 0, 0), angular_velocity=(0, 1, 2))
        sim.step()
        return [part for reading in (skin.read(), skin.read_ground_truth()) for part in reading]

    def on_gpu(self, site, clusters, truth, raw):
        clouds, measured = upload_clouds(clusters, site.context), raw if site.separate else None
        parameters = self._parameters(site, clouds, clusters.n_points)
        return [Stage(name="", reason="", launch=record_patches(site, clouds, parameters, True, truth, measured))]

    expected = readings()
    monkeypatch.setattr(tt.ProximityTaxel, "_stages", on_gpu)
    found = readings()
    assert expected[0].any() and all(np.array_equal(one, other) for one, other in zip(expected, found))


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_a_taxel_reads_the_same_bits_alone_as_among_others(dtype):
    """Taxels share vector registers, and what is out of reach of all of them is skipped: no taxel reads it."""
    rng = np.random.default_rng(4)
    probes = rng.uniform(-0.02, 0.02, size=(45, 3))
    normals = rng.normal(size=(45, 3))
    radii = rng.uniform(2e-3, 1.2e-2, size=45)

    def readings(chosen):
        scene = tt.Scene(dt=1e-3)
        pad = scene.add_body(tt.Box(size=(0.1, 0.1, 0.02)), name="pad")
        balls = [scene.add_body(tt.Sphere(radius=r), name=f"ball {r}") for r in (0.01, 0.007)]
        model = tt.ProximityTaxel(
            positions=probes[chosen], normals=normals[chosen], radius=radii[chosen], n_sample_points=(300, 77),
            shear_coupling=2.0,
        )  # fmt: skip
        skin = scene.add_sensor(model, link=pad, name="skin")
        sim = scene.build(3, dtype=dtype)
        for k, ball in enumerate(balls):
            place = np.array([[0.01, 0.0, 0.01], [0.0, 0.02, -0.01], [1.0, 0.0, 0.0]]) * (1 - 2 * k)
            turn = (0.8, 0.1 + k, 0.3, -0.4)
            sim.set_pose(
                ball, position=place, quaternion=turn, linear_velocity=(0.1, 0.2, 0.3), angular_velocity=turn[1:]
            )
        sim.step()
        return np.concatenate(skin.read(), axis=-1)

    together = readings(np.arange(45))
    assert together[:2].any() and not together[2].any()
    for chosen in ([7], [0, 44, 13], rng.permutation(45)[:17]):
        assert np.array_equal(readings(np.array(chosen)), together[:, chosen])
