"""Which judges a run has, and that each test of one says what it is."""

import subprocess
from collections import Counter

import pytest

from tests import judging

ROOT = judging.ROOT
TEST = ROOT / "tests/drivers/test_ability_hand.py"
JUDGE = judging.Judge(devices=("ability_hand",), driver="ability-hand", carrier="serial, PPP")


OF_THE_EMULATOR = {
    # what these judge is no device, but faults, time and plugs
    "test_baud_and_plug.py", "test_environments.py", "test_replayed.py", "test_rig.py",
    "test_time_at_the_driver.py", "test_under_faults.py",
}  # fmt: skip


def test_judges_of_devices_are_marked():
    files = (ROOT / "tests/drivers").glob("test_*.py")
    unmarked = {path.name for path in files if "mark.judge(" not in path.read_text()}
    assert unmarked == OF_THE_EMULATOR, "mark its tests: pytest.mark.judge(device, driver=..., carrier=...)"


def test_one_judge_stands_for_a_carrier_and_fourteen_for_all(request):
    """Of the tests that this run has: all of them where it has no other choice."""
    judges = filter(None, map(judging.judge_of, request.session.items))
    standing = Counter(judge.carrier for judge in judges if judge.every_run)
    assert len(standing) <= 14 and set(standing.values()) <= {1}, standing


@pytest.mark.parametrize(
    ("changed", "run"),
    [
        ([], False),
        (["firmware_protocols/devices/ability_hand.py"], True),
        (["firmware_protocols/devices/anyskin.py", "firmware_protocols/framing.py"], False),
        (["tests/drivers/test_ability_hand.py"], True),
        (["tests/drivers/scripts/ability_hand_read.py"], True),
        (["tests/drivers/scripts/anyskin_read.py"], False),
    ],
)
def test_a_change_runs_the_judges_that_it_concerns(changed, run, monkeypatch):
    monkeypatch.setattr(judging, "changed_files", lambda: frozenset(changed))
    assert judging.is_run(JUDGE, TEST, "changed") == run


def test_a_device_has_the_files_that_it_imports():
    assert judging.files_of("paxini_gen2") == {
        "firmware_protocols/devices/paxini_gen2.py",
        "firmware_protocols/devices/paxini_modules.py",
    }


@pytest.mark.parametrize(
    ("device", "changed", "run"),
    [
        ("flexitac", [], False),
        ("flexitac", ["firmware_protocols/devices/flexitac.py"], True),
        ("flexitac", ["tests/test_judging.py"], True),
        ("flexitac", ["firmware_protocols/devices/anyskin.py"], False),
        (next(iter(judging.DEVICES)), [], True),
    ],
)
def test_a_long_test_of_each_device_tries_one_of_a_kind_and_those_that_changed(device, changed, run, monkeypatch):
    monkeypatch.setattr(judging, "changed_files", lambda: frozenset(changed))
    assert judging.is_tried(device, ROOT / "tests/test_judging.py") == run


def test_some_devices_stand_for_every_kind_of_line():
    assert 8 <= len(judging.standing()) <= 16


@pytest.mark.parametrize(("wanted", "run"), [("all", True), ("anyskin,ability_hand", True), ("anyskin", False)])
def test_judges_are_asked_for(wanted, run):
    assert judging.is_run(JUDGE, TEST, wanted) == run


@pytest.fixture
def repository(tmp_path, monkeypatch):
    """Two commits on main, of the files 0 and 1; ``commit(name)`` makes another."""
    monkeypatch.setattr(judging, "ROOT", tmp_path)
    for key, value in {"NAME": "a", "EMAIL": "a@example.org"}.items():
        monkeypatch.setenv(f"GIT_AUTHOR_{key}", value)
        monkeypatch.setenv(f"GIT_COMMITTER_{key}", value)

    def git(*words):
        subprocess.run(["git", "-c", "commit.gpgsign=false", *words], cwd=tmp_path, check=True, capture_output=True)

    def commit(name):
        (tmp_path / name).touch()
        git("add", name)
        git("commit", "-m", name)

    git("init", "-b", "main")
    commit("0")
    commit("1")
    return git, commit


def changed() -> set[str]:
    return set(judging.changed_files.__wrapped__())


def test_on_main_what_differs_from_the_commit_before_the_last(repository, tmp_path):
    assert changed() == {"1"}
    (tmp_path / "0").write_text("edited")
    (tmp_path / "new").touch()
    assert changed() == {"0", "1", "new"}


def test_on_a_branch_what_differs_from_where_it_left_main(repository):
    git, commit = repository
    git("checkout", "-b", "branch")
    commit("2")
    commit("3")
    git("checkout", "main")
    commit("on main")
    git("checkout", "branch")
    assert changed() == {"2", "3"}


def test_without_a_history_nothing_is_known_to_have_changed(tmp_path, monkeypatch):
    monkeypatch.setattr(judging, "ROOT", tmp_path)
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    assert changed() == set()
