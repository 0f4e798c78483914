"""Unplug and replug as on a real machine; whoever is killed, nothing is left."""

import os
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.cli.command import start

EVERYTHING = select.POLLIN | select.POLLERR | select.POLLHUP
"""What poll says of a line that is hung up, to whoever wants to read."""
WATCH = """
import os, pyudev, select, serial, time
context = pyudev.Context()
monitors = [pyudev.Monitor.from_netlink(context, source) for source in ('udev', 'kernel')]
for monitor in monitors: monitor.filter_by('tty'); monitor.start()
port = serial.Serial('/dev/ttyUSB0', 2_000_000)
print('opened', flush=True)
try:
    while port.read(64): pass
except (serial.SerialException, OSError): print('read failed')
for what in (lambda: os.write(port.fd, b'x'), lambda: port.cts, lambda: port.in_waiting):
    try: what()
    except OSError as error: print(error.errno)
held = {held}
if not held: port.close()
for monitor in 2 * monitors:
    device = monitor.poll(5)
    there = os.path.exists(device.device_node) and os.path.exists(device.sys_path)
    print(device.action, device.sys_name, device.get('ID_VENDOR_ID'), there)
again = serial.Serial(device.device_node, 2_000_000, timeout=5)
print(len(again.read(64)))
"""


@pytest.mark.driver
@pytest.mark.parametrize(("held", "node"), [(False, "ttyUSB0"), (True, "ttyUSB1")])
@pytest.mark.usefixtures("preload")
def test_the_driver_sees_what_it_would_see_of_a_cable(exec_environment, held, node):
    """Also udev's events, by pyudev. Who keeps the old handle finds the device under the next number."""
    pytest.importorskip("pyudev", reason="pip install pyudev")
    env = exec_environment("flexitac")
    dev = env.devices[0]
    with env.popen([sys.executable, "-c", WATCH.format(held=held)], stdout=subprocess.PIPE, text=True) as driver:
        assert driver.stdout and driver.stdout.readline() == "opened\n"
        dev.wait(0.1)
        dev.inject_event(fault="unplug for 0.5s")
        told = driver.stdout.read().splitlines()
    assert told == [
        "read failed", "5", "5", "5", "remove ttyUSB0 0403 False", "remove ttyUSB0 None False",
        f"add {node} 0403 True", f"add {node} None True", "64",
    ]  # fmt: skip
    assert env.nodes == {"flexitac": f"/dev/{node}"}


def test_a_call_that_waits_ends_when_the_port_goes(exec_environment, compiled):
    env = exec_environment("flexitac")
    with env.popen([compiled("vendor"), "stay"], stdout=subprocess.PIPE, text=True) as driver:
        assert driver.stdout
        while driver.stdout.readline() != "reads\n":
            pass
        env.devices[0].inject_event(fault="unplug for 1s")
        read, *others = driver.stdout.read().splitlines()
    assert read in ("read -1 5", "read 0 0")  # one that waited, and one that came later
    assert others == ["waited 5", "write -1 5", "lines -5", f"poll {EVERYTHING:x}"]


def test_a_forked_child_of_the_test_unplugs_nothing(exec_environment):
    env = exec_environment("flexitac")
    if (child := os.fork()) == 0:
        os._exit(0)
    os.waitpid(child, 0)
    assert env.run(["test", "-c", "/dev/ttyUSB0"]).returncode == 0


@pytest.mark.parametrize("cycles", [25])
def test_many_times_leave_nothing(exec_environment, cycles):
    """`python -m benchmarks exec` does 1000."""
    from benchmarks.exec import replug

    figures = replug(exec_environment("flexitac"), cycles)
    assert figures["cycles"] == cycles and figures["seen by the driver"] == cycles
    assert not figures["left"], figures


def in_view(mount_namespace):
    """Processes in a mount namespace."""
    found = []
    for path in Path("/proc").glob("[0-9]*/ns/mnt"):
        try:
            if os.readlink(path) == mount_namespace:
                found.append(int(path.parts[2]))
        except OSError:
            pass
    return found


@pytest.mark.parametrize("killed", ["emulator", "driver"])
def test_whoever_is_killed_nothing_is_left(killed):
    script = (
        "import os, sys, time; print(os.getpid(), os.readlink('/proc/self/ns/mnt'), flush=True)\nimport serial\n"
        + (
            "port = serial.Serial('/dev/ttyUSB0', 2_000_000)\nprint('up', flush=True)\n"
            "try:\n    while port.read(1): pass\nexcept (OSError, serial.SerialException): pass\n"
            "time.sleep(0.2); print(os.path.exists('/dev/ttyUSB0'), flush=True)"
        )
    )
    run = start("exec", "-q", "flexitac", "--", sys.executable, "-c", script)
    assert run.stdout and run.stderr
    first = run.stdout.readline()
    assert first, run.stderr.read()
    pid, namespace = first.split()
    assert run.stdout.readline() == "up\n" and len(in_view(namespace)) == 2
    started = time.monotonic()
    if killed == "driver":
        os.kill(int(pid), signal.SIGKILL)
        assert run.wait(10) == 128 + signal.SIGKILL
    else:
        run.kill()
        assert run.stdout.readline() == "False\n", "an unplug, also of the node"
        run.wait(5)
    for stream in (run.stdout, run.stderr):
        assert stream
        stream.close()
    while in_view(namespace):
        assert time.monotonic() - started < 10.0
        time.sleep(0.01)
    assert "tactemu" not in Path("/proc/self/mounts").read_text()
