"""Programs that know pyserial or python-can, and nothing of us, open a device by its name."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import can
import pytest
import serial

from tactemu.base.errors import SceneError
from tactemu.integrations.can_bus import TactemuBus
from tactemu.integrations.protocol_tactemu import Serial
from tactemu.integrations.target import device_for

ROOT = Path(__file__).parents[2]

PYSERIAL = """
import os, serial, tempfile
serial.protocol_handler_packages.append("tactemu.integrations")
port = serial.serial_for_url("tactemu://anyskin?rate_hz=200", baudrate=115200, timeout=5)
assert len(port.read(82 * 20)) == 82 * 20
port.dtr = False
port.rts = True
assert port.cts and port.dsr and port.name == "tactemu://anyskin?rate_hz=200"
port.close()
with serial.serial_for_url("tactemu://anyskin", timeout=5, do_not_open=True) as again:
    assert len(again.read(82)) == 82
ours = [name for name in os.listdir(tempfile.gettempdir()) if name.startswith("tactemu")]
assert all(name.startswith("tactemu-kernels-") for name in ours), ours
"""
PYTHON_CAN = """
import sys, can
interface, channel = sys.argv[1:]
with can.Bus(interface=interface, channel=channel, bitrate=1_000_000) as bus, can.Bus(interface=interface, channel=channel) as tap:
    bus.send(can.Message(arbitration_id=0x28, data=[0xB1, 0xC6], is_extended_id=False))
    rows = [bus.recv(5) for _ in range(12)]
    assert [(row.arbitration_id, row.data[0], row.data[1]) for row in rows] == [(0x28, 0xB1, k << 4) for k in range(12)]
    assert tap.recv(1).data == bytes([0xB1, 0xC6]), "the other node of the bus hears the request too"
    assert tap.recv(5).data[0] == 0xB1
"""  # noqa: E501


def program(code, *arguments, path=(), **environment):
    """Run a program that finds this tree, and what is registered in ``path``."""
    places = os.pathsep.join(map(str, (ROOT, *path)))
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, timeout=100, check=False,
        env=os.environ | {"PYTHONPATH": places} | environment,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout == "", "a driver's output is its own"


@pytest.fixture
def installed(tmp_path):
    """Return a folder that registers our entry points, as an installation of this tree does."""
    groups = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]
    info = tmp_path / "tactemu_of_this_tree-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: tactemu-of-this-tree\nVersion: 1\n")
    lines = [f"{name} = {where}" for name, where in groups["can.interface"].items()]
    (info / "entry_points.txt").write_text("\n".join(["[can.interface]", *lines]))
    return tmp_path


def test_a_program_that_knows_pyserial(tmp_path):
    program(PYSERIAL, TMPDIR=str(tmp_path))


def test_a_program_that_knows_python_can(installed):
    program(PYTHON_CAN, "tactemu", "linker_hand_l6", path=[installed])


def test_a_program_that_insists_on_socketcan():
    command = [sys.executable, "-m", "tactemu.integrations"]
    folder = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout.strip()
    program(PYTHON_CAN, "socketcan", "can5", path=[folder], TACTEMU_SOCKETCAN="can5=linker_hand_l6")
    refused = "import can\ntry: can.Bus(interface='socketcan', channel='nosuch0')\nexcept OSError: pass\nelse: raise 0"
    program(refused, path=[folder], TACTEMU_SOCKETCAN="can5=linker_hand_l6")


def test_the_device_behind_a_port_is_pressed_by_hand():
    port = Serial(None, timeout=5)
    port.port = "tactemu://anyskin?by_hand=yes&rate_hz=200&seed=3&fault=drop every 5"
    port.open()
    port.served.press(1e-3, dwell=0.1)
    assert port.served.truth.injected["drop"] > 1
    port.close()
    assert port.served is None
    port.close()


def test_the_device_goes_with_the_last_bus():
    one = TactemuBus("linker_hand_l6?by_hand=yes")
    other = TactemuBus("linker_hand_l6?by_hand=yes", fd=True)
    device = one.served
    assert other.served is device
    one.shutdown()
    other.served.press(1e-3, dwell=0.05)
    other.shutdown()
    assert device._thread is None
    other.shutdown()


def test_mistakes_are_said_in_the_words_of_the_library():
    port = Serial(None)
    for url, said in {
        "tactemu://anyskn": "anyskin",
        "tactemu://anyskin?rate=3": "no option 'rate'; did you mean 'rate_hz'",
        "tactemu://anyskin?rate_hz=fast": "rate_hz: wrong value 'fast'",
        "tactemu://anyskin?by_hand=1": "by_hand: wrong value '1'",
    }.items():
        port.port = url
        with pytest.raises(serial.SerialException, match=said):
            port.open()
        assert not port.is_open and port.served is None
    with pytest.raises(can.CanInitializationError, match="linker_hand_l66"):
        TactemuBus("linker_hand_l66")
    with pytest.raises(SceneError, match="no option 'depth'"):
        device_for("anyskin?depth=1")
