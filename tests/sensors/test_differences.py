"""Where Genesis is wrong: its number and ours, side by side. Keep docs/differences.md in step.

Genesis's numbers were read from genesis-world 1.4.5.
"""

import numpy as np
import pytest

import tactemu as tt
from tests.sensors.rig import depth_of, scene_with

MM = 1e-3


def test_depth_goes_on_beyond_the_radius():
    """Quirk 1: its raycast depth is 0 once a probe is deeper than its radius."""
    genesis = {1.9: 3.892, 2.1: 0.0, 3.0: 0.0}
    for indentation, theirs in genesis.items():
        for query in ("sdf", "raycast", "ray", "voxel"):
            ours = depth_of(
                tt.Sphere(radius=20 * MM), [[0, 0, 0]], 2 * MM, position=(0, 0, (20 - indentation) * MM),
                depth_query=query,
            )[0]  # fmt: skip
            assert ours / MM == pytest.approx(2 + indentation, abs=1e-4)
            assert (abs(ours / MM - theirs) < 0.01) == (indentation < 2)


def wedge(angle=30.0, height=10 * MM, width=40 * MM):
    half = height * np.tan(np.radians(angle / 2))
    x = width / 2
    vertices = [[-x, 0, 0], [x, 0, 0], [-x, -half, height], [x, -half, height], [-x, half, height], [x, half, height]]
    faces = [[0, 1, 3], [0, 3, 2], [0, 5, 1], [0, 4, 5], [2, 3, 5], [2, 5, 4], [0, 2, 4], [1, 5, 3]]
    return np.array(vertices), np.array(faces)


def test_outside_of_an_acute_edge_is_outside():
    """Quirk 2: from a single face normal its raycast takes probes outside a 30 degree wedge for inside."""
    y = np.linspace(-2, 2, 41) * MM
    points = np.stack([0 * y, y, np.full_like(y, -0.1 * MM)], -1)
    ours = depth_of(tt.Mesh(source=wedge()), points, 3 * MM)
    along = np.maximum(np.abs(y) * np.sin(np.radians(15)) - 0.1 * MM * np.cos(np.radians(15)), 0)
    exact = np.sqrt(y**2 + (0.1 * MM) ** 2 - along**2)
    assert np.abs(ours - (3 * MM - exact)).max() < 1e-8
    assert ours.max() < 3 * MM  # Genesis reads 5.1 to 5.8 mm here


def test_depth_does_not_end_at_a_grid():
    """Quirk 3: its distance grid ends 10 % beyond the object; 3 mm beside a box it reads 0 where 7 mm is right."""
    x = np.arange(21.0)
    exact = np.where(x <= 10, 10.1, 20.0 - x)
    exact[x > 10] = 10 - (x[x > 10] - 10)
    theirs = np.where(x < 13, exact, 0.0)
    points = np.stack([x * MM, 0 * x, 0 * x], -1)
    for query, tolerance in (("sdf", 2e-6), ("raycast", 2e-6), ("voxel", 0.1)):
        ours = depth_of(tt.Box(size=(20 * MM,) * 3), points, 10 * MM, position=(0, 0, 9.9 * MM), depth_query=query)
        assert np.abs(ours / MM - exact)[np.arange(21) != 10].max() < tolerance
        assert np.abs(ours / MM - theirs).max() > 6.9


def test_box_distances_are_exact():
    """Quirk 3, second half: its box is a grid of 32 nodes, up to 0.28 mm off. Ours is a closed form."""
    points = np.random.default_rng(0).uniform(-18, 18, (400, 3)) * MM
    half = np.array([15, 10, 12]) * MM
    q = np.abs(points) - half
    exact = np.maximum(3 * MM - np.linalg.norm(np.maximum(q, 0), axis=1) - np.minimum(q.max(1), 0), 0)
    ours = depth_of(tt.Box(size=2 * half), points, 3 * MM)
    assert np.abs(ours - exact).max() < 2e-9


def test_no_gate_jumps_at_first_touch():
    """Quirk 4: it reads 0 until the bodies touch, then the whole radius at once. Ours grows from 0."""
    genesis = {4.0: 0.0, 1.0: 0.0, 0.1: 0.0, -0.01: 5.01, -0.1: 5.1, -1.0: 6.0}
    for gap, theirs in genesis.items():
        ours = depth_of(tt.Sphere(radius=20 * MM), [[0, 0, 0]], 5 * MM, position=(0, 0, (20 + gap) * MM))[0] / MM
        assert ours == pytest.approx(5 - gap, abs=1e-4)
        assert (gap <= 0) == (ours == pytest.approx(theirs, abs=1e-3))


