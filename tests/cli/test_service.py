"""``tactemu service``: a unit of systemd is written, started, and removed without a trace; each step is printed."""

import os
import pwd
import shutil
import subprocess

import pytest

from tactemu.cli import service
from tactemu.transports.can_link import CanLink
from tests.cli.command import here

PORT = "serial:by-id/usb-FTDI"


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """A folder of units, and a systemctl that notes its calls and fails where a file says so."""
    units, programs = tmp_path / "units", tmp_path / "bin"
    units.mkdir()
    programs.mkdir()
    (programs / "systemctl").write_text(
        f'#!/bin/sh\necho "$@" >>{tmp_path}/calls\n[ ! -e {tmp_path}/fails ] || [ "$1" != enable ]\n'
    )
    (programs / "systemctl").chmod(0o755)
    monkeypatch.setenv("PATH", f"{programs}:{os.environ['PATH']}")
    monkeypatch.setattr(service, "UNITS", units)
    return tmp_path


def calls(machine):
    log = machine / "calls"
    said = log.read_text().splitlines() if log.exists() else []
    log.unlink(missing_ok=True)
    return said


def test_a_service_is_installed_and_removed_without_a_trace(machine):
    done = here("service", "install", "anyskin", "--port", PORT, "--rate", "200")
    assert done.returncode == 0, done.stderr
    text = (machine / "units/tactemu-anyskin.service").read_text()
    assert f"-m tactemu run anyskin --port {PORT} --rate 200\n" in text and "Restart=always" in text
    assert f"User={pwd.getpwuid(os.getuid()).pw_name}\n" in text
    assert calls(machine) == ["daemon-reload", "enable --now tactemu-anyskin.service"]
    assert "systemctl enable --now tactemu-anyskin.service" in done.stdout and "ExecStart=" in done.stdout
    assert "no service 'anyskn'; did you mean 'anyskin'? (" in here("service", "remove", "anyskn").stderr
    assert here("service", "remove", "tactemu-anyskin").returncode == 0
    assert calls(machine) == ["disable --now tactemu-anyskin.service", "daemon-reload"]
    assert not list((machine / "units").iterdir())


def test_a_dry_run_is_a_script_that_does_the_same(machine):
    words = ("service", "install", "anyskin", "--port", PORT, "--unit", "left hand".replace(" ", "-"))
    script = here(*words, "--dry-run").stdout
    assert not calls(machine) and not list((machine / "units").iterdir())
    subprocess.run(["sh", "-c", script], check=True)
    by_script, called = (machine / "units/tactemu-left-hand.service").read_text(), calls(machine)
    here(*words)
    assert (machine / "units/tactemu-left-hand.service").read_text() == by_script and calls(machine) == called
    removed = here("service", "remove", "left-hand", "--dry-run").stdout
    subprocess.run(["sh", "-c", removed], check=True)
    assert not list((machine / "units").iterdir())


def test_a_scene_file_may_have_its_ports(machine):
    done = here("service", "install", "robots/left.hand.toml", "--dry-run")
    assert done.returncode == 0 and "tactemu-left.hand.service" in done.stdout


def test_what_fails_is_undone(machine):
    (machine / "fails").touch()
    done = here("service", "install", "anyskin", "--port", PORT)
    assert done.returncode == 2 and "nothing of it is left" in done.stderr
    assert not list((machine / "units").iterdir())


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("install", "anyskin"), "needs its port"),
        (("install", "anyskin", "--port", PORT, "--user", "nobody-there"), "no user 'nobody-there'"),
        (("install", "anyskin", "--port", PORT, "--unit", "a/b"), "cannot be called 'a/b'"),
        (("remove", "hand"), "no service 'hand' (services: none)"),
    ],
)
def test_mistakes_are_one_sentence(machine, words, says):
    done = here("service", *words)
    assert done.returncode == 2 and says in done.stderr and not calls(machine)


def test_a_can_interface_gets_the_bit_rates_of_the_device_first(machine, monkeypatch):
    words = ("service", "install", "linker_hand_l6", "--port", "can:socketcan:can0", "--dry-run")
    monkeypatch.setattr("tactemu.transports.can_link.can_link", lambda name: None)
    assert (
        'ExecStartPre=+/bin/sh -c "ip link set can0 down; ip link set can0 up type can bitrate 1000000 && '
        'ip link set can0 txqueuelen 1000"' in here(*words).stdout
    )
    monkeypatch.setattr("tactemu.transports.can_link.can_link", lambda name: CanLink("vcan"))
    assert "ExecStartPre" not in here(*words).stdout


def test_arguments_reach_the_program_as_they_are(machine):
    words = ["anyskin", "--port", "serial:ttyUSB0?rs485=adapter&echo=1", "--fault", 'drop 1% $HOME "x" \\n']
    text = service.unit_text(words, user="root", folder=machine)
    start = next(line for line in text.splitlines() if line.startswith("ExecStart="))
    assert start.endswith('"serial:ttyUSB0?rs485=adapter&echo=1" --fault "drop 1%% $$HOME \\"x\\" \\\\n"')


@pytest.mark.skipif(not shutil.which("systemd-analyze"), reason="no systemd here to read the unit")
def test_systemd_reads_the_unit(machine):
    path = machine / "tactemu-anyskin.service"
    path.write_text(service.unit_text(["anyskin", "--port", PORT], user="root", folder=machine))
    done = subprocess.run(["systemd-analyze", "verify", path], capture_output=True, text=True, check=False)
    assert path.name not in done.stderr, done.stderr
