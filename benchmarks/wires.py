"""Real wires in a guest: `python -m benchmarks wires`.

Debian's kernel in QEMU (``scripts/kernel-guest``) has each USB-serial chip by USB/IP, with a loop-back plug, and a
16550A on a null-modem cable to a program that sends back what it receives. ``tactemu check-host --port --loopback``
measures them there. QEMU translates, so that the guest's programs are some ten times slower than on the machine itself.
"""

from __future__ import annotations

import json
import select
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from firmware_protocols import Serial, WireFrame
from tactemu.transports.transport import Received
from tactemu.transports.usbip import UsbIpTransport

ROOT = Path(__file__).parents[1]
CHIPS = {"cdc": "ttyACM0", "ftdi": "ttyUSB0", "cp210x": "ttyUSB1", "ch341": "ttyUSB2"}
"""The chips, and the names that the guest's kernel gives them in this order."""
UART, PLUG = "ttyS1", "ttyS2"
"""The two ends of the guest's null-modem cable."""
_ECHO = (
    "import os, sys\nfd = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)\nwhile True: os.write(fd, os.read(fd, 4096))"
)
_GUEST = r"""
{python} -m tactemu attach $KERNEL_GUEST_HOST:{number} >/dev/null &
stty -F /dev/{plug} raw -echo 115200 clocal
{python} -c "$ECHO" /dev/{plug} &
for node in $(for k in $(seq {repeats}); do echo {nodes}; done); do
  until [ -e /dev/$node ]; do sleep 0.2; done
  echo "$node $({python} -m tactemu check-host --port serial:$node --loopback --json)"
done
"""


@contextmanager
def plugs() -> Iterator[int]:
    """Serve all chips with a loop-back plug each, and yield the number of the port."""
    number, ports = 0, []
    for chip in CHIPS:
        port = UsbIpTransport(f"{chip}@{number}")
        port.set_connector(Serial(baud=115_200, usb=True))
        port.open()
        number = int(port.address.split("--tcp-port ")[1].split()[0])
        ports.append(port)
    is_over = threading.Event()

    def echo() -> None:
        waiting: dict[UsbIpTransport, deque[WireFrame]] = {port: deque() for port in ports}
        while not is_over.is_set():
            select.select([each for port in ports for each in port.filenos()], [], [], 0.1)
            for port, frames in waiting.items():
                frames += [each.data for each in port.poll(not frames) if isinstance(each, Received)]
                while frames and port.write(frames[0]):
                    frames.popleft()
                if not port.has_reader:
                    frames.clear()

    thread = threading.Thread(target=echo)
    thread.start()
    try:
        yield number
    finally:
        is_over.set()
        thread.join()
        for port in ports:
            port.close()


def run(say: Callable[[str], object], repeats: int = 3) -> dict[str, Any]:
    """Measure every chip and the UART; return the findings by node, each of the time with the shortest echo.

    Raises:
        SystemExit: there is no guest to be had.
    """
    found: dict[str, Any] = {}
    with plugs() as number:
        script = _GUEST.format(
            python=sys.executable, number=number, plug=PLUG, repeats=repeats, nodes=" ".join([UART, *CHIPS.values()])
        )
        guest = subprocess.Popen(
            [
                ROOT / "scripts/kernel-guest", "-n", "-t", "600", "-M", "vhci-hcd cdc-acm ftdi_sio cp210x ch341", "--",
                "env", f"ECHO={_ECHO}", "bash", "-c", script,
            ],
            stdout=subprocess.PIPE, text=True, cwd=ROOT,
        )  # fmt: skip
        assert guest.stdout is not None
        for line in guest.stdout:
            node, _, findings = line.partition(" ")
            if node not in (UART, *CHIPS.values()):
                continue
            these = json.loads(findings)
            if node not in found or _echo_ms(these) < _echo_ms(found[node]):
                found[node] = these
    if guest.wait():
        raise SystemExit(f"the guest ended with {guest.returncode}")
    for node, these in found.items():
        for name, each in these.items():
            say(f"{node:8} {name:8} {each['says']}")
    return found


def _echo_ms(findings: dict[str, Any]) -> float:
    return findings.get("echo", {}).get("values", {}).get("p50_ms", float("inf"))
