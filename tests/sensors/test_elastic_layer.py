"""ElasticLayerTaxel in a scene: geometry, frames, histories, options."""

import numpy as np
import pytest

import tactemu as tt
from tactemu.base.errors import SceneError

TOP = 0.005


def grid(rows, columns, pitch, z=TOP):
    x = (np.arange(columns) - (columns - 1) / 2) * pitch
    y = ((rows - 1) / 2 - np.arange(rows)) * pitch
    return np.stack([*np.meshgrid(x, y), np.full((rows, columns), z)], -1)


def scene_with(shape, *, positions=None, build=None, quaternion=(1, 0, 0, 0), **options):
    scene = tt.Scene(dt=1e-3)
    pad = scene.add_body(tt.Box(size=(0.08, 0.08, 2 * TOP)), fixed=True, name="pad")
    body = scene.add_body(shape, name="object", position=(0, 0, 1.0), quaternion=quaternion)
    positions = grid(24, 32, 5e-4) if positions is None else positions
    options = {"young_modulus": 1e5, "poisson_ratio": 0.49, "thickness": 4e-3, "friction": 0.0, **options}
    skin = scene.add_sensor(tt.ElasticLayerTaxel(positions=positions, **options), link=pad)
    return scene.build(**(build or {})), body, skin


def press(sim, body, skin, height, x=0.0, y=0.0, **pose):
    sim.set_pose(body, position=(x, y, TOP + height), **pose)
    sim.step()
    return skin.read()


def test_ball_pressed():
    """Force of a true sphere on a layer, from the table of another solver: 0.238521 N."""
    sim, ball, skin = scene_with(tt.Sphere(radius=5e-3), iterations=50, oversampling=2)
    reading = press(sim, ball, skin, 4.5e-3)
    assert reading.force.shape == (24, 32, 3) and reading.pressure.shape == (24, 32)
    total = reading.force.sum((0, 1))
    assert total[2] == pytest.approx(-0.238521, rel=2e-3)
    assert np.abs(total[:2]).max() < 1e-6
    assert reading.residual.max() < 1e-4
    assert reading.displacement[..., 2].min() == pytest.approx(-4.84e-4, rel=0.01)
    assert reading.displacement[..., 2].max() > 1e-6  # the skin rises beside the ball
    np.testing.assert_allclose(reading.force[..., 2], -reading.pressure * 2.5e-7, rtol=1e-5)


SHAPES = {
    "box": (tt.Box(size=(0.006, 0.008, 0.01)), 0.005, lambda x, y: (abs(x) < 3e-3) & (abs(y) < 4e-3)),
    "cylinder": (tt.Cylinder(radius=0.004, length=0.01), 0.005, lambda x, y: np.hypot(x, y) < 4e-3),
    "capsule": (tt.Capsule(radius=0.003, length=0.01), 0.008, lambda x, y: np.hypot(x, y) < 1.6e-3),
}


@pytest.mark.parametrize("name", SHAPES)
def test_contact_is_where_the_shape_is(name):
    shape, half_height, inside = SHAPES[name]
    sim, body, skin = scene_with(shape, thickness=1e-5, poisson_ratio=0.3, look_depth=0.01)
    reading = press(sim, body, skin, half_height - 4e-4)
    x, y = np.moveaxis(grid(24, 32, 5e-4)[..., :2], -1, 0)
    np.testing.assert_array_equal(reading.pressure > 0, inside(x, y))


def test_mesh_and_voxels_feel_as_the_primitive():
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=5, radius=5e-3)
    axis = np.linspace(-6e-3, 6e-3, 64)
    distance = np.linalg.norm(np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1), axis=-1) - 5e-3
    voxels = tt.VoxelGrid(values=distance, origin=(-6e-3,) * 3, cell=axis[1] - axis[0])
    forces = {}
    for name, shape in {"sphere": tt.Sphere(radius=5e-3), "mesh": tt.Mesh(source=ball), "voxels": voxels}.items():
        sim, body, skin = scene_with(shape, iterations=50)
        forces[name] = press(sim, body, skin, 4.5e-3).force.sum((0, 1))[2]
    assert forces["mesh"] == pytest.approx(forces["sphere"], rel=5e-3)
    assert forces["voxels"] == pytest.approx(forces["sphere"], rel=2e-2)


