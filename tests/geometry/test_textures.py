"""Textures: distances and places of entry against heights in closed form, and the pressures of a rough face."""

import numpy as np
import pytest
import trimesh

import tactemu as tt
from tactemu.scene.file import parse
from tactemu.sensors.layer.compliance import transfer

WAVES = tt.HeightSpectrum(amplitudes=(1e-4, 5e-5), wavelengths=(5e-3, 2e-3), seed=3)
BOX = tt.Box(size=(0.04, 0.04, 0.02))
UP = (0, 0, 0.01)
"""A pose in which the box's lower face is at z = 0."""


def wave_heights(texture, u, v):
    return sum(w[3] * np.cos(2 * np.pi * (u * w[0] + v * w[1] + w[2])) for w in texture.row.values)


def depths(shape, points, texture, *, radius=0.002, dtype="float32", pose=(UP, (1, 0, 0, 0)), **options):
    scene = tt.Scene(dt=1e-3)
    link = scene.add_body(None, fixed=True, name="link")
    body = scene.add_body(shape, name="body", texture=texture)
    sensor = scene.add_sensor(tt.ContactDepthProbe(positions=points, radius=radius, **options), link=link)
    sim = scene.build(dtype=dtype)
    sim.set_pose(body, position=pose[0], quaternion=pose[1])
    sim.step()
    return sensor.read().astype(float)


def places(count=60, height=1e-3):
    rng = np.random.default_rng(5)
    return np.column_stack([rng.uniform(-0.01, 0.01, (count, 2)), rng.uniform(-height, height, count)])


@pytest.mark.parametrize(("dtype", "tolerance"), [("float32", 2e-9), ("float64", 1e-10)])
@pytest.mark.parametrize("query", [{}, {"depth_query": "ray", "ray_reach": 0.05}], ids=["nearest", "ray"])
def test_the_depth_in_a_flat_face_grows_by_the_height(query, dtype, tolerance):
    points = places()
    expected = 0.002 + points[:, 2] + wave_heights(WAVES, points[:, 0], points[:, 1])
    felt = depths(BOX, points, WAVES, dtype=dtype, **query)
    assert np.abs(felt - np.maximum(expected, 0)).max() < tolerance


@pytest.mark.parametrize(
    "query",
    [
        {},
        {"depth_query": "ray", "ray_reach": 0.05},
        {"depth_query": "band"},
        {"depth_query": "voxel", "voxel_size": 5e-4},
    ],
    ids=["nearest", "ray", "band", "voxel"],
)
def test_meshes_and_their_grids_have_textures(query):
    points = places()
    box = depths(BOX, points, WAVES, **({} if query.get("depth_query") != "ray" else query))
    mesh = depths(tt.Mesh(source=trimesh.creation.box(BOX.size)), points, WAVES, **query)
    assert np.abs(mesh - box).max() < (2e-6 if query else 5e-8)


def test_a_line_at_an_angle_enters_where_it_meets_the_texture():
    """The error is of second order: two heights are computed where a slope of 0.28 would need a root."""
    tilt = np.deg2rad(30)
    points = places(height=0) - np.array([0, 0, 2e-3])
    normals = np.broadcast_to([np.sin(tilt), 0, np.cos(tilt)], points.shape)
    felt = 0.01 - depths(BOX, points, WAVES, radius=0.01, normals=normals, depth_query="ray", ray_reach=0.05)
    s = np.linspace(0, 6e-3, 60001)[:, None]
    x, z = points[:, 0] + s * np.sin(tilt), points[:, 2] + s * np.cos(tilt)
    inside = z > -wave_heights(WAVES, x, points[:, 1])
    exact = s[inside.argmax(axis=0), 0]
    slope, peak = 0.28, 1.5e-4
    assert np.abs(felt - exact).max() < (slope * np.tan(tilt)) ** 2 * peak / np.cos(tilt)
    without = s[(z > 0).argmax(axis=0), 0]
    assert np.abs(without - exact).max() > 5 * np.abs(felt - exact).max()


