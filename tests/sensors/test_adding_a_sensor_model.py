"""docs/adding-a-sensor-model.md works as it stands: beside the installed package, and as a model of this tree."""

import shutil
from pathlib import Path

import pytest

from tests.pages import ROOT, copy_with, files_of, run, run_pytest

FILES = files_of(ROOT / "docs" / "adding-a-sensor-model.md")
HEADLESS = ("--port", "memory:", "--clock=virtual", "--seconds", "1", "--json")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A folder of a user with the page's file, test and scene."""
    folder = tmp_path_factory.mktemp("user")
    for name in ("pin_taxel.py", "test_pin_taxel.py", "pins.toml"):
        (folder / name).write_text(FILES[name])
    return folder


@pytest.fixture(scope="module")
def tree(tmp_path_factory) -> Path:
    """A copy of the package with the page's file and line."""
    folder = tmp_path_factory.mktemp("pins")
    tree = copy_with(
        folder, FILES, "tactemu/sensors/probes/pin_taxel.py", "tactemu/sensors/models.py", '    "proximity_taxel"'
    )
    shutil.copy(ROOT / "tests" / "sensors" / "test_models.py", tree)
    (tree / "pins.toml").write_text(FILES["pins.toml"].replace("pin_taxel.py:PinTaxel", "pin_taxel"))
    return tree


def test_a_user_s_own_model_passes_its_test(folder):
    assert "6 passed" in run_pytest(folder, "test_pin_taxel.py")


def test_a_scene_file_names_a_user_s_own_model(folder):
    assert '"event": "summary"' in run(folder, "-m", "tactemu", "run", "pins.toml", *HEADLESS)


def test_as_a_model_of_the_tree_it_passes_the_tests_of_all(tree):
    assert "4 passed" in run_pytest(tree, ".", "-k", "pin")


def test_a_scene_file_names_a_model_of_the_tree(tree):
    assert '"event": "summary"' in run(tree, "-m", "tactemu", "run", "pins.toml", *HEADLESS)


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
