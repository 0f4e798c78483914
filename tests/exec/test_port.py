"""A port in the view answers as a USB serial port does, and what the driver does to it reaches the device."""

import sys

import pytest

from tactemu.truth.entries import PortEvent
from tactemu.truth.log_reader import records

OPENED = """
import os, serial, sys, time
port = serial.Serial('/dev/ttyUSB0', {baud}, timeout=5, **{setting})
{then}
"""


def python(env, then, baud=921600, **setting):
    done = env.run(
        [sys.executable, "-c", OPENED.format(baud=baud, setting=setting, then=then)],
        capture_output=True,
        text=True,
        timeout=30,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_a_vendors_program_finds_what_it_expects(exec_environment, compiled, tmp_path):
    """One in C, with the port's name, modem lines, low latency, 7E1, RTS/CTS and a break in it."""
    log = tmp_path / "truth.jsonl"
    env = exec_environment("eflesh_binary", truth=log)
    done = env.run([compiled("vendor")], capture_output=True, text=True, timeout=20)
    assert done.stdout.splitlines() == [
        "opened 166",
        "dtr down 164",
        "both up 166",
        "rts down by a child 162",
        "serial 0 0 low latency 1",
        "7E 0 1 1 1",
        "break 0",
        "8N 0",
    ]
    dev = env.devices[0]
    dev.wait(0.1)
    assert dev.emulator.channels[0].power_cycles > 1, "DTR restarts the board"
    dev.stop()
    heard = [entry.what for entry in records(log) if isinstance(entry, PortEvent)]
    for what in ("low latency on", "break", "break ends"):
        assert what in heard


@pytest.mark.usefixtures("preload")
def test_dtr_restarts_the_board_each_time(exec_environment):
    env = exec_environment("eflesh_binary")
    channel = env.devices[0].emulator.channels[0]
    python(env, "for _ in range(3): port.dtr = False; time.sleep(0.02); port.dtr = True; time.sleep(0.02)", dsrdtr=None)
    env.devices[0].wait(0.1)
    opened, toggled = 1, 3
    assert channel.power_cycles == 1 + opened + toggled


@pytest.mark.parametrize(
    ("setting", "garbled"),
    [
        ({}, False),
        ({"parity": "E"}, True),
        ({"stopbits": 2}, False),
        ({"bytesize": 7}, True),
    ],
)
@pytest.mark.usefixtures("preload")
def test_a_parity_that_disagrees_garbles(exec_environment, setting, garbled):
    env = exec_environment("flexitac")
    python(env, "while len(port.read(64)) < 64: pass\ntime.sleep(0.5)", baud=2_000_000, **setting)
    counters = env.devices[0].emulator.wires[0].counters
    assert (counters["misheard"] > counters["sent"] / 2) == garbled, counters  # some before the port was set


@pytest.mark.usefixtures("preload")
def test_what_a_driver_has_set_is_what_it_reads_back(exec_environment):
    env = exec_environment("flexitac")
    then = (
        "import fcntl, struct, termios\n"
        "control = termios.tcgetattr(port.fd)[2]; raw = fcntl.ioctl(port.fd, 0x802C542A, bytes(44))\n"
        "kept = termios.PARENB | termios.PARODD | termios.CSIZE | termios.CSTOPB\n"
        "print(control & kept == struct.unpack_from('4I', raw)[2] & kept == termios.PARENB | termios.PARODD | "
        "termios.CS7 | termios.CSTOPB, port.cts, port.dsr, port.cd, port.ri)\n"
        "port.set_low_latency_mode(True); port.baudrate = 250000; port.parity = 'N'; port.bytesize = 8\n"
        "print(termios.tcgetattr(port.fd)[2] & (termios.PARENB | termios.CSIZE) == termios.CS8)"
    )
    assert python(env, then, parity="O", bytesize=7, stopbits=2) == ["True", "True", "True", "True", "False", "True"]


def test_other_terminals_are_left_alone(exec_environment):
    env = exec_environment("flexitac")
    then = (
        "import fcntl, pty, termios\n"
        "_, own = pty.openpty()\n"
        "try: fcntl.ioctl(own, termios.TIOCMGET, bytes(4)); print('answered')\n"
        "except OSError as error: print(error.errno)"
    )
    assert python(env, then) == ["25"]
