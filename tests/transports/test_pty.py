"""The pty against what a serial port does. The driver's side is pyserial, unmodified."""

import fcntl
import os
import signal
import subprocess
import sys
import termios
import time
from pathlib import Path

import pytest
import serial

from firmware_protocols import Serial
from tactemu.base.errors import TransportError
from tactemu.transports import create
from tactemu.transports.transport import (
    DROPPED,
    RAISED,
    Closed,
    LinesChanged,
    Opened,
    Received,
    SerialSetting,
    SettingChanged,
)
from tactemu.wire.wire import Wire

ROOT = Path(__file__).parents[2]


@pytest.fixture
def port(tmp_path):
    with create(f"pty:{tmp_path / 'tty'}") as port:
        yield port
    assert not os.path.lexists(tmp_path / "tty")


def events(port, kind=None, tries=50):
    """Return the events of a port after a moment in which the kernel delivers bytes."""
    seen = []
    for _ in range(tries):
        seen += port.poll()
        if kind is None or any(isinstance(event, kind) for event in seen):
            return seen
        time.sleep(0.002)
    return seen


def test_nothing_is_written_while_nobody_listens(port):
    assert port.poll() == [] and not port.has_reader
    assert not port.write(b"lost")
    with serial.Serial(port.address, timeout=0) as driver:
        assert events(port)[0] == Opened()
        assert driver.in_waiting == 0
        assert port.write(b"\r\n\x03\x04\x00\xff")
        driver.timeout = 1
        assert driver.read(6) == b"\r\n\x03\x04\x00\xff"
        driver.write(b"\r\n\x03\x11\x13\xff")
        assert Received(b"\r\n\x03\x11\x13\xff") in events(port, Received)
        assert driver.in_waiting == 0, "no echo"
    assert events(port)[-2:] == [Closed(), DROPPED]


def test_opened_before_any_byte_and_raw_without_help(port):
    """Read with a program that sets nothing: every byte must be unchanged."""
    reader = os.open(port.address, os.O_RDWR | os.O_NOCTTY)
    assert events(port) == [Opened(), RAISED]
    everything = bytes(range(256))
    assert port.write(everything)
    assert os.read(reader, 1000) == everything
    os.close(reader)
    assert events(port) == [Closed(), DROPPED]


@pytest.mark.parametrize("baud", [9600, 115_200, 2_000_000, 123_456])
def test_speed_of_the_driver(port, baud):
    with serial.Serial(port.address, baud):
        assert baud in [event.setting.baud for event in events(port) if isinstance(event, SettingChanged)]
        assert port.setting.baud == baud


@pytest.mark.parametrize(("parity", "seen"), [("N", None), ("E", None), ("O", "O"), ("M", "M"), ("S", "S")])
def test_format_of_the_driver_as_far_as_the_kernel_keeps_it(port, parity, seen):
    for stopbits in (1, 2):
        with serial.Serial(port.address, 19_200, bytesize=7, parity=parity, stopbits=stopbits):
            events(port)
            assert port.setting == SerialSetting(19_200, None, seen, stopbits)
        events(port)


def test_reopening_any_number_of_times_leaves_nothing_stale(port):
    for number in range(30):
        with serial.Serial(port.address, timeout=1) as driver:
            assert events(port)[0] == Opened()
            assert port.write(bytes([number]) * 50)
            assert driver.read(10) == bytes([number]) * 10
        assert events(port)[-2:] == [Closed(), DROPPED]
        fresh = os.open(port.address, os.O_RDONLY | os.O_NOCTTY)
        assert fcntl.ioctl(fresh, termios.FIONREAD, bytes(4)) == bytes(4)
        os.close(fresh)
        port.poll()


def test_close_and_open_between_two_looks(port):
    driver = serial.Serial(port.address)
    assert events(port)[0] == Opened()
    driver.close()
    driver.open()
    assert [event for event in events(port) if event in (Opened(), Closed())] == [Closed(), Opened()]
    driver.close()
    with serial.Serial(port.address) as driver:
        driver.write(b"hello")
    lines = (RAISED, DROPPED)
    assert [event for event in events(port) if event not in lines] == [Closed(), Opened(), Received(b"hello"), Closed()]


def test_parity_on_the_second_opening(port):
    """Set parity twice, which the kernel refuses on a pseudo terminal; the driver must not fail."""
    for _ in range(3):
        with serial.Serial(port.address, 115_200, parity="E") as driver:
            assert driver.is_open and events(port)
        events(port)


def test_lines_that_are_moved_beside_the_port(port):
    port.set_lines(False, True)
    assert port.poll() == []
    with serial.Serial(port.address):
        assert [event for event in events(port) if isinstance(event, LinesChanged)] == [
            RAISED,
            LinesChanged(False, True),
        ]
        port.set_lines(True, True)
        assert port.poll() == [RAISED]
    assert events(port)[-1] == DROPPED


