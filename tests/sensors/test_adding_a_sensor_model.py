"""docs/adding-a-sensor-model.md works as it stands: its file, its line and its test are all that a model needs."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "adding-a-sensor-model.md"


@pytest.fixture(scope="module")
def tree(tmp_path_factory) -> Path:
    """A copy of the package with the page's file, line, test and scene."""
    tree = tmp_path_factory.mktemp("pins")
    files = dict(re.findall(r"^```\w+ (\S+)\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), flags=re.M | re.S))
    shutil.copytree(ROOT / "tactemu", tree / "tactemu", ignore=shutil.ignore_patterns("__pycache__"))
    (tree / "tactemu" / "sensors" / "probes" / "pin_taxel.py").write_text(files["pin_taxel.py"])
    registry = tree / "tactemu" / "sensors" / "models.py"
    before = '    "proximity_taxel"'
    assert registry.read_text().count(before) == 1
    registry.write_text(registry.read_text().replace(before, files["models.py"] + before))
    shutil.copy(ROOT / "tests" / "sensors" / "test_models.py", tree)
    for name in ("test_pin_taxel.py", "pins.toml"):
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


def test_its_own_test_and_those_of_all_models_pass(tree):
    out = run(tree, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:tactemu", ".", "-k", "pin")
    assert "10 passed" in out


def test_a_scene_file_runs_with_it(tree):
    out = run(
        tree, "-m", "tactemu", "run", "pins.toml", "--port", "memory:", "--clock=virtual", "--seconds", "1", "--json"
    )
    assert '"event": "summary"' in out


def test_tuner_benches_and_public_names_have_it(tree):
    code = (
        "import tactemu as tt\n"
        "from tactemu.tune.settings import settings_for\n"
        "from tactemu.tune.speed.physics import all_cases\n"
        "from tactemu.tune.trade.settings import ladder\n"
        "print(tt.PinTaxel.__name__, [s.name for s in settings_for('force') if s.model == 'pin_taxel'])\n"
        "print([c.title for c in all_cases('cpu') if 'Pin' in c.title])\n"
        "print([r.name for r in ladder() if 'pin' in r.name])\n"
    )
    assert run(tree, "-c", code).splitlines() == [
        "PinTaxel ['pin_taxel, nearest surface', 'pin_taxel, band', 'pin_taxel, voxels']",
        "['PinTaxel, 256 taxels']",
        "['L2 pin_taxel']",
    ]
