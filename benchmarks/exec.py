"""The cost of a view of the machine, and what it leaves behind: `python -m benchmarks exec`.

Programs measure the driver's side inside and outside the view, in turn; a figure is the median.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Any

import tactemu
from tactemu.exec.environment import ExecEnvironment
from tactemu.tune.timing import Report

DEVICE = "flexitac"
"""A device that streams without requests and without pause."""
_STARTS = 15
_CALLS = 20_000

_CALLER = f"""
import os, pty, termios, time, tty
from statistics import median

near, port = pty.openpty()
tty.setraw(port)
os.set_blocking(port, False)

def per_call_us(call, batches=40, size={_CALLS // 40}):
    times = []
    for _ in range(batches):
        begin = time.perf_counter_ns()
        for _ in range(size):
            call()
        times.append((time.perf_counter_ns() - begin) / size / 1e3)
    return median(times)

def read():
    try:
        os.read(port, 64)
    except BlockingIOError:
        pass

print(per_call_us(lambda: os.write(port, b'')), per_call_us(read), per_call_us(lambda: termios.tcgetattr(port)))
"""
_READER = """
import os, time
while True:
    nodes = sorted(name for name in os.listdir('/dev') if name.startswith('ttyUSB'))
    try:
        port = os.open(f'/dev/{nodes[0]}', os.O_RDWR | os.O_NOCTTY) if nodes else -1
    except OSError:
        port = -1
    if port < 0:
        time.sleep(0.001)
        continue
    print(nodes[0], flush=True)
    try:
        while os.read(port, 4096): pass
    except OSError: pass
    os.close(port)
    print('gone', flush=True)
"""


def run(report: Report, *, cycles: int = 1000) -> dict[str, Any]:
    """Measure the start of a driver, a read and a write, and ``cycles`` replugs."""
    with tactemu.serve(DEVICE) as dev, tactemu.exec_environment(dev) as env:
        figures = {"start": starts(env), "call": calls(env), "replug": replug(env, cycles)}
    figures["frame"] = frames()
    start, call, plugs = figures["start"], figures["call"], figures["replug"]
    report(f"start of a program        {start['outside_ms']:7.1f} ms, in the view {start['inside_ms']:.1f} ms")
    for name, (outside, inside) in call.items():
        report(f"{name:<25} {outside:7.2f} µs, in the view {inside:.2f} µs")
    for name, (packet, can) in figures["frame"].items():
        report(f"{name:<25} {packet:7.2f} µs as a packet, in the view {can:.2f} µs")
    report(
        f"{plugs['cycles']} times unplugged        {plugs['seconds']:7.1f} s, seen {plugs['seen by the driver']} times"
    )
    report(f"left over                 {plugs['left'] or 'nothing'}")
    return figures


def starts(env: ExecEnvironment) -> dict[str, float]:
    """Return the time from the start to the end of a short program, outside the view and in it [ms]."""
    times: dict[str, list[float]] = {"outside_ms": [], "inside_ms": []}
    for _ in range(_STARTS):
        for name, command in (("outside_ms", ["/bin/echo"]), ("inside_ms", env.command(["/bin/echo"]))):
            begin = time.perf_counter()
            subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
            times[name].append((time.perf_counter() - begin) * 1e3)
    return {name: median(each) for name, each in times.items()}


def calls(env: ExecEnvironment) -> dict[str, tuple[float, float]]:
    """Return the times of a write, a read and a replaced call on a pseudo terminal, outside the view and in it [µs].

    The calls transfer no bytes, whose cost is the kernel's: only the overhead of the view is measured.
    """
    command = [sys.executable, "-c", _CALLER]
    pairs = [
        [
            list(map(float, subprocess.run(each, capture_output=True, text=True, check=True).stdout.split()))
            for each in both
        ]
        for both in [(command, env.command(command))] * 5
    ]
    names = ("write of nothing", "read of nothing", "tcgetattr")
    return {
        name: (median(pair[0][k] for pair in pairs), median(pair[1][k] for pair in pairs))
        for k, name in enumerate(names)
    }


_FRAMES = """
import socket, sys, time
from statistics import median
if sys.argv[1] == 'can':
    ends = [socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) for _ in range(2)]
    for each in ends: each.bind(('can0',))
else:
    ends = [socket.socket(socket.AF_PACKET, socket.SOCK_RAW, 0) for _ in range(2)]
    ends[0].bind(('can0', 0x000c)); ends[1].bind(('can0', 3))
frame, times = bytes.fromhex('23010000080000000102030405060708'), []
for _ in range(60):
    sent, begin = 0, time.perf_counter_ns()
    for _ in range(200):
        ends[0].send(frame)
    sent = time.perf_counter_ns()
    for _ in range(200):
        ends[1].recv(16)
    times.append(((sent - begin) / 200e3, (time.perf_counter_ns() - sent) / 200e3))
print(*map(median, zip(*times)))
"""


def frames() -> dict[str, tuple[float, float]]:
    """Return the times of a CAN frame between two sockets, plain packet sockets and CAN sockets in the view [µs]."""
    with tactemu.serve("xela_uskin") as dev, tactemu.exec_environment(dev) as env:
        program = [sys.executable, "-c", _FRAMES]
        commands = [["env", "-u", "LD_PRELOAD", *program, "packet"], [*program, "can"]]
        runs = [
            [
                list(map(float, env.run(each, capture_output=True, text=True, check=True).stdout.split()))
                for each in commands
            ]
            for _ in range(5)
        ]
    return {
        name: (median(run[0][k] for run in runs), median(run[1][k] for run in runs))
        for k, name in enumerate(("sending a CAN frame", "reading a CAN frame"))
    }


def replug(env: ExecEnvironment, cycles: int) -> dict[str, Any]:
    """Unplug and plug in again while a driver reads, and return what is left behind."""
    dev = env.devices[0]
    (wire,) = dev.emulator.wires
    with env.popen([sys.executable, "-c", _READER], stdout=subprocess.PIPE, text=True) as driver:
        assert driver.stdout
        node = driver.stdout.readline()
        dev.wait(0.05)
        keeper = env.keeper
        before, begin, seen = _held(keeper, driver.pid), time.perf_counter(), 0
        for _ in range(cycles):
            dev.in_loop(wire.transport.close)
            seen += driver.stdout.readline() == "gone\n"
            dev.in_loop(wire.transport.open)
            node = driver.stdout.readline()
        seconds = time.perf_counter() - begin
        dev.wait(0.05)
        after = _held(keeper, driver.pid)
        driver.kill()
    assert node.startswith("ttyUSB")
    left = {what: after[what] - before[what] for what in before if after[what] > before[what]}
    return {"cycles": cycles, "seen by the driver": seen, "seconds": seconds, "left": left}


def _held(keeper: int, driver: int) -> dict[str, int]:
    """Return the numbers of descriptors, threads, mounts, nodes and files of emulator, keeper, driver and view."""
    counts = {}
    for name, pid in (("emulator", os.getpid()), ("keeper", keeper), ("driver", driver)):
        counts[f"descriptors of the {name}"] = len(os.listdir(f"/proc/{pid}/fd"))
        counts[f"threads of the {name}"] = len(os.listdir(f"/proc/{pid}/task"))
    root = Path(f"/proc/{keeper}/root")
    counts["mounts"] = len(Path(f"/proc/{keeper}/mounts").read_text().splitlines())
    namespace = os.readlink(f"/proc/{keeper}/ns/mnt")
    counts["processes in the view"] = sum(_link(path) == namespace for path in Path("/proc").glob("[0-9]*/ns/mnt"))
    for folder in ("dev", "sys/devices/tactemu", "run/udev/.tactemu/ports", "run/udev/.tactemu/events", "sys/dev/char"):
        counts[f"files in /{folder}"] = sum(1 for _ in _files(root / folder))
    return counts


def _files(folder: Path) -> Iterator[str]:
    for here, folders, names in os.walk(folder):
        if here.endswith("/dev"):  # other programs open terminals meanwhile
            folders.remove("pts")
        yield from folders
        yield from names


def _link(path: Path) -> str:
    try:
        return os.readlink(path)
    except OSError:  # it has ended meanwhile, or belongs to another user
        return ""
