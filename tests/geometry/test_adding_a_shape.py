"""docs/adding-a-shape.md works as it stands: beside the installed package, and as a shape of this tree."""

from pathlib import Path

import pytest

from tests.pages import ROOT, copy_with, files_of, run, run_pytest

FILES = files_of(ROOT / "docs" / "adding-a-shape.md")


@pytest.fixture(scope="module")
def tree(tmp_path_factory) -> Path:
    """A copy of the package with the page's file, line, test and scene."""
    folder = tmp_path_factory.mktemp("ring")
    shapes = "tactemu/geometry/shapes"
    tree = copy_with(folder, FILES, f"{shapes}/torus.py", f"{shapes}/registry.py", '    "plane"')
    (tree / "test_torus.py").write_text(FILES["test_torus.py"])
    (tree / "ring.toml").write_text(FILES["ring.toml"].replace("torus.py:Torus", "torus"))
    return tree


def test_a_user_s_own_shape_is_pressed(tmp_path):
    for name in ("torus.py", "ring.py"):
        (tmp_path / name).write_text(FILES[name])
    assert run(tmp_path, "ring.py").splitlines()[-1] == "0.003000"


def test_its_own_test_passes(tree):
    assert "3 passed" in run_pytest(tree, "test_torus.py")


def test_a_scene_file_presses_with_it(tmp_path, tree):
    for name in ("torus.py", "ring.toml"):
        (tmp_path / name).write_text(FILES[name])
    for folder in (tmp_path, tree):
        assert run(folder, "-c", PRESS).splitlines()[-1] == "True"


def test_the_schema_describes_its_keys(tree):
    code = "from tactemu.scene import file; print(file.json_schema()['$defs']['TorusBody']['properties']['tube'])"
    assert "radius of the tube, less than that of the circle [m]" in run(tree, "-c", code)


PRESS = (
    "from tactemu.scene import file\n"
    "from tactemu.scene.building import build_scene, make_devices\n"
    "loaded = file.load('ring.toml')\n"
    "scene, _ = build_scene(loaded, make_devices(loaded))\n"
    "sim = scene.build()\n"
    "while sim.time_ns < 600_000_000:\n"
    "    sim.step()\n"
    "print((scene.sensors[0].read().force[..., 2] < 0).any())\n"
)