def test_a_map_repeats_and_is_linear_between_its_samples():
    n, wavelength = 32, 2e-3
    cell = wavelength / n
    wave = tt.HeightSpectrum(amplitudes=(1e-4,), wavelengths=(wavelength,), angles=(0.0,), phases=(0.0,))
    heights = np.repeat(np.cos(2 * np.pi * np.arange(n) / n)[:, None], 3, axis=1)
    points = places()
    felt = depths(BOX, points, tt.HeightMap(heights=heights, cell=cell, scale=1e-4))
    assert np.abs(felt - depths(BOX, points, wave)).max() < 5 / n**2 * 1e-4
    on_sample = np.array([[3 * cell, 0, 0], [3 * cell - 5 * wavelength, cell, 0]])
    np.testing.assert_allclose(
        depths(BOX, on_sample, tt.HeightMap(heights=heights, cell=cell, scale=1e-4)),
        0.002 + 1e-4 * heights[3, 0], atol=2e-9,
    )  # fmt: skip


def test_a_textured_ball_turns_with_its_texture():
    texture = tt.HeightSpectrum(amplitudes=(2e-4,), wavelengths=(4e-3,), angles=(0.0,), phases=(0.0,))
    ball = tt.Sphere(radius=0.01)
    point = np.array([[0.0, 0.0, 0.0]])
    up = np.array([np.cos(np.pi / 8), np.sin(np.pi / 8), 0, 0])  # 45 degrees about x: the two lower axes share
    lowest = depths(ball, point, texture, pose=((0, 0, 0.01), (1, 0, 0, 0)))
    turned = depths(ball, point, texture, pose=((0, 0, 0.01), up))
    n = np.array([0, -1, -1]) / np.sqrt(2)
    x = 0.01 * n
    share = 0.5 * np.cos(2 * np.pi * x[2] / 4e-3) + 0.5 * np.cos(2 * np.pi * x[0] / 4e-3)
    assert lowest[0] == pytest.approx(0.002 + 2e-4, abs=1e-8)
    assert turned[0] == pytest.approx(0.002 + 2e-4 * share, abs=1e-7)


@pytest.mark.parametrize("thickness", [2e-3, 6e-3])
def test_the_pressures_of_a_rough_face_are_those_of_the_layer_in_closed_form(thickness):
    """In full contact a wave of height a adds a pressure of amplitude a / C(k), C the layer's compliance."""
    height, wavelength, cells, pitch = 1e-5, 4e-3, 64, 5e-4
    young, nu = 1e5, 0.45
    texture = tt.HeightSpectrum(amplitudes=(height,), wavelengths=(wavelength,), angles=(0.0,), phases=(0.3,))
    x = (np.arange(cells) - (cells - 1) / 2) * pitch
    positions = np.stack([*np.meshgrid(x, x, indexing="ij"), np.zeros((cells, cells))], axis=-1)
    options = {"young_modulus": young, "poisson_ratio": nu, "thickness": thickness, "friction": 0.0}

    def pressures(texture):
        scene = tt.Scene(dt=1e-3)
        pad = scene.add_body(None, fixed=True, name="pad")
        body = scene.add_body(tt.Box(size=(0.1, 0.1, 0.02)), name="board", texture=texture)
        model = tt.ElasticLayerTaxel(positions=positions, radius=pitch / 2, iterations=400, tolerance=1e-6, **options)
        sensor = scene.add_sensor(model, link=pad)
        sim = scene.build(dtype="float64")
        sim.set_pose(body, position=(0, 0, 0.01 - 2e-4))
        sim.step()
        return sensor.read().pressure

    added = pressures(texture) - pressures(None)
    middle = added[16:48, 32]  # two wavelengths
    found = np.abs(np.sum(middle * np.exp(2j * np.pi * x[16:48] / wavelength))) * 2 / 32
    k = 2 * np.pi / wavelength
    shear = young / (2 * (1 + nu))
    assert found == pytest.approx(height * shear * k / float(transfer(k * thickness, nu).nn), rel=0.02)


