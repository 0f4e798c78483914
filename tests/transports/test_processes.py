"""A port belongs to the process that made it: children neither keep it nor take it away."""

import contextlib
import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from urllib.parse import urlsplit

import pytest
import serial

from tactemu.base.errors import TransportError
from tactemu.transports import create
from tactemu.transports.transport import Opened

ROOT = Path(__file__).parents[2]
ADDRESSES = ["pty:{tmp}/tty", "tcp:{tcp}", "rfc2217:{tcp}", "udp:{tcp}", "ws:{tcp}", "can:udp_multicast:239.74.163.31"]
pytestmark = pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")


@pytest.fixture
def address(request, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as free:
        number = free.getsockname()[1]
    return request.param.format(tmp=tmp_path, tcp=number)


def open_in(process):
    """Return what a process has open."""
    found = set()
    for descriptor in Path(f"/proc/{process}/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):  # closed meanwhile
            found.add(os.readlink(descriptor))
    return found


def in_a_fork(action):
    """Exit status of a forked child that does something; -N when it dies of signal N."""
    if not (child := os.fork()):
        try:
            action()
        except BaseException:
            os._exit(99)
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


@contextlib.contextmanager
def living_child():
    """Fork a child that does nothing for as long as the block lasts."""
    if not (child := os.fork()):
        time.sleep(60)
        os._exit(0)
    try:
        yield child
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


def serves(port):
    """Return True if a driver can open the port and the port reports it."""
    if port.scheme == "can":
        return port.has_reader and bool(port.filenos())
    if port.scheme == "pty":
        driver = serial.Serial(port.address)
    elif port.scheme == "udp":
        url = urlsplit(port.address)
        driver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        driver.sendto(b"", (url.hostname, url.port))
    else:
        url = urlsplit(port.address)
        driver = socket.create_connection((url.hostname, url.port))
    events = []
    for _ in range(20):
        events += port.poll()
        time.sleep(0.001)
    driver.close()
    for _ in range(20):
        port.poll()
        time.sleep(0.001)
    return Opened() in events


def ends_at_once():
    pass


def ends_by_exit():
    sys.exit(0)


def ends_by_a_signal():
    signal.raise_signal(signal.SIGTERM)


@pytest.mark.parametrize("address", ADDRESSES, indirect=True)
@pytest.mark.parametrize("end", [ends_at_once, ends_by_exit, ends_by_a_signal])
def test_a_child_that_ends_leaves_the_port(address, end):
    with create(address) as port:
        in_a_fork(end)
        in_a_fork(port.close)
        assert serves(port)
        if port.scheme == "pty":
            assert os.path.lexists(port.address)


@pytest.mark.parametrize("address", ADDRESSES, indirect=True)
def test_a_child_that_lives_on_keeps_nothing_of_the_port(address):
    before = open_in("self")
    with create(address) as port, living_child() as child:
        end = time.monotonic() + 5
        while (kept := open_in(child) - before) and time.monotonic() < end:
            time.sleep(0.01)
        assert not kept
        port.close()
        with create(address) as again:
            assert serves(again), "made anew while the child lives"


def test_the_driver_sees_that_the_port_goes_while_a_child_lives(tmp_path):
    with create(f"pty:{tmp_path / 'tty'}") as port, serial.Serial(port.address, timeout=2) as driver, living_child():
        port.close()
        with pytest.raises(serial.SerialException):
            driver.read(1)


@pytest.mark.parametrize("method", ["fork", "forkserver", "spawn"])
def test_a_process_of_multiprocessing_that_is_terminated_leaves_the_port(method, tmp_path):
    context = multiprocessing.get_context(method)
    with create(f"pty:{tmp_path / 'tty'}") as port:
        process = context.Process(target=time.sleep, args=(60,))
        process.start()
        process.terminate()
        process.join(20)
        assert process.exitcode == -signal.SIGTERM
        assert serves(port)
    assert not os.path.lexists(tmp_path / "tty")


def test_a_child_cannot_take_the_port_of_its_living_parent(tmp_path):
    def take():
        with pytest.raises(TransportError, match="another run"):
            create(f"pty:{tmp_path / 'tty'}").open()

    with create(f"pty:{tmp_path / 'tty'}") as port:
        assert in_a_fork(take) == 0
        assert serves(port)


def test_a_port_that_a_child_makes_belongs_to_the_child(tmp_path):
    """End the child in any way: its link goes with it, and a name that was left is taken over."""

    def end_by_a_signal():
        create(f"pty:{tmp_path / 'tty'}").open()
        signal.raise_signal(signal.SIGTERM)

    with create(f"pty:{tmp_path / 'other'}"):  # the parent has a handler of ours
        assert in_a_fork(end_by_a_signal) == -signal.SIGTERM
        assert not os.path.lexists(tmp_path / "tty")
        assert in_a_fork(create(f"pty:{tmp_path / 'tty'}").open) == 0
        assert os.path.lexists(tmp_path / "tty"), "ended by os._exit, which runs nothing"
        with create(f"pty:{tmp_path / 'tty'}") as port:
            assert serves(port)


def test_a_file_beside_the_port_is_left_alone(tmp_path):
    mine = tmp_path / f".tty.{os.getpid()}"
    mine.write_text("mine")
    with create(f"pty:{tmp_path / 'tty'}") as port:
        assert serves(port)
    assert mine.read_text() == "mine"


SERVED = """
import multiprocessing, os, sys, time
import tactemu

def child():
    time.sleep(60)

if __name__ == "__main__":
    with tactemu.serve("anyskin", "pty:" + sys.argv[1], truth=sys.argv[2]) as dev:
        process = multiprocessing.get_context("fork").Process(target=child)
        process.start()
        process.terminate()
        process.join()
        dev.wait(0.05)
        if not os.fork():
            sys.exit(0)  # runs exit handlers, leaves the `with`, writes out what is buffered
        os.wait()
        dev.press(1e-3, dwell=0.1)
        assert os.path.lexists(dev.port)
        if not os.fork():
            os._exit(0)
        os.wait()
        dev.press(1e-3, dwell=0.1)
        assert os.path.lexists(dev.port)
    assert not os.path.lexists(dev.port)
"""


def test_a_served_device_survives_its_forks_and_logs_everything_once(tmp_path):
    (tmp_path / "served.py").write_text(SERVED)
    arguments = [tmp_path / "served.py", tmp_path / "tty", tmp_path / "truth.jsonl"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    subprocess.run([sys.executable, *arguments], check=True, timeout=60, env=environment)
    lines = (tmp_path / "truth.jsonl").read_text().splitlines()
    samples = [line for line in lines if '"sample"' in line]
    assert len(samples) == len(set(samples)) > 20


WORKERS = """
import os, pytest, serial

@pytest.mark.parametrize("number", range(2))
def test_each_has_a_port_of_its_own(tactile_device, number):
    dev = tactile_device("anyskin", rate_hz=200)
    with serial.Serial(dev.port, 115_200, timeout=5) as driver:
        assert len(driver.read(82)) == 82
    with open(os.environ["PORTS"], "a") as ports:
        ports.write(dev.port + "\\n")
"""


def test_workers_of_xdist_have_ports_of_their_own(tmp_path):
    (tmp_path / "test_workers.py").write_text(WORKERS)
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PORTS": str(tmp_path / "ports")}
    command = [sys.executable, "-m", "pytest", "-q", "-n", "2", str(tmp_path)]
    subprocess.run(command, check=True, timeout=100, env=environment, cwd=tmp_path)
    ports = (tmp_path / "ports").read_text().split()
    assert len(ports) == len(set(ports)) == 2
    assert not any(map(os.path.lexists, ports))