def test_box_wall_does_not_hide_its_depth():
    """Near the wall of a box the nearest surface is the wall; a cell there is as deep as the others."""
    sim, body, skin = scene_with(tt.Box(size=(0.006, 0.006, 0.01)), thickness=1e-5, poisson_ratio=0.3, look_depth=0.01)
    reading = press(sim, body, skin, 4e-3)
    pressed = reading.pressure[reading.pressure > 0]
    assert pressed.std() < 1e-3 * pressed.mean()


def test_layout_as_list_and_as_grid_read_the_same():
    positions = grid(24, 32, 5e-4)
    order = np.random.default_rng(0).permutation(24 * 32)
    readings = []
    for given in (positions, positions.reshape(-1, 3)[order]):
        sim, ball, skin = scene_with(tt.Sphere(radius=5e-3), positions=given, friction=0.5)
        press(sim, ball, skin, 4.6e-3, x=1e-3)
        readings.append(press(sim, ball, skin, 4.5e-3, x=1.1e-3))
    for one, other in zip(*readings):
        scale = np.abs(one).max()
        np.testing.assert_allclose(other, one.reshape(other.shape[0], -1).squeeze()[order] if one.ndim == 2
                                   else one.reshape(-1, 3)[order], atol=1e-3 * scale)  # fmt: skip


