"""The band beside a mesh: within 2 µm of the exact distance, and never on the wrong side."""

import numpy as np
import pytest
import trimesh

import tactemu as tt
from tactemu.base.errors import SceneError
from tactemu.geometry.shapes.band import BAND
from tests.geometry.test_meshes import sharp_cone
from tests.sensors.rig import depth_of

RADIUS = 0.04
"""Of the probe [m]: it is in reach of all of each mesh."""
QUICK = "torus", "box"


def bumpy():
    """A ball with hollows."""
    ball = trimesh.creation.icosphere(4)
    factor = 1 + 0.3 * np.sin(4 * ball.vertices[:, :1]) * np.cos(3 * ball.vertices[:, 1:2])
    return trimesh.Trimesh(0.008 * ball.vertices * factor, ball.faces, process=False)


MESHES = {
    "ball": lambda: trimesh.creation.icosphere(4, radius=0.01),
    "torus": lambda: trimesh.creation.torus(0.01, 0.004, 64, 48),
    "box": lambda: trimesh.creation.box((0.02, 0.014, 0.008)),
    "cylinder": lambda: trimesh.creation.cylinder(0.006, 0.02, sections=48),
    "cone": lambda: trimesh.Trimesh(0.02 * sharp_cone().vertices, sharp_cone().faces, process=False),
    "bumpy": bumpy,
}


def points_around(mesh, n: int = 6000) -> np.ndarray:
    """Everywhere, near the surface and at it."""
    rng = np.random.default_rng(0)
    low, high = mesh.bounds
    where = rng.uniform(low - 0.004, high + 0.004, (n, 3))
    at, faces = trimesh.sample.sample_surface(mesh, 2 * n, seed=0)
    off = np.concatenate([rng.uniform(-2e-3, 2e-3, n), rng.uniform(-2e-5, 2e-5, n)])
    return np.concatenate([where, at + off[:, None] * mesh.face_normals[faces]])


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in QUICK else (pytest.mark.nightly,)) for name in MESHES]
)
def test_within_two_micrometres_and_on_the_right_side(name):
    mesh = MESHES[name]()
    points, shape = points_around(mesh), tt.Mesh(source=mesh)
    exact = RADIUS - depth_of(shape, points, RADIUS)
    band = RADIUS - depth_of(shape, points, RADIUS, depth_query="band")
    np.testing.assert_allclose(band, exact, atol=2e-6)
    clear = np.abs(exact) > 1e-8  # as far as float32 of the points goes
    np.testing.assert_array_equal(np.sign(band[clear]), np.sign(exact[clear]))


def test_what_is_near_a_smooth_surface_is_interpolated():
    row = table_row(MESHES["torus"]())
    centre = np.array(row.band.origin) + row.band.cell * (np.argwhere(np.ones(row.band.smooth.shape)) + 0.5)
    away = np.hypot(np.hypot(centre[:, 0], centre[:, 1]) - 0.01, centre[:, 2]) - 0.004
    assert row.kind is BAND
    assert row.band.smooth.reshape(-1)[np.abs(away) < 0.002].mean() > 0.1  # of so coarse a mesh


def table_row(mesh):
    scene = tt.Scene()
    body = scene.add_body(tt.Mesh(source=mesh), name="tool")
    pad = scene.add_body(name="pad")
    model = tt.ContactDepthProbe(positions=[[0, 0, 0]], radius=1e-3, depth_query="band")
    scene.add_sensor(model, link=pad)
    sim = scene.build()
    return sim._compiler._shapes.table((body,), "band").rows[body.index]


def test_normals_are_those_of_the_surface():
    """What springs read of a ring that is pressed in."""
    grid = np.stack([*np.meshgrid(*[np.linspace(-14e-3, 14e-3, 15)] * 2), np.zeros((15, 15))], -1)
    found = {}
    for query in ("sdf", "band"):
        scene = tt.Scene()
        pad = scene.add_body(name="pad")
        scene.add_body(tt.Mesh(source=MESHES["torus"]()), name="tool", position=(0.4e-3, 0.2e-3, 3.5e-3))
        model = tt.KinematicTaxel(positions=grid, radius=1.5e-3, depth_query=query)
        skin = scene.add_sensor(model, link=pad)
        scene.build().step()
        found[query] = skin.read().force
    largest = np.abs(found["sdf"]).max()
    assert largest > 0.1
    turned = np.sin(np.pi / 64)  # half the angle of neighbouring faces: from one to the other the band passes smoothly
    np.testing.assert_allclose(found["band"], found["sdf"], atol=turned * largest)


def test_of_shapes_that_need_no_band_it_is_the_exact_distance():
    points = points_around(MESHES["ball"](), 300)
    opened = trimesh.Trimesh(*(lambda m: (m.vertices, m.faces[:-40]))(MESHES["ball"]()), process=False)
    for shape in (tt.Sphere(radius=0.01), tt.Box(size=(0.01, 0.02, 0.01)), tt.Mesh(source=opened)):
        exact, band = (depth_of(shape, points, RADIUS, depth_query=query) for query in ("sdf", "band"))
        np.testing.assert_array_equal(band, exact)


@pytest.mark.parametrize(("cell", "said"), [(0.0, "voxel_size must be > 0"), (1e-6, "take a larger cell")])
def test_cells_that_cannot_be(cell, said):
    with pytest.raises(SceneError, match=said):
        depth_of(tt.Mesh(source=MESHES["box"]()), [[0, 0, 0]], RADIUS, depth_query="band", voxel_size=cell)
