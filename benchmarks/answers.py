"""The time that a driver waits for an answer: part of `python -m benchmarks loop`.

A client in another process sends a request, reads the complete answer and sends the next one after a random pause of up
to 2 ms, so that requests come at any moment of the loop. The device samples 360 taxels at 100 Hz meanwhile. USB and TCP
have no modelled line time; on CAN the figure includes two frames of about 0.1 ms each.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from tactemu.emulator.assembly import assemble
from tactemu.emulator.options import AssemblyOptions
from tactemu.scene import file
from tactemu.tune.timing import Report

CLIENT = """
import atexit, json, os, random, select, socket, sys, time, tty
kind, address, request, size, count = sys.argv[1:4] + [int(n) for n in sys.argv[4:6]]
if kind == "can":
    import can
    interface, _, channel = address.partition(":")
    bus = can.Bus(interface=interface, channel=channel)
    atexit.register(bus.shutdown)
    ident, _, data = request.partition("#")
    message = can.Message(arbitration_id=int(ident, 16), data=bytes.fromhex(data), is_extended_id=False)
    def ask():
        bus.send(message)
        while (received := bus.recv(2.0)) is not None:
            if received.data != message.data:  # a multicast group also receives its own messages
                return True
        return False
else:
    if kind == "tcp":
        host, _, port = address.removeprefix("socket://").rpartition(":")
        line = socket.create_connection((host, int(port)))
        line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        handle = line.fileno()
    else:
        handle = os.open(address, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(handle)
    request = bytes.fromhex(request)
    def ask():
        if select.select([handle], [], [], 0)[0]:
            return False  # the answer before was longer
        os.write(handle, request)
        left = size
        while left > 0 and select.select([handle], [], [], 2.0)[0]:
            left -= len(os.read(handle, left))
        return left == 0
took, lost = [], 0
for k in range(count + 50):
    begun = time.perf_counter_ns()
    good = ask()
    if k >= 50:
        took.append(time.perf_counter_ns() - begun)
        lost += not good
    time.sleep(random.random() * 2e-3)
took.sort()
print(json.dumps({"p50": took[len(took) // 2] / 1e6, "p99": took[len(took) * 99 // 100] / 1e6, "lost": lost}))
"""


@dataclass(frozen=True)
class Case:
    """A polled device on one kind of port."""

    name: str
    device: str
    options: dict[str, Any]
    port: str
    request: str
    size: int
    """The size of the answer [bytes]."""


_READ_ONE = "55aa7b7b0e0070c0060500" + "7b0e040300" + "27" + "55aa7d7d"
CASES = (
    Case("pty", "paxini_gen2", {"models": ("L5325",) * 3}, "pty:{folder}/port", _READ_ONE, 26),
    Case("tcp", "paxini_gen2", {"models": ("L5325",) * 3}, "tcp:127.0.0.1:0", _READ_ONE, 26),
    Case("can", "linker_hand_l6", {}, "can:udp_multicast:239.74.163.78", "028#C2", 0),
)


def answer_ms(case: Case, count: int) -> dict[str, float]:
    """Return median and 99th percentile of the time from request to answer [ms], and the number of lost answers."""
    with tempfile.TemporaryDirectory(prefix="tactemu-bench-") as folder:
        run_options = AssemblyOptions(port=case.port.format(folder=folder), rate_hz=100.0)
        emulator = assemble(file.load(case.device, case.options), run_options).emulator
        with emulator:
            address = emulator.wires[0].transport.address
            arguments = [case.name, address, case.request, str(case.size), str(count)]
            client = subprocess.Popen([sys.executable, "-c", CLIENT, *arguments], stdout=subprocess.PIPE, text=True)
            threading.Thread(target=lambda: (client.wait(), emulator.call(emulator.stop)), daemon=True).start()
            emulator.run()
            output = client.communicate()[0]
    return json.loads(output)


@contextmanager
def busy_processes(count: int) -> Iterator[None]:
    """Run so many processes that each keep a core busy."""
    processes = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def run(report: Report, *, count: int = 10_000) -> dict[str, float]:
    """Measure every case beside a process that keeps one core busy, and return the figures by name."""
    figures: dict[str, float] = {}
    with busy_processes(1):
        for case in CASES:
            found = answer_ms(case, count)
            figures |= {f"answer_{what}_ms_{case.name}": value for what, value in found.items()}
            report(
                f"answer on {case.name:4} beside a busy process    p50 {found['p50']:.2f} ms, "
                f"p99 {found['p99']:.2f} ms of {count} questions, {found['lost']:.0f} lost"
            )
    return figures