def test_forces_are_in_the_links_frame():
    """A pad that looks along +x, dragged by a ball that moves along -z."""
    scene = tt.Scene()
    pad = scene.add_body(None, name="pad", fixed=True, quaternion=(1, 0, 0, 0))
    ball = scene.add_body(tt.Sphere(radius=5e-3), position=(1, 0, 0))
    y, z = np.meshgrid((np.arange(20) - 9.5) * 5e-4, (np.arange(20) - 9.5) * 5e-4)
    positions = np.stack([np.zeros_like(y), y, z], -1)
    model = tt.ElasticLayerTaxel(positions=positions, normals=(1, 0, 0), friction=0.3)
    skin = scene.add_sensor(model, link=pad)
    sim = scene.build()
    for k in range(12):
        sim.set_pose(ball, position=(4.6e-3, 0, -2e-5 * k))
        sim.step()
    reading = skin.read()
    total = reading.force.sum((0, 1))
    assert total[0] < 0 and total[2] < 0 and abs(total[1]) < 1e-3 * abs(total[2])
    assert abs(total[2]) <= 0.3 * abs(total[0]) * (1 + 1e-5)
    assert np.abs(reading.traction[..., 0]).max() < 1e-3 * np.abs(reading.traction).max()
    dragged = reading.displacement[..., 2]
    assert dragged[np.abs(dragged).argmax() // 20, np.abs(dragged).argmax() % 20] < 0


def test_rolling_sticks_and_sliding_slips():
    """A ball pressed in by d rolls freely at the radius R - d/3, as a tyre does; one that slides carries mu p."""
    ratios = {}
    for kind in ("roll", "slide"):
        sim, ball, skin = scene_with(tt.Sphere(radius=5e-3), friction=0.5, coupled=False, iterations=50)
        press(sim, ball, skin, 4.7e-3, x=-1e-3)
        for k in range(1, 41):
            way = 5e-5 * k
            turn = way / 4.9e-3 if kind == "roll" else 0.0
            quaternion = (np.cos(turn / 2), 0, np.sin(turn / 2), 0)
            reading = press(sim, ball, skin, 4.7e-3, x=-1e-3 + way, quaternion=quaternion)
        force = reading.force.sum((0, 1))
        ratios[kind] = -force[0] / force[2] / 0.5
    assert ratios["slide"] == pytest.approx(1.0, abs=2e-3)
    assert abs(ratios["roll"]) < 0.05


def test_reset_forgets_and_repeats():
    sim, ball, skin = scene_with(tt.Sphere(radius=5e-3), friction=0.5, build={"n_envs": 2})
    runs = []
    for _ in range(2):
        for k in range(6):
            reading = press(sim, ball, skin, 4.6e-3, x=3e-5 * k)
        runs.append(reading)
        sim.reset()
        assert not np.any(skin.read().force)
    for one, other in zip(*runs):
        np.testing.assert_array_equal(one, other)
        np.testing.assert_array_equal(one[0], one[1])


def test_reset_of_one_environment_leaves_the_other():
    sim, ball, skin = scene_with(tt.Sphere(radius=5e-3), friction=0.5, build={"n_envs": 2})
    for k in range(4):
        press(sim, ball, skin, 4.6e-3, x=3e-5 * k)
    sim.reset(envs=[0])
    reading = press(sim, ball, skin, 4.6e-3, x=9e-5)
    assert abs(reading.force[1, ..., 0].sum()) > 100 * abs(reading.force[0, ..., 0].sum())


def test_nan_pose_reads_nan_in_its_environment_alone():
    sim, ball, skin = scene_with(tt.Sphere(radius=5e-3), build={"n_envs": 2})
    sim.set_pose(ball, position=(0, 0, TOP + 4.6e-3))
    sim.set_pose(ball, position=[(np.nan, 0, 0)], envs=[0])
    with pytest.raises(tt.TactemuError):
        sim.step()
    force = skin.read().force
    assert np.isnan(force[0]).any() and np.isfinite(force[1]).all() and force[1].any()


def test_far_bodies_and_bodies_behind_the_pad_are_not_felt():
    sim, ball, skin = scene_with(tt.Sphere(radius=5e-3))
    assert not np.any(press(sim, ball, skin, 6e-3).force)
    assert not np.any(press(sim, ball, skin, -2e-2).force)


def test_fillers_are_no_skin():
    radius = np.full((24, 32), 1e-3)
    radius[10:14, :16] = 0.0
    sim, ball, skin = scene_with(tt.Sphere(radius=5e-3), radius=radius)
    reading = press(sim, ball, skin, 4.5e-3)
    assert not reading.force[10:14, :16].any() and reading.force[10:14, 16:].any()


def test_imperfections_spoil_measurements_not_status():
    sim, ball, skin = scene_with(tt.Sphere(radius=5e-3), friction=0.5, electronics=tt.ElectronicsOptions(noise=1e-3))
    for k in range(3):
        reading = press(sim, ball, skin, 4.5e-3, x=1e-5 * k)
    truth = skin.read_ground_truth()
    assert np.std(reading.force - truth.force) > 5e-4
    np.testing.assert_array_equal(reading.slip, truth.slip)
    np.testing.assert_array_equal(reading.residual, truth.residual)


def test_quantities_for_devices():
    sim, ball, skin = scene_with(tt.Sphere(radius=5e-3))
    press(sim, ball, skin, 4.5e-3)
    assert skin.quantity("force").shape == (24 * 32, 3)
    assert skin.quantity("pressure").shape == (24 * 32,)
    assert skin.quantity("displacement").shape == (24 * 32, 3)
    assert skin.quantity("touch").dtype == bool and skin.quantity("touch").sum() == (skin.read().pressure > 0).sum()


def test_stages_are_only_what_is_asked_for():
    def names(**options):
        sim, _, _ = scene_with(tt.Sphere(radius=5e-3), **options)
        return [stage.name.split(": ")[-1] for stage in sim.plan.stages[1:]]

    assert names(friction=0.0, displacement=False) == ["overlap", "pressure", "taxels"]
    assert names(friction=0.5) == ["overlap", "pressure", "friction", "surface", "taxels"]


def test_float64_scene():
    forces = []
    for dtype in ("float32", "float64"):
        sim, ball, skin = scene_with(tt.Sphere(radius=5e-3), build={"dtype": dtype}, iterations=50, tolerance=1e-6)
        forces.append(float(press(sim, ball, skin, 4.5e-3).force.sum((0, 1))[2]))
    assert forces[0] == pytest.approx(forces[1], rel=1e-5)


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("young_modulus", 0.0),
        ("thickness", -1.0),
        ("thickness", 0.0),
        ("poisson_ratio", 0.51),
        ("friction", -0.1),
        ("iterations", 0),
        ("oversampling", 0),
        ("tolerance", 0.0),
        ("look_depth", 0.0),
        ("depth_query", "sdf"),
    ],
)
def test_wrong_options_are_named(option, value):
    with pytest.raises(SceneError, match=option):
        scene_with(tt.Sphere(radius=5e-3), **{option: value})


