"""Environments of their own are what their locks say."""

import pytest

from tests.drivers import environments

NAMES = sorted(path.stem for path in environments.LOCKS.glob("*.txt"))


@pytest.mark.parametrize("name", NAMES)
def test_every_package_is_pinned(name):
    assert environments.locked(name)


@pytest.mark.parametrize("line", ["six", "six>=1.17", "six==*", "six=="])
def test_a_loose_line_is_named(line, tmp_path, monkeypatch):
    monkeypatch.setattr(environments, "LOCKS", tmp_path)
    (tmp_path / "loose.txt").write_text(f"pyserial==3.5  # the port\n\n{line}\n")
    with pytest.raises(ValueError, match=r"loose\.txt: pin six"):
        environments.locked("loose")


def test_another_lock_is_another_environment_and_each_is_made_once(tmp_path, monkeypatch):
    made = []

    def make(folder, requirements):
        made.append(requirements)
        folder.mkdir()
        (folder / "made").touch()

    monkeypatch.setattr(environments, "LOCKS", tmp_path)
    monkeypatch.setattr(environments, "FOLDER", tmp_path / "made")
    monkeypatch.setattr(environments, "_make", make)
    pythons = []
    for version in ("1.16.0", "1.17.0", "1.16.0"):
        (tmp_path / "small.txt").write_text(f"six=={version}\n")
        pythons.append(environments.python_with("small"))
    assert pythons[0] == pythons[2] != pythons[1]
    assert made == [["six==1.16.0"], ["six==1.17.0"]]
