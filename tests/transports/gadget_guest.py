"""The guest's part of ``test_gadget.py``, on the kernel's own pair of host and device controller (dummy_hcd).

``gadget_guest.py COUNT`` runs the script of ``tactemu gadget`` for each device, with a quick player in place of
``tactemu run``, reads the device with a driver, ends the script, and prints a JSON object a line.
``gadget_guest.py play DEVICE PORT FILE`` is the player.
"""

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
OWN = "tests/transports/usb_devices.py"
CASES = {
    # device: (node, command of its driver)
    "anyskin": "ttyACM0",
    f"{OWN}:AnySkinFtdi": "ttyUSB0",
    f"{OWN}:AnySkinCp210x": "ttyUSB0",
    f"{OWN}:AnySkinCh341": "ttyUSB0",
    f"{OWN}:ForceKeys": "hidraw0",
    f"{OWN}:BulkPad": "bulk",
}


def play(device: str, port: str, file: str) -> None:
    from tests.transports.played import Played

    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: ended.set())
    with Played(device, port) as played:
        ended.wait()
        samples = [np.ravel(sample.counts).tolist() for sample in played.truth.samples]
    Path(file).write_text(json.dumps(samples))


def wait(condition, seconds: float = 60.0) -> bool:
    deadline = time.monotonic() + seconds
    while not (met := condition()) and time.monotonic() < deadline:
        time.sleep(0.05)
    return bool(met)


def readings(node: str, count: str) -> list:
    """Return what a driver reads; every library but pyusb knows the node."""
    if node.startswith("tty"):
        assert wait(lambda: os.path.exists(f"/dev/{node}")), f"no {node}"
        command = [sys.executable, ROOT / "tests/drivers/scripts/anyskin_read.py", "anyskin", f"/dev/{node}", count]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
        assert done.returncode == 0, done.stderr[-2000:]
        return json.loads(done.stdout.splitlines()[-1])["readings"]
    import libusb_package
    import usb.core

    from tests.transports import usb_raw_ends

    backend = libusb_package.get_libusb1_backend()
    if node == "hidraw0":
        assert wait(lambda: os.path.exists("/dev/hidraw0")), "no hidraw0"
        return usb_raw_ends.by_node(int(count))
    assert wait(lambda: usb.core.find(idVendor=0x1209, idProduct=0x0002, backend=backend)), "no bulk pad"
    return usb_raw_ends.by_pyusb(int(count))


def run(device: str, node: str, count: str) -> dict:
    from firmware_protocols import create
    from tactemu.cli.gadgets import script

    file = f"/run/{node}.json"
    text = script(create(device).ports[0], [device], controller="", name="tactemu")
    player = f"{sys.executable} {Path(__file__)} play {device}"
    text, found = re.subn(r"^.* run .* --port \"\$port\" &$", f'{player} "$port" {file} &', text, flags=re.MULTILINE)
    assert found == 1, text
    shell = subprocess.Popen(["sh", "-c", text], cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)})
    try:
        read = readings(node, count)
    finally:
        shell.terminate()
        status = shell.wait(60)
    samples = {np.array(each, float).tobytes() for each in json.loads(Path(file).read_text())}
    equal = sum(np.array(each, float).ravel().tobytes() in samples for each in read)
    left = [str(each) for each in (*Path("/sys/kernel/config/usb_gadget").iterdir(), *Path("/dev").glob("ffs-*"))]
    return {"device": device, "equal": equal, "read": len(read), "status": status, "left": left}


if __name__ == "__main__":
    if sys.argv[1] == "play":
        play(*sys.argv[2:])
    else:
        for device, node in CASES.items():
            try:
                print(json.dumps(run(device, node, sys.argv[1])), flush=True)
            except Exception as error:
                print(json.dumps({"device": device, "error": f"{type(error).__name__}: {error}"}), flush=True)
