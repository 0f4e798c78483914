"""The command line is light, and its help teaches."""

import re
import subprocess
import sys

import pytest

import firmware_protocols
from tactemu.cli.app import app
from tests.cli.command import ROOT, environment, here

COMMANDS = [command.name or command.callback.__name__ for command in app.registered_commands]
HEAVY = ("warp", "trimesh", "can", "numpy")


def test_help_imports_nothing_heavy():
    code = (
        "import sys; from tactemu.cli import main; sys.argv = ['tactemu', '--help']\n"
        "try: main()\nexcept SystemExit: pass\n"
        f"print('HEAVY', [m for m in {HEAVY} if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env=environment(),
        timeout=30,
        check=True,
    )
    assert done.stdout.splitlines()[-1] == "HEAVY []"
    for command in COMMANDS:
        assert command in done.stdout


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_shows_examples(command):
    done = here(command, "--help")
    assert done.returncode == 0
    assert f"    tactemu {command}" in done.stdout, "an example to copy"


def test_devices_lists_the_registry():
    done = here("devices")
    assert done.returncode == 0
    for name in firmware_protocols.names():
        assert name in done.stdout


def test_a_datasheet_has_everything():
    done = here("devices", "anyskin")
    for word in ("Wires", "Senses force", "Commands", "taxel  on wire", "Evidence", "Read by", "Sources", "Assumed"):
        assert word in done.stdout, word
    assert "1   0   2" in done.stdout, "the picture of the cross"


@pytest.mark.parametrize("arguments", [("run",), ("run", "anyskin", "--rte", "3"), ("nosuch",), ("explain",)])
def test_wrong_usage_exits_with_2(arguments):
    done = here(*arguments)
    assert done.returncode == 2
    assert done.stderr and not done.stdout


def test_version():
    done = here("--version")
    assert done.returncode == 0
    assert done.stdout.startswith("tactemu ")


def test_every_device_named_in_an_example_exists():
    text = "".join(here(command, "--help").stdout for command in ("run", "faults", "devices", "explain"))
    named = set(re.findall(r"tactemu (?:run|explain|devices) ([a-z_0-9]+)(?: |\n)", text))
    assert named and named <= {*firmware_protocols.names()}, named
