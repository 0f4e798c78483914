"""The guest's part of ``test_usb_in_a_kernel.py``: ``usb_guest.py PORT COUNT NODE...``. Prints a JSON object a line.

The last device of the hub is a CAN adapter. All readers run in this process: a translated guest takes seconds to import
what a reader needs.
"""

import contextlib
import io
import json
import os
import runpy
import subprocess
import sys
import time
from pathlib import Path

import can
import serial

from firmware_protocols import Can
from tactemu import transports
from tactemu.base.errors import TransportError
from tactemu.transports.transport import Counted

ROOT = Path(__file__).parents[2]
number, count, *nodes = sys.argv[1:]
host = os.environ["KERNEL_GUEST_HOST"]


def wait(condition, seconds=30.0):
    deadline = time.monotonic() + seconds
    while not (met := condition()) and time.monotonic() < deadline:
        time.sleep(0.05)
    return bool(met)


def identity(node):
    """Return the ids of the USB device under a node."""
    at = Path("/sys/class/tty", node, "device").resolve()
    while not (at / "idVendor").exists():
        at = at.parent
    return {"vid": (at / "idVendor").read_text().strip(), "pid": (at / "idProduct").read_text().strip()}


def read(script, *arguments):
    """Run one of the readers of ``tests/drivers/scripts`` and return what it prints."""
    sys.argv, printed = [script, *arguments], io.StringIO()
    with contextlib.redirect_stdout(printed):
        runpy.run_path(str(ROOT / "tests/drivers/scripts" / script), run_name="__main__")
    return json.loads(printed.getvalue().splitlines()[-1])


def refusal():
    """Return why a device at 1 Mbit/s may not be on can0, or nothing if it may."""
    port = transports.create("can:socketcan:can0")
    port.set_connector(Can(bitrate=1_000_000))
    try:
        with port:
            return "" if port.is_paced else "not paced by the bus"
    except TransportError as error:
        return str(error)


keeper = subprocess.Popen([sys.executable, "-m", "tactemu", "attach", f"{host}:{number}"], cwd=ROOT)
try:
    for node in nodes:
        assert wait(lambda node=node: os.path.exists(f"/dev/{node}"), 240), f"no {node}"
    for node in nodes:
        readings = read("anyskin_read.py", "anyskin", f"/dev/{node}", count)["readings"]
        print(json.dumps({"node": node, "readings": readings, **identity(node)}), flush=True)
    assert wait(lambda: os.path.exists("/dev/hidraw0"), 60), "no hidraw0"
    raw = [sys.executable, "-m", "tests.transports.usb_raw_guest", str(int(count) // 3)]
    subprocess.run(raw, cwd=ROOT, check=True)
    # At another bit rate nobody acknowledges; then the rate of the bus.
    assert wait(lambda: os.path.exists("/sys/class/net/can0"), 60)
    states, refusals, counted = [], [refusal()], []
    for bitrate in (500_000, 1_000_000):
        subprocess.run(["ip", "link", "set", "can0", "up", "type", "can", "bitrate", str(bitrate)], check=True)
        port = transports.create("can:socketcan:can0")
        port.set_connector(Can(bitrate=bitrate))
        with port, can.Bus(interface="socketcan", channel="can0") as bus:
            with contextlib.suppress(can.CanOperationError):  # frames that nobody acknowledges fill the queue
                for _ in range(40):
                    bus.send(can.Message(arbitration_id=0x123, data=b"?", is_extended_id=False), timeout=1)
            time.sleep(0.5)
            counted.append(sorted({event.counter for event in port.poll() if isinstance(event, Counted)}))
        shown = subprocess.run(["ip", "-json", "-details", "link", "show", "can0"], capture_output=True, check=True)
        states.append(json.loads(shown.stdout)[0]["linkinfo"]["info_data"]["state"])
        refusals.append(refusal())
        if bitrate == 500_000:
            subprocess.run(["ip", "link", "set", "can0", "down"], check=True)
    samples = read("python_can_read.py", "socketcan", "can0", "-", "40")
    said = {"states": states, "refusals": refusals, "counted": counted, "readings": samples}
    print(json.dumps({"node": "can0", **said}), flush=True)
    # The kernel's side of a pulled cable: a driver's read fails, and the keeper attaches the device again.
    with serial.Serial(f"/dev/{nodes[0]}", 115_200, timeout=1) as driver:
        driver.read(10)
        Path("/sys/devices/platform/vhci_hcd.0/detach").write_text("0")
        try:
            error = not wait(lambda: driver.read(100) is None, 10)
        except (serial.SerialException, OSError):
            error = True
    is_back = wait(lambda: os.path.exists(f"/dev/{nodes[0]}"))
    print(json.dumps({"node": "unplugged", "error": error, "is_back": is_back}), flush=True)
finally:
    keeper.terminate()
    keeper.wait()