def test_taxels_off_the_grid_are_refused():
    positions = grid(4, 4, 1e-3)
    positions[1, 2, 0] += 2e-4
    with pytest.raises(SceneError, match="rectangular grid"):
        scene_with(tt.Sphere(radius=5e-3), positions=positions)


def test_nothing_is_left_where_an_object_has_been():
    """Readings and displacements far from the present contact are those of a scene that never touched there."""
    sim, ball, skin = scene_with(tt.Sphere(radius=2e-3), thickness=5e-4, friction=0.5)
    for x in (-5e-3, -4.5e-3):
        press(sim, ball, skin, 1.8e-3, x=x)
    sim.set_pose(ball, position=(0, 0, 1))
    sim.step()
    away = skin.read()
    assert not away.force.any() and not away.displacement.any() and not away.slip.any()
    moved = press(sim, ball, skin, 1.8e-3, x=5e-3)
    fresh, other, other_skin = scene_with(tt.Sphere(radius=2e-3), thickness=5e-4, friction=0.5)
    wanted = press(fresh, other, other_skin, 1.8e-3, x=5e-3)
    for one, two in zip(moved, wanted):
        np.testing.assert_array_equal(one, two)


def test_a_pose_made_good_again_reads_again():
    sim, ball, skin = scene_with(tt.Sphere(radius=5e-3))
    sim.set_pose(ball, position=(np.nan, 0, 0))
    with pytest.raises(tt.TactemuError):
        sim.step()
    reading = press(sim, ball, skin, 4.5e-3)
    assert np.isfinite(reading.force).all() and reading.force.any()
    sim.set_pose(ball, position=(np.nan, 0, 0))
    with pytest.raises(tt.TactemuError):
        sim.step()
    assert not np.isnan(press(sim, ball, skin, 6e-3).force).any()


def test_two_pads_are_two_layers():
    """Pads back to back, as on two fingers: each reads as it does alone, and knows nothing of the other."""
    near, far = grid(12, 14, 1e-3).reshape(-1, 3), grid(8, 6, 1.5e-3, z=-TOP).reshape(-1, 3)
    both = np.concatenate([near, far])
    normals = np.repeat([(0, 0, 1.0), (0, 0, -1.0)], [len(near), len(far)], axis=0)
    order = np.random.default_rng(2).permutation(len(both))

    def read(positions, normals):
        scene = tt.Scene()
        pad = scene.add_body(None, name="pad", fixed=True)
        scene.add_body(tt.Sphere(radius=6e-3), position=(1e-3, 0, TOP + 5.6e-3))
        scene.add_body(tt.Box(size=(4e-3, 4e-3, 4e-3)), position=(0, 1e-3, -TOP - 1.8e-3))
        model = tt.ElasticLayerTaxel(positions=positions, normals=normals, look_depth=2e-3)
        skin = scene.add_sensor(model, link=pad)
        sim = scene.build()
        sim.step()
        return skin.read()

    together = read(both[order], normals[order])
    for positions, normal, members in ((near, (0, 0, 1), order < len(near)), (far, (0, 0, -1), order >= len(near))):
        alone = read(positions, normal)
        offset = 0 if members[np.flatnonzero(order == 0)[0]] else len(near)
        assert alone.force.any()
        for one, other in zip(together, alone):
            scale = np.abs(other).max()
            np.testing.assert_allclose(one[members], other[order[members] - offset], atol=1e-3 * scale)