EXCLUSIVE = """
import fcntl, os, sys, termios
from tactemu.transports import create
from tactemu.transports.transport import DROPPED, RAISED, Closed, Opened

with create(sys.argv[1]) as port:
    for _ in range(5):
        driver = os.open(port.address, os.O_RDWR | os.O_NOCTTY)
        fcntl.ioctl(driver, termios.TIOCEXCL)
        assert port.poll() == [Opened(), RAISED] and port.write(b"frame") and os.read(driver, 5) == b"frame"
        os.close(driver)
        assert port.poll() == [Closed(), DROPPED]
"""


def test_a_driver_that_wants_the_port_for_itself_leaves_it_usable(tmp_path):
    """Leave a pseudo terminal with TIOCEXCL, which the kernel keeps and enforces for all but administrators."""
    drop_rights = ["setpriv", "--bounding-set=-sys_admin"] if os.geteuid() == 0 else []
    command = [*drop_rights, sys.executable, "-c", EXCLUSIVE, f"pty:{tmp_path / 'tty'}"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=30, check=False)
    assert done.returncode == 0, done.stderr


def test_a_driver_that_does_not_read_loses_whole_frames(port):
    frame = bytes(range(82))
    with serial.Serial(port.address, timeout=0.2) as driver:
        events(port)
        taken = sum(port.write(frame) for _ in range(1000))
        assert 100 < taken < 400
        got = driver.read(taken * len(frame) + 1)
        for _ in range(20):
            port.poll()  # the end of a frame that the kernel took in part
            got += driver.read(taken * len(frame) - len(got)) if len(got) < taken * len(frame) else b""
        assert got == frame * taken


def test_pulling_the_cable(port):
    with serial.Serial(port.address, timeout=1) as driver:
        events(port)
        port.close()
        with pytest.raises(serial.SerialException):
            driver.read(1)
    assert not os.path.lexists(port._link.path)
    port.open()
    with serial.Serial(port.address, timeout=1) as driver:
        assert events(port)[0] == Opened()
        port.write(b"back")
        assert driver.read(4) == b"back"


def test_a_driver_never_reads_another_terminal_through_the_port_it_kept_open():
    port = create("pty:")
    port.open()
    driver = os.open(port.address, os.O_RDWR | os.O_NOCTTY)
    port.close()
    other = create("pty:")
    other.open()
    try:
        assert other.address != port.address and not Path(port.address).exists()
        assert os.read(driver, 1) == b""
        with pytest.raises(OSError, match="Input/output error"):
            os.write(driver, b"x")
    finally:
        os.close(driver)
        other.close()


def test_a_file_in_the_way_is_left_alone(tmp_path):
    (tmp_path / "file").write_text("mine")
    (tmp_path / "link").symlink_to("file")
    for name in ("file", "link", "no/such/folder"):
        with pytest.raises(TransportError):
            create(f"pty:{tmp_path / name}").open()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "link"]
    assert (tmp_path / "file").read_text() == "mine"


def test_a_link_left_behind_is_taken_over(tmp_path):
    (tmp_path / "tty").symlink_to("/dev/pts/99999")
    with create(f"pty:{tmp_path / 'tty'}") as port, serial.Serial(port.address):
        assert port.poll()[0] == Opened()


def test_a_port_in_use_is_not_taken_away(tmp_path):
    with create(f"pty:{tmp_path / 'tty'}") as port:
        with pytest.raises(TransportError, match="another run"):
            create(f"pty:{tmp_path / 'tty'}").open()
        with serial.Serial(port.address):
            assert port.poll()[0] == Opened()
        assert [path.name for path in tmp_path.iterdir()] == ["tty"]
    with create(f"pty:{tmp_path / 'tty'}") as port, serial.Serial(port.address):
        assert port.poll()[0] == Opened()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_signal_removes_the_link(tmp_path, number):
    usual = "default_int_handler" if number == signal.SIGINT else "SIG_DFL"  # who runs the tests may have it ignored
    code = (
        "import signal, sys, time; from tactemu.transports import create;"
        f"signal.signal({number:d}, signal.{usual});"
        "create(sys.argv[1]).open(); print(flush=True); time.sleep(60)"
    )
    child = subprocess.Popen(
        [sys.executable, "-c", code, f"pty:{tmp_path / 'tty'}"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        cwd=ROOT,
    )
    assert child.stdout and child.stdout.readline()
    assert os.path.lexists(tmp_path / "tty")
    child.send_signal(number)
    assert child.wait(10) != 0
    child.stdout.close()
    assert not os.path.lexists(tmp_path / "tty")


def test_a_port_comes_back_under_another_name(tmp_path):
    """Return under another name, as ttyUSB0 returns as ttyUSB1 while a process still holds it."""
    wire = Wire(create(f"pty:{tmp_path / 'ttyUSB0'}"), Serial(baud=115_200), faults=["unplug at 1s for 1s as ttyUSB1"])
    wire.open()
    seen = []
    for t_s in (0.5, 1.5, 2.5):
        wire.receive(round(t_s * 1e9))
        seen.append(sorted(path.name for path in tmp_path.iterdir()))
    assert seen == [["ttyUSB0"], [], ["ttyUSB1"]] and wire.transport.address == str(tmp_path / "ttyUSB1")
    wire.close()
    assert not list(tmp_path.iterdir())
