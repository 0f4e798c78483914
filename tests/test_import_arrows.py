"""The tree: the folders there are, who may import whom (`[tool.importlinter]` in pyproject.toml), what stays light."""

import ast
import importlib
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from firmware_protocols.registry import DEVICES
from tactemu.base.formats import FORMATS
from tactemu.geometry.shapes.registry import SHAPES
from tactemu.scene.engine_tables import ENGINES
from tactemu.sensors.models import MODELS
from tactemu.transducers.registry import TRANSDUCERS

ROOT = Path(__file__).parents[1]
ROOMS = set(
    "base plan geometry imperfections transducers sensors scene engines transports wire truth emulator control session "
    "tune datasets fit view judge exec integrations envs cli".split()
)
FACES = {"tactemu", "tactemu.envs", "tactemu.models", "tactemu.devices"}
FILES = {"__init__.py", "__init__.pyi", "__main__.py", "version.py", "models.py", "devices.py", "py.typed"}
"""Every file beside the folders; three of them are faces."""


def test_imports_point_down():
    command = [sys.executable, "-c", "from importlinter.cli import lint_imports_command as c; c(['--no-cache'])"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]


def test_the_folders_are_those_of_the_picture():
    here = (ROOT / "tactemu").iterdir()
    assert {path.name for path in here if path.is_file() or any(path.glob("**/*.py"))} == ROOMS | FILES


def test_no_file_of_the_packages_imports_a_face():
    """``import tactemu`` inside the package would be a way to everything, past the layers."""
    for package in ("tactemu", "firmware_protocols"):
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                assert not imports_a_face(node), f"{path.relative_to(ROOT)}:{node.lineno}"


def imports_a_face(node: ast.AST) -> bool:
    """Return True for ``import FACE``, ``from FACE import name`` and ``from tactemu import models``."""
    match node:
        case ast.Import(names=names):
            return any(alias.name in FACES for alias in names)
        case ast.ImportFrom(module="tactemu", names=names):
            return not {alias.name for alias in names} <= ROOMS
        case ast.ImportFrom(module=str() as module):
            return module in FACES
    return False


@pytest.mark.parametrize(
    "code", ["import tactemu", "import tactemu.models", "from tactemu import models", "from tactemu.devices import x"]
)
def test_an_import_of_a_face_is_found(code):
    assert imports_a_face(ast.parse(code).body[0])


PARTS = {
    f"{each.name} {role}": part
    for each in FORMATS.values()
    for role in ("reader", "log_writer", "converter")
    if (part := getattr(each, role))
}
OPENERS = {name: table.opener for name, table in ENGINES.items()}
NAMED = {**MODELS, **SHAPES, **OPENERS, **PARTS, **TRANSDUCERS, **DEVICES}
SCRIPTS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
ENTRIES = {
    **SCRIPTS["scripts"],
    **{name: entry for group in SCRIPTS["entry-points"].values() for name, entry in group.items()},
}


@pytest.mark.parametrize("name", [*NAMED, *ENTRIES])
def test_what_is_named_by_a_string_is_there(name):
    module, _, attribute = {**NAMED, **ENTRIES}[name].partition(":")
    found = importlib.import_module(module)
    assert not attribute or hasattr(found, attribute)


def test_paths_that_pages_and_settings_name_are_there():
    pages = [ROOT / name for name in ("pyproject.toml", "action.yml", "README.md", "CONTRIBUTING.md", "mkdocs.yml")]
    pages += [page for page in (ROOT / "docs").rglob("*.md") if page.name not in ("assumed.md", "judges.md")]
    wanting = []
    for page in pages:
        for path in PATH.findall(page.read_text()):
            if not [*ROOT.glob(f"{path}*")] and path not in MADE:
                wanting.append(f"{page.relative_to(ROOT)}: {path}")
    assert not wanting


PATH = re.compile(r"(?<![\w./-])((?:tactemu|firmware_protocols|scripts|benchmarks)/[a-z_\d./-]*\w)\b(?!\w)")
MADE = {"tactemu/examples", "tactemu/docs", "tactemu/scripts/vcan-run", "tactemu/scripts/uml-xstate.c", "tactemu/msg"}
"""Paths that only a wheel has, and a package of ROS messages."""


@pytest.mark.parametrize("statement", ["import firmware_protocols", "import tactemu"])
def test_imports_stay_light(statement):
    code = f"import sys; {statement}; print([m for m in ('warp', 'trimesh', 'can') if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert out.stdout.strip() == "[]"


def test_the_command_line_starts_without_the_optional_parts():
    """``scripts/core-wheel`` leaves these folders out of a wheel, whose command still has to run what remains."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    absent = next(each for each in contracts if each["id"] == "optional")["forbidden_modules"]
    code = f"import sys; sys.modules |= dict.fromkeys({absent}); import tactemu.cli.app"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)
