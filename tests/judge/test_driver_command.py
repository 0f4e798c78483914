"""Tests of the driver's command: where its port stands, and what is said if nothing tells it the port."""

import subprocess
import sys

import pytest

from tactemu.base.errors import TactemuError
from tactemu.judge.driver import check_finds_port, command_of


@pytest.mark.parametrize(
    "command",
    [
        ["python", "driver.py", "{port}"],
        ["./hand", "{left}", "{right}"],
        ["sh", "-c", "cat $TACTEMU_PORT"],
        ["env", "PORT={port}", "python", "driver.py"],
        ["python", "own.py"],
    ],
)
def test_a_command_that_finds_its_port_passes(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.py").write_text("import os\nopen(os.environ['TACTEMU_PORT'])\n")
    check_finds_port(command)


def test_a_command_to_which_nothing_tells_the_port_is_refused(tmp_path):
    (tmp_path / "driver.py").write_text("print(1)\n")
    with pytest.raises(TactemuError, match="does not have"):
        check_finds_port([sys.executable, str(tmp_path / "driver.py")])
    command = [sys.executable, "-m", "tactemu", "judge", "optoforce", "--", "python", str(tmp_path / "driver.py")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and "write {port}" in done.stderr, done.stderr


def test_an_unknown_placeholder_is_refused_with_those_that_there_are():
    port = "; did you mean 'port'?"
    for ports, near, offered in (
        ({"skin": "/dev/pts/1"}, port, "{port}"),
        ({"skin": "socketcan:can0"}, port, "{port}, {interface}, {channel}"),
        ({"left": "/dev/pts/1", "right": "/dev/pts/2"}, "", "{left}, {right}"),
    ):
        with pytest.raises(TactemuError) as error:
            command_of(["driver", "{prt}"], ports)
        assert str(error.value) == f"{{prt}} in the driver's command is no placeholder{near}; expected {offered}"
    awk = ["sh", "-c", "./driver /dev/pts/1 | awk '{print}'"]
    assert command_of([*awk, "{port}"], {"skin": "/dev/pts/1"}) == [*awk, "/dev/pts/1"]
    assert command_of(["sh", "-c", "cat $TACTEMU_PORT | awk {print}"], {"skin": "/dev/pts/1"})