SCENE = """
[[body]]
name = "pad"
shape = "box"
size = [0.04, 0.04, 0.02]
fixed = true
[[body]]
name = "board"
shape = "box"
size = [0.04, 0.04, 0.02]
position = [0, 0, 0.019]
texture = {texture}
[[skin]]
device = "anyskin"
link = "pad"
position = [0, 0, 0.01]
"""


def test_scene_files_have_textures(tmp_path):
    from tactemu.scene.building import build_scene, make_devices

    np.save(tmp_path / "cloth.npy", np.eye(4))
    (tmp_path / "scene.toml").write_text("")
    for text in (
        '{ kind = "map", path = "cloth.npy", cell = 1e-4, scale = 2e-5 }',
        '{ kind = "spectrum", amplitudes = [1e-5], wavelengths = [1e-3], seed = 4 }',
    ):
        loaded = parse(SCENE.replace("{texture}", text), folder=tmp_path)
        scene, _ = build_scene(loaded, make_devices(loaded))
        assert scene.body("board").texture.row.peak in (2e-5, 1e-5)
    with pytest.raises(tt.SceneError, match=r"'board'.*cannot read it"):
        loaded = parse(SCENE.replace("{texture}", '{ kind = "map", path = "no.npy", cell = 1e-4 }'), folder=tmp_path)
        build_scene(loaded, make_devices(loaded))
    with pytest.raises(tt.SceneError, match="unknown key 'amplitude'"):
        parse(SCENE.replace("{texture}", '{ kind = "spectrum", amplitude = 1, wavelengths = [1] }'))


def test_pictures_are_heights(tmp_path):
    image = pytest.importorskip("PIL.Image")
    brightness = np.array([[0, 255], [51, 102]], np.uint8)
    image.fromarray(brightness).save(tmp_path / "cloth.png")
    row = tt.HeightMap(heights=tmp_path / "cloth.png", cell=1e-4, scale=1e-3).row
    np.testing.assert_allclose(row.values, brightness / 255e3)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: tt.HeightMap(heights=np.zeros(4), cell=1e-3), "shape"),
        (lambda: tt.HeightMap(heights=np.array([[np.nan]]), cell=1e-3), "finite"),
        (lambda: tt.HeightMap(heights=np.zeros((2, 2)), cell=0.0), "cell"),
        (lambda: tt.HeightSpectrum(amplitudes=(1e-4,), wavelengths=(0.0,)), "wavelengths"),
        (lambda: tt.HeightSpectrum(amplitudes=(1e-4,), wavelengths=(1e-3, 2e-3)), "one number for each"),
        (lambda: tt.HeightSpectrum(amplitudes=(), wavelengths=()), "1 to 256"),
        (lambda: tt.Scene(dt=1e-3).add_body(None, texture=WAVES), "on a body with a shape"),
        (lambda: tt.Scene(dt=1e-3).add_body(BOX, texture="cloth.png"), "HeightMap, HeightSpectrum"),
    ],
)
def test_wrong_textures_are_refused(make, message):
    with pytest.raises(tt.SceneError, match=message):
        make()


def test_files_that_are_no_heights_or_too_many_are_refused_before_they_are_read(tmp_path):
    np.lib.format.open_memmap(tmp_path / "large.npy", mode="w+", dtype=np.float32, shape=(100_000, 20_000))
    np.savez(tmp_path / "several.npz", a=np.zeros(3))
    (tmp_path / "text.npy").write_text("no array")
    for name, says in (
        ("large", "16777216 samples"),
        ("several", "no array"),
        ("text", "no array"),
        ("none", "No such"),
    ):
        path = next(tmp_path.glob(f"{name}.*"), tmp_path / "none.npy")
        with pytest.raises(tt.SceneError, match=says):
            tt.HeightMap(heights=path, cell=1e-4)
