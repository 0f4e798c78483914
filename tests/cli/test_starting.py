"""Something to start from: a new scene runs, and the examples come along."""

import pytest

from tactemu.base.errors import TactemuError
from tactemu.cli import new
from tactemu.scene.default import IDLE_S
from tactemu.scene.file import load
from tests.cli.command import ROOT


def test_a_new_scene_is_one_and_rests_at_first(tmp_path, capsys):
    file = tmp_path / "hand.toml"
    new.new(file)
    assert f"tactemu run {file}" in capsys.readouterr().out
    loaded = load(file)
    assert [skin.device for skin in loaded.tables.skin] == ["anyskin"]
    assert all(not motion.pose(IDLE_S - 0.01).position.any() for motion in loaded.motions.values())


def test_what_its_comments_offer_is_right(tmp_path):
    """Every key that is commented out, taken in."""
    lines = new.START.read_text().splitlines()
    offered = [line.removeprefix("# ") if _is_toml(line.removeprefix("# ")) else line for line in lines]
    (tmp_path / "hand.toml").write_text("\n".join(offered))
    tables = load(tmp_path / "hand.toml").tables
    (skin,) = tables.skin
    assert skin.port and skin.rate_hz and skin.faults and skin.clock.skew_ppm and skin.options["noise"]
    assert tables.scene.compute == "cuda:0" and len(tables.scenario) == 2


def _is_toml(text: str) -> bool:
    return text.startswith("[") or text.partition(" ")[2].startswith("= ")


WRONG = [("there.toml", "exists already"), ("hand.txt", "end in .toml"), ("no/x.toml", "cannot write it")]


@pytest.mark.parametrize(("name", "says"), WRONG)
def test_nothing_is_overwritten(tmp_path, name, says):
    (tmp_path / "there.toml").write_text("mine")
    with pytest.raises(TactemuError, match=says):
        new.new(tmp_path / name)
    assert (tmp_path / "there.toml").read_text() == "mine"


def test_examples_are_listed_with_what_they_show(capsys):
    new.examples()
    listed = capsys.readouterr().out
    for path in (ROOT / "examples").glob("*.[pt]*"):
        line = next(line for line in listed.splitlines() if line.startswith(path.name))
        assert len(line.split()) > 5


def test_examples_are_copied_once(tmp_path, capsys):
    new.examples(tmp_path / "a" / "b")
    copied = {path.name: path.read_text() for path in (tmp_path / "a" / "b").iterdir()}
    assert copied == {path.name: path.read_text() for path in (ROOT / "examples").iterdir() if path.name in copied}
    assert "hand.toml" in copied and len(copied) >= 5
    with pytest.raises(TactemuError, match="exists already"):
        new.examples(tmp_path / "a" / "b")
