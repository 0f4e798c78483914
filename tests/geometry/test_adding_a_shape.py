"""docs/adding-a-shape.md works as it stands: its file, its line and its test are all that a shape needs."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "adding-a-shape.md"


@pytest.fixture(scope="module")
def tree(tmp_path_factory) -> Path:
    """A copy of the package with the page's file, line, test and scene."""
    tree = tmp_path_factory.mktemp("ring")
    files = dict(re.findall(r"^```\w+ (\S+)\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), flags=re.M | re.S))
    shutil.copytree(ROOT / "tactemu", tree / "tactemu", ignore=shutil.ignore_patterns("__pycache__"))
    shapes = tree / "tactemu" / "geometry" / "shapes"
    (shapes / "torus.py").write_text(files["torus.py"])
    registry = (shapes / "registry.py").read_text()
    before = '    "plane"'
    assert registry.count(before) == 1
    (shapes / "registry.py").write_text(registry.replace(before, files["registry.py"] + before))
    for name in ("test_torus.py", "ring.toml"):
        (tree / name).write_text(files[name])
    return tree


def run(tree: Path, *words: str) -> str:
    """Output of Python in that tree."""
    environment = os.environ | {"PYTHONPATH": f"{tree}{os.pathsep}{ROOT}"}
    done = subprocess.run(
        [sys.executable, *words], cwd=tree, env=environment, capture_output=True, text=True, timeout=100, check=False
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]
    return done.stdout


def test_its_own_test_passes(tree):
    assert "3 passed" in run(tree, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:tactemu", "test_torus.py")


def test_a_scene_file_presses_with_it(tree):
    code = (
        "from tactemu.scene import file\n"
        "from tactemu.scene.building import build_scene, make_devices\n"
        "loaded = file.load('ring.toml')\n"
        "scene, _ = build_scene(loaded, make_devices(loaded))\n"
        "sim = scene.build()\n"
        "while sim.time_ns < 600_000_000:\n"
        "    sim.step()\n"
        "print((scene.sensors[0].read().force[..., 2] < 0).any())\n"
        "print(file.json_schema()['$defs']['TorusBody']['properties']['tube']['description'])\n"
    )
    pressed, described = run(tree, "-c", code).splitlines()[-2:]
    assert pressed == "True" and described == "radius of the tube, less than that of the circle [m]"