def test_no_reading_lags_a_step():
    """Quirk 4: its contact list is a step old, so a ball that is 1.5 mm inside still reads 0."""
    model = tt.ContactDepthProbe(positions=[[0, 0, 0]], radius=2 * MM)
    sim, ball, skin = scene_with(tt.Sphere(radius=20 * MM), model)
    for gap, theirs in ((-1.5, 0.0), (-3.5, 5.5), (-5.5, 7.5)):
        sim.set_pose(ball, position=(0, 0, (20 + gap) * MM), linear_velocity=(0, 0, -0.2))
        sim.step()
        ours = skin.read()[0] / MM
        assert ours == pytest.approx(2 - gap, abs=1e-4)
        assert (ours == pytest.approx(theirs, abs=1e-3)) == (gap < -2)


def test_speed_hides_no_probe():
    """Quirk 4: its boxes for culling are a step old; at 0.4 m/s a box loses its two leading probes."""
    x = np.linspace(-10, 10, 21) * MM
    points = np.stack([x, 0 * x, 0 * x], -1)
    model = tt.ContactDepthProbe(positions=points, radius=1e-6)
    sim, box, skin = scene_with(tt.Box(size=(9 * MM,) * 3), model)
    readings = []
    for speed in (0.0, 0.4):
        sim.set_pose(box, position=(0, 0, 3.5 * MM), linear_velocity=(speed, 0, 0))
        sim.step()
        readings.append(skin.read())
    assert np.array_equal(*readings) and (readings[0] > 0).sum() == 9


def test_two_fixed_bodies_touch():
    """Quirks 4 and 24: two fixed bodies make no contact in Genesis, and its probes read 0."""
    scene = tt.Scene()
    pad = scene.add_body(tt.Box(size=(0.08, 0.08, 0.02)), fixed=True)
    scene.add_body(tt.Sphere(radius=0.02), fixed=True, position=(0, 0, 0.027))
    skin = scene.add_sensor(tt.ContactDepthProbe(positions=[[0, 0, 0.01]], radius=2 * MM), link=pad)
    scene.build().step()
    assert skin.read()[0] == pytest.approx(5 * MM, abs=1e-8)


def test_a_thin_blade_goes_on_getting_deeper():
    """Quirk 17: to the closest surface a 2 mm blade is never deeper than 1 mm. Along the normal it is."""
    nearest_surface = {0.5: 0.5, 1.0: 1.0, 2.0: 1.0, 3.0: 1.0}  # Genesis's raycast; its sdf: 0.456 0.831 0.903 0.903
    blade = tt.Box(size=(2 * MM, 40 * MM, 20 * MM))
    for pressed, theirs in nearest_surface.items():
        where = {"position": (0, 0, (10 - pressed) * MM)}
        sdf = depth_of(blade, [[0, 0, 0]], 2 * MM, **where)[0] / MM - 2
        ray = depth_of(blade, [[0, 0, 0]], 2 * MM, **where, depth_query="ray")[0] / MM - 2
        assert sdf == pytest.approx(theirs, abs=1e-4)
        assert ray == pytest.approx(pressed, abs=1e-4)


def test_offsets_move_the_probes():
    """Quirk 10: pos_offset and euler_offset change nothing in Genesis."""
    points = np.array([[5 * MM, 0, 0], [0, 0, 0]])
    model = tt.ContactDepthProbe(positions=points, radius=2 * MM, position=(10 * MM, 0, 0), quaternion=(1, 0, 0, 1))
    sim, _ball, skin = scene_with(tt.Sphere(radius=20 * MM), model, position=(0, 0, 20 * MM))
    sim.step()
    moved = skin.read()
    by_hand = depth_of(
        tt.Sphere(radius=20 * MM), [[10 * MM, 5 * MM, 0], [10 * MM, 0, 0]], 2 * MM, position=(0, 0, 20 * MM)
    )
    assert np.allclose(moved, by_hand, atol=1e-9)
    assert not np.allclose(moved, depth_of(tt.Sphere(radius=20 * MM), points, 2 * MM, position=(0, 0, 20 * MM)))


def test_shear_acts_on_the_skin():
    """Quirk 16: its shear force acts on the object, its normal force on the skin."""
    options = {"positions": [[0, 0, 0]], "radius": 2 * MM, "shear_scalar": 1.0}
    forces = []
    for convention in ("genesis", "skin"):
        sim, ball, skin = scene_with(tt.Sphere(radius=0.02), tt.KinematicTaxel(**options, convention=convention))
        sim.set_pose(ball, position=(0, 0, 0.0199), linear_velocity=(0.5, 0, 0))
        sim.step()
        forces.append(skin.read().force[0])
    assert forces[0] == pytest.approx([-0.5, 0, -2.1], abs=1e-5)
    assert forces[1] == pytest.approx([0.5, 0, -2.1], abs=1e-5)
