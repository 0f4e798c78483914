"""The guest's part of ``test_usb_hard_in_a_kernel.py``: ``PORT USBIP READER UNPLUGS``; prints JSON lines.

Ports 1-1 and 1-2 of the hub are AnySkins behind CDC-ACM and an FT232R. USBIP is Debian's program, READER a driver in
C++.
"""

import contextlib
import json
import os
import subprocess
import sys
import termios
import threading
import time
import tty
from pathlib import Path

import numpy as np
import serial

from firmware_protocols import Serial
from tactemu.base.errors import TactemuError
from tactemu.transports.transport import Received
from tactemu.transports.usb import vhci
from tests.drivers.usb_link import UsbLink

ROOT = Path(__file__).parents[2]
FRAME_BYTES, COUNT = 82, 20
FLOOD_BYTES = 200_000
NAMESPACE = """
mkdir -p /run/only && mount -t tmpfs only /run/only && touch /run/only/null /run/only/{node}
mount --bind /dev/null /run/only/null && mount --bind /dev/{node} /run/only/{node}
mount --rbind /run/only /dev && mount -t tmpfs none /sys && ls /dev >&2
exec "$@"
"""


def say(name: str, **what) -> None:
    print(json.dumps({"name": name, **what}), flush=True)


def wait(condition, seconds: float = 60.0) -> bool:
    deadline = time.monotonic() + seconds
    while not (met := condition()) and time.monotonic() < deadline:
        time.sleep(0.01)
    return bool(met)


def is_there(node: str) -> bool:
    return os.path.exists(f"/dev/{node}")


def python_driver(node: str, *before: str) -> list:
    command = [
        sys.executable,
        str(ROOT / "tests/drivers/scripts/anyskin_read.py"),
        "anyskin",
        f"/dev/{node}",
        str(COUNT),
    ]
    done = subprocess.run([*before, *command], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1])["readings"]


def attached(host: str, port: int, busid: str, node: str) -> int:
    """Attach a device, as often as it is still taken, and wait for its node."""
    deadline = time.monotonic() + 60
    while True:
        try:
            number = vhci.attach(host, port, busid)
            break
        except TactemuError:
            assert time.monotonic() < deadline, f"{busid} is never free again"
            time.sleep(0.05)
    assert wait(lambda: is_there(node)), f"no {node}"
    return number


def by_program(usbip: str, host: str, port: int) -> None:
    """Attach, list and detach by the kernel's own tool, which is another client than ours."""
    tool = [usbip, "--tcp-port", str(port)]
    env = {**os.environ, "LD_LIBRARY_PATH": str(Path(usbip).parents[1] / "lib/x86_64-linux-gnu")}
    listed = subprocess.run([*tool, "list", "-r", host], capture_output=True, text=True, check=True, env=env).stdout
    subprocess.run([*tool, "attach", "-r", host, "-b", "1-1"], check=True, env=env, stdout=sys.stderr)
    assert wait(lambda: is_there("ttyACM0")), "no ttyACM0"
    readings = python_driver("ttyACM0")
    shown = subprocess.run([usbip, "port"], capture_output=True, text=True, check=True, env=env).stdout
    subprocess.run([usbip, "detach", "-p", "0"], check=True, env=env, stdout=sys.stderr)
    say("program", listed=listed, shown=shown, readings=readings, is_gone=wait(lambda: not is_there("ttyACM0")))


def unplugs(host: str, port: int, count: int) -> None:
    """Pull the cable while a driver reads, again and again; keep one frame of each time."""
    frames, errors, nodes = [], 0, 0
    for _ in range(count):
        number = attached(host, port, "1-1", "ttyACM0")
        node = os.open("/dev/ttyACM0", os.O_RDWR | os.O_NOCTTY)
        tty.setraw(node)
        termios.tcflush(node, termios.TCIOFLUSH)
        data = b""
        while len(data) < 3 * FRAME_BYTES:
            data += os.read(node, 256)
        start = next(at for at in range(FRAME_BYTES) if data[at + 80 : at + 82] == b"\r\n")
        frames.append(np.frombuffer(data[start : start + 80], "<f4").astype(float).tolist())
        vhci.detach(number)
        try:
            while os.read(node, 256):
                pass
        except OSError:
            pass
        errors += 1  # the read has ended
        os.close(node)
        nodes += wait(lambda: not is_there("ttyACM0"))
    say("unplugs", readings=frames, errors=errors, nodes=nodes)


def flood(chip: str) -> None:
    """Write to a device that takes nothing half of the time, as fast as the kernel lets us."""
    link = UsbLink(chip, Serial(baud=115_200))
    data, got, done = os.urandom(FLOOD_BYTES), bytearray(), threading.Event()

    def write() -> None:
        with serial.Serial(link.node, 115_200, write_timeout=200) as driver:
            driver.write(data)
            driver.flush()
            done.wait(200)

    driver = threading.Thread(target=write)
    driver.start()
    deadline, most = time.monotonic() + 200, 0
    while len(got) < len(data) and time.monotonic() < deadline:
        reading = time.monotonic() % 0.1 < 0.05
        new = b"".join(event.data for event in link.port.poll(reading) if isinstance(event, Received))
        most = max(most, len(new))
        got += new
        time.sleep(0.001)
    done.set()
    while driver.is_alive():
        link.port.poll()
        time.sleep(0.001)
    link.close()
    say(f"flood {chip}", is_equal=bytes(got) == data, most=most)


def main() -> None:
    port, usbip, reader, count = int(sys.argv[1]), *sys.argv[2:4], int(sys.argv[4])
    host = os.environ["KERNEL_GUEST_HOST"]
    by_program(usbip, host, port)
    for busid, node in (("1-1", "ttyACM0"), ("1-2", "ttyUSB0")):
        number = attached(host, port, busid, node)
        lines = subprocess.run(
            [reader, f"/dev/{node}", str(COUNT)], capture_output=True, text=True, timeout=120, check=True
        )
        readings = [np.frombuffer(bytes.fromhex(each), "<f4").astype(float).tolist() for each in lines.stdout.split()]
        say(f"C++ {node}", readings=readings)
        alone = ["unshare", "--mount", "bash", "-e", "-c", NAMESPACE.format(node=node), "bash"]
        say(f"namespace {node}", readings=python_driver(node, *alone))
        vhci.detach(number)
    unplugs(host, port, count)
    for chip in ("cdc", "ftdi", "cp210x", "ch341"):
        with contextlib.suppress(AssertionError):
            flood(chip)


if __name__ == "__main__":
    main()
