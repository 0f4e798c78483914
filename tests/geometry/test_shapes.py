"""All shapes of the registry: one solid each, known to scene files and pages.

``python -m tests.geometry.test_shapes --write`` writes the table of shapes in docs/scene-files.md.
"""

import re
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

import tactemu as tt
from tactemu.base.errors import SceneError
from tactemu.geometry.shapes.registry import SHAPES, shape_class
from tactemu.scene import file, schema
from tactemu.scene.building import build_scene, make_devices
from tests.geometry.shape_contract import check_shape

DOCS = Path(__file__).parents[2] / "docs"
TABLE = re.compile(r"(<!-- shapes: [^\n]* -->\n\n).*?(\n<!-- end of shapes -->)", re.DOTALL)


def about_it(body: type) -> str:
    """The first sentence of a table's docstring, as Markdown."""
    return (body.__doc__ or "").splitlines()[0].replace("``", "`")


def table() -> str:
    """What ``[[body]]`` tables may hold, as Markdown."""
    rows = ["| shape | keys | description |", "| --- | --- | --- |"]
    for name, body in schema.SHAPES.items():
        keys = []
        for key, about in body.model_fields.items():
            if key not in schema.BodyTable.model_fields:
                default = "" if about.is_required() else f" ({about.default:g})"
                keys.append(f"`{key}`{default}: {about.description}")
        rows.append(f"| `{name}` | {'; '.join(keys) or 'none'} | {about_it(body)} |")
    return "\n".join(rows) + "\n"


def test_the_pages_name_every_shape():
    inside = TABLE.search((DOCS / "scene-files.md").read_text(encoding="utf-8"))
    assert inside, "docs/scene-files.md has lost the marks around its table of shapes"
    assert inside[0] == f"{inside[1]}{table()}{inside[2]}", "run: python -m tests.geometry.test_shapes --write"
    contact = (DOCS / "contact.md").read_text(encoding="utf-8")
    assert all(f"`{shape_class(name).__name__}`" in contact for name in SHAPES)


def ball_grid(radius: float, nodes: int = 41) -> tt.VoxelGrid:
    axis = np.linspace(-1.5 * radius, 1.5 * radius, nodes)
    values = np.linalg.norm(np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1), axis=-1) - radius
    return tt.VoxelGrid(values=values, origin=(axis[0],) * 3, cell=axis[1] - axis[0])


EXAMPLES = {
    "sphere": (tt.Sphere(radius=0.02), {}),
    "box": (tt.Box(size=(0.03, 0.02, 0.01)), {}),
    "capsule": (tt.Capsule(radius=0.008, length=0.02), {}),
    "cylinder": (tt.Cylinder(radius=0.01, length=0.02), {}),
    "plane": (tt.Plane(), {"has_points": False}),
    "mesh": (tt.Mesh(source=trimesh.creation.torus(0.014, 0.006, 32, 32)), {"tolerance": 1e-6, "ray_tolerance": 1e-4}),
    "voxel_grid": (ball_grid(0.015), {"has_points": False, "tolerance": 1e-4, "ray_tolerance": 5e-3}),
}


@pytest.mark.parametrize("name", SHAPES)
def test_all_that_a_shape_says_is_of_one_solid(name):
    shape, options = EXAMPLES[name]
    assert isinstance(shape, shape_class(name))
    check_shape(shape, 0.02, **options)


SKIN = """
[[body]]
name = "link"
shape = "frame"
[[body]]
name = "it"
shape = "{shape}"
{keys}
[[skin]]
device = "anyskin"
link = "link"
"""
KEYS = {
    "sphere": "radius = 0.02",
    "box": "size = [0.03, 0.02, 0.01]",
    "capsule": "radius = 0.008\nlength = 0.02",
    "cylinder": "radius = 0.01\nlength = 0.02",
    "plane": "",
    "mesh": 'path = "ring.stl"\nscale = 0.001',
    "voxel_grid": 'path = "ball.npz"',
}


def scene_of(name: str, folder):
    loaded = file.parse(SKIN.format(shape=name, keys=KEYS[name]), folder=folder)
    return build_scene(loaded, make_devices(loaded))[0]


@pytest.mark.parametrize("name", SHAPES)
def test_scene_files_have_every_shape(name, tmp_path):
    trimesh.creation.torus(14, 6, 32, 32).export(tmp_path / "ring.stl")
    grid = ball_grid(0.015)
    np.savez(tmp_path / "ball.npz", values=grid.values, origin=grid.origin, cell=grid.cell)
    shape = scene_of(name, tmp_path).body("it").shape
    assert type(shape) is shape_class(name)
    up = np.array((0, 0, 1.0))
    assert shape.reach("it", up) == pytest.approx(EXAMPLES[name][0].reach("it", up), abs=1e-6)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"no archive", "cannot read the grid"),
        ({"values": np.zeros((3, 3, 3)), "origin": np.zeros(3)}, "ball.npz lacks cell; it has values, origin"),
        ({"values": np.zeros((3, 3)), "origin": np.zeros(3), "cell": 1e-3}, "values must have shape"),
        ({"values": np.zeros((3, 3, 3)), "origin": np.zeros(2), "cell": 1e-3}, "origin must be 3 finite numbers"),
        ({"values": np.array([[["x", "y"]]]), "origin": np.zeros(3), "cell": 1e-3}, "values must be numbers"),
        ({"values": np.zeros((3, 3, 3)), "origin": np.zeros(3), "cell": np.ones(2)}, "cell must be > 0 m"),
    ],
)
def test_files_that_hold_no_grid_are_refused_in_one_sentence(content, says, tmp_path):
    path = tmp_path / "ball.npz"
    path.write_bytes(content) if isinstance(content, bytes) else np.savez(path, **content)
    with pytest.raises(SceneError, match=f"body 'it': .*{says}") as error:
        scene_of("voxel_grid", tmp_path)
    assert "\n" not in str(error.value)


def test_the_grid_of_a_file_that_is_not_there(tmp_path):
    with pytest.raises(SceneError, match=r"body 'it': path: cannot read the grid .*No such file"):
        scene_of("voxel_grid", tmp_path)


if __name__ == "__main__" and "--write" in sys.argv:
    page = DOCS / "scene-files.md"
    page.write_text(TABLE.sub(lambda found: f"{found[1]}{table()}{found[2]}", page.read_text(encoding="utf-8")))
