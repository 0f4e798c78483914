"""The band beside a mesh: within its tolerance of the exact distance, never on the wrong side, and kept in a file."""

import itertools

import numpy as np
import pytest
import trimesh

import tactemu as tt
from tactemu.base import long_work
from tactemu.base.errors import SceneError
from tactemu.geometry.shapes import band_building, band_files
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


def table_row(mesh, cell=None):
    scene = tt.Scene()
    body = scene.add_body(tt.Mesh(source=mesh), name="tool")
    pad = scene.add_body(name="pad")
    model = tt.ContactDepthProbe(positions=[[0, 0, 0]], radius=1e-3, depth_query="band", voxel_size=cell)
    scene.add_sensor(model, link=pad)
    sim = scene.build()
    return sim._compiler._shapes.table((body,), "band", cell).rows[body.index]


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


@pytest.mark.parametrize(
    ("longest", "most"), [(5e-5, 5e-8), (5e-4, 5e-7), (2e-3, 2e-6), (0.04, 2e-6), (2.0, 2e-6), (20.0, 2e-5)]
)
def test_the_tolerance_is_a_share_of_small_and_of_large_bodies(longest, most):
    assert band_building.tolerance(longest) == pytest.approx(most)


@pytest.mark.parametrize(("name", "size"), [("torus", 0.02), ("box", 200.0)])
def test_small_and_large_bodies_agree_within_their_tolerance(name, size):
    mesh = MESHES[name]()
    mesh.apply_scale(size)
    longest = mesh.extents.max()
    rng = np.random.default_rng(2)
    at, faces = trimesh.sample.sample_surface(mesh, 4000, seed=0)
    points = at + rng.uniform(-2e-3, 2e-3, 4000)[:, None] * size * mesh.face_normals[faces]
    options = {"dtype": "float64", "voxel_size": longest / 32}
    exact, band = (
        depth_of(tt.Mesh(source=mesh), points, RADIUS * size, depth_query=query, **options) for query in ("sdf", "band")
    )
    most = band_building.tolerance(longest)
    apart = np.abs(band - exact)
    assert 0 < apart.max() <= most  # 0 everywhere if no cell of the band is in use


@pytest.fixture
def bands(tmp_path, monkeypatch):
    """The folder of bands, of this test alone; all bands are kept."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(band_building, "_KEPT_AFTER_S", 0.0)
    return tmp_path / "tactemu" / "bands"


def test_a_band_is_kept_and_found_by_its_mesh(bands, monkeypatch):
    first = table_row(MESHES["box"](), 1e-3).band
    (kept,) = bands.iterdir()
    with monkeypatch.context() as patch:
        patch.setattr(band_building, "_built", lambda *_: pytest.fail("it is not built again"))
        again = table_row(MESHES["box"](), 1e-3).band
    assert all(np.array_equal(getattr(first, name), getattr(again, name)) for name in ("nodes", "smooth", "origin"))
    kept.write_bytes(kept.read_bytes()[:1000])
    assert np.array_equal(table_row(MESHES["box"](), 1e-3).band.smooth, first.smooth), "a damaged file is built anew"
    table_row(trimesh.creation.box((0.02, 0.014, 0.009)), 1e-3)
    assert len(list(bands.iterdir())) == 2


def test_the_files_used_last_stay(bands, monkeypatch):
    monkeypatch.setattr(band_files, "MAX_BYTES", 1)
    for height in (0.006, 0.007):
        table_row(trimesh.creation.box((0.02, 0.014, height)), 1e-3)
    assert len(list(bands.iterdir())) == 1


def test_long_work_is_shown_and_announced(bands, monkeypatch, caplog):
    shown = []
    monkeypatch.setattr(long_work, "_displays", [lambda items, title, total: (shown.append((title, total)), items)[1]])
    monkeypatch.setattr(band_building, "_LONG_S", 0.0)
    table_row(MESHES["box"](), 1e-3)
    assert shown == [("band of 'tool': distances", 64), ("band of 'tool': comparing", 64)]
    assert "comparing a band with its 12 faces takes about" in caplog.text and str(bands) in caplog.text
    assert "'voxel' is built in a tenth" in caplog.text


def test_a_notice_says_what_is_built_and_what_is_kept(bands, caplog):
    said = []
    with long_work.notices_to(said.append):
        table_row(MESHES["box"](), 1e-3)
        table_row(MESHES["box"](), 1e-3)
    table_row(MESHES["box"](), 1e-3)
    assert len(said) == 2 and not caplog.text
    assert "its 12 faces takes about 1 s here" in said[0] and "(0 bands, 0 of at most 1024 MiB)" in said[0]
    assert "its band is kept in" in said[1] and "(1 bands" in said[1]


def test_ctrl_c_ends_the_work(bands, monkeypatch):
    def display(items, title, total):
        yield from itertools.islice(items, 3)
        raise KeyboardInterrupt

    monkeypatch.setattr(long_work, "_displays", [display])
    with pytest.raises(KeyboardInterrupt):
        table_row(MESHES["box"](), 1e-3)
    assert not bands.exists() or not list(bands.iterdir())
