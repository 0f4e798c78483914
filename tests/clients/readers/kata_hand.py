"""Read five fingers with the repository's ``Hand``: ``kata_hand.py CHECKOUT ADDRESS``, 80 readings and 20 more.

It runs in ``scripts/kernel-guest``, attaches the board there, and prints lines for ``TACTEMU_ROWS``: the guest's files
vanish with it. ``toon`` and ``hidapi`` are installed.
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

number = sys.argv[2].split("--tcp-port ")[1].split()[0]
host = os.environ["KERNEL_GUEST_HOST"]
program = [os.environ["TACTEMU_PYTHON"], "-m", "tactemu", "attach", f"{host}:{number}"]
keeper = subprocess.Popen(program, stdout=sys.stderr)
while not Path("/dev/hidraw0").exists():
    time.sleep(0.2)
sys.path.insert(0, str(Path(sys.argv[1]) / "example_devices"))
import hid  # noqa: E402  # without udev its libusb knows only what is there now
from hand import Hand  # noqa: E402  # pyright: ignore[reportMissingImports]

print(json.dumps({"as": "devices", "value": [each["product_string"] for each in hid.enumerate()]}))
for serial_number, readings in ((None, 80), ("1234560", 20)):
    with Hand(serial_number) as hand:
        for _ in range(readings):
            _, forces = hand.read()
            for k in range(5):
                print(json.dumps({"as": f"finger {k}", "values": forces[3 * k : 3 * k + 3].tolist()}))
keeper.terminate()
keeper.wait()