@pytest.mark.parametrize("quaternion", [(1, 0, 0, 0), (0.9, 0.1, 0.3, 0.2)])
def test_pressure_under_a_large_ball_is_smooth_in_float32(quaternion):
    """Hertz, 0.1 mm under a ball of 250 mm: every cell's overlap is a small difference of large numbers."""
    young, nu, radius, depth = 1e5, 0.45, 0.25, 1e-4
    patch = np.sqrt(radius * depth)
    positions = grid(96, 96, 2.4 * patch / 96)
    options = {"thickness": np.inf, "poisson_ratio": nu, "iterations": 50, "tolerance": 1e-5, "displacement": False}
    sim, ball, skin = scene_with(tt.Sphere(radius=radius), positions=positions, young_modulus=young, **options)
    pressure = press(sim, ball, skin, radius - depth, quaternion=quaternion).pressure
    away = np.hypot(positions[..., 0], positions[..., 1]) / patch
    peak = 2 * young / (1 - nu**2) * np.sqrt(depth / radius) / np.pi
    expected = peak * np.sqrt(np.maximum(1 - away**2, 0))
    assert np.abs(pressure - expected)[away < 0.9].max() < 2e-3 * peak


def bent(radius, shared_normal=False):
    """A pad of 12 x 16 taxels bent around y, its middle at the top of the pad; positions and normals."""
    flat = grid(12, 16, 1e-3)
    angle = flat[..., 0] / radius
    positions = np.stack([radius * np.sin(angle), flat[..., 1], TOP + radius * (np.cos(angle) - 1)], -1)
    normals = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], -1)
    return positions, (0.0, 0.0, 1.0) if shared_normal else normals


@pytest.mark.parametrize("radius", [1.0, 0.1, 0.03, 0.01])
def test_a_bent_skin_with_other_normals_is_refused_and_not_cut_into_strips(radius):
    positions, normals = bent(radius, shared_normal=True)
    with pytest.raises(SceneError, match=r"bent surface.*bend radius of \d+ m on"):
        scene_with(tt.Sphere(radius=5e-3), positions=positions, normals=normals)


def test_from_the_radius_that_is_named_on_a_bent_skin_reads_as_a_flat_one():
    forces = []
    for positions, normals in (bent(50.0), (grid(12, 16, 1e-3), (0, 0, 1))):
        sim, ball, skin = scene_with(tt.Sphere(radius=5e-3), positions=positions, normals=normals)
        forces.append(press(sim, ball, skin, 4.5e-3, x=4e-3).force)
    assert np.abs(forces[0] - forces[1]).max() < 5e-3 * np.abs(forces[1]).max()


def test_faces_that_meet_at_an_edge_are_pads_of_their_own():
    top = grid(8, 8, 1e-3).reshape(-1, 3)
    side = np.column_stack([np.full(64, 4.5e-3 + 5e-4), top[:, 1], TOP - 5e-4 - (top[:, 0] + 3.5e-3)])
    normals = np.repeat([(0, 0, 1.0), (1.0, 0, 0)], 64, axis=0)
    positions = np.concatenate([top, side])
    sim, ball, skin = scene_with(tt.Sphere(radius=5e-3), positions=positions, normals=normals)
    force = press(sim, ball, skin, 4.5e-3).force
    assert force[:64].any() and not force[64:].any()


@pytest.mark.parametrize(("device", "pads"), [("inspire_rh56dftp", 17), ("robotiq_tsf85", 2), ("xela_uskin", 1)])
def test_pads_of_real_hands_are_found(device, pads):
    import firmware_protocols
    from tactemu.sensors.layer.grid import layer_grids
    from tactemu.sensors.probe_layout import make_probes

    layout = firmware_protocols.device_class(device)().layout
    probes = make_probes(layout.positions, layout.normals, 1e-3, (0, 0, 0), (1, 0, 0, 0), device)
    grids = layer_grids(probes, 1, device)
    assert len(grids) == pads
    found = np.stack([grid.place for grid in grids])
    assert ((found >= 0).sum(axis=0) == 1).all()
    if pads > 1 and len(layout.patches) == pads:
        sizes = sorted(patch.rows * patch.cols for patch in layout.patches)
        assert sorted(int((grid.place >= 0).sum()) for grid in grids) == sizes
