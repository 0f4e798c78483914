"""The guest's part of ``test_usb_in_a_kernel.py`` for libraries that know USB: a JSON object a line.

``usb_raw_guest.py COUNT``: what each library lists, and readings of the HID and the device of a vendor's class, by
hidapi over libusb, by hidapi over hidraw, by the node itself and by pyusb.
"""

import glob
import json
import sys
from functools import partial
from pathlib import Path

import hid
import hidraw
import libusb_package
import pyudev
import usb.core
from serial.tools import list_ports

from tests.transports.usb_raw_ends import by_hidapi, by_node, by_pyusb

count = int(sys.argv[1])


def listed() -> dict:
    """Return the devices as each library finds them: ids, strings, and the interface where it tells one."""
    devices = list(pyudev.Context().list_devices(subsystem="usb", DEVTYPE="usb_device"))
    told = [[each.attributes.asstring(key) for key in ("idVendor", "idProduct")] for each in devices]
    found = usb.core.find(find_all=True, backend=libusb_package.get_libusb1_backend())
    return {
        "pyserial": [
            [f"{each.vid:04x}", f"{each.pid:04x}", each.manufacturer, each.product, each.serial_number, each.name]
            for each in list_ports.comports()
            if each.vid
        ],
        "pyudev": told,
        "pyusb": [[f"{each.idVendor:04x}", f"{each.idProduct:04x}", each.manufacturer, each.product] for each in found],
        "hidapi": [
            [each["vendor_id"], each["product_id"], each["manufacturer_string"], each["product_string"],
             each["serial_number"], each["interface_number"]]
            for each in hid.enumerate()
        ],
        "hidraw": [[each["vendor_id"], each["usage_page"], each["usage"]] for each in hidraw.enumerate()],
        "descriptors": [Path(each).read_bytes().hex() for each in glob.glob("/sys/bus/usb/devices/*/descriptors")],
    }  # fmt: skip


print(json.dumps({"node": "listed", **listed()}), flush=True)
for name, read in (("hidraw0", by_node), ("hidraw", partial(by_hidapi, hidraw)), ("hid", partial(by_hidapi, hid))):
    print(json.dumps({"node": name, "readings": read(count)}), flush=True)
print(json.dumps({"node": "bulk", "readings": by_pyusb(count)}), flush=True)
