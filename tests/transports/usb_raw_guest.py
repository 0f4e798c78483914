"""The guest's part of ``test_usb_in_a_kernel.py`` for libraries that know USB: a JSON object a line.

``usb_raw_guest.py COUNT``: what each library lists, and readings of the HID and the device of a vendor's class, by
hidapi over libusb, by hidapi over hidraw, by the node itself and by pyusb.
"""

import contextlib
import glob
import json
import struct
import sys
from pathlib import Path

import hid
import hidraw
import libusb_package
import pyudev
import usb.core
from serial.tools import list_ports

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


def keys(report: bytes) -> list[int]:
    return list(struct.unpack(">Lh20H", bytes(report)[:46])[2:])


def by_hidapi(library) -> list:
    """Return readings as the reader of HAND takes them: the first interface of the vendor, 46 bytes."""
    path = next(each for each in library.enumerate() if each["vendor_id"] == 0x16C0 and each["interface_number"] == 0)
    device = library.device()
    device.open_path(path["path"])
    readings = [keys(bytes(device.read(46, 2000))) for _ in range(count)]
    device.write(b"\0" + b"?" + bytes(63))
    answers = [bytes(device.read(64, 2000)) for _ in range(50)]
    assert any(answer[:2] == b"\xff\0" for answer in answers), "no answer to an output report"
    device.close()
    return readings


def by_node() -> list:
    with open("/dev/hidraw0", "r+b", buffering=0) as node:
        return [keys(node.read(64)) for _ in range(count)]


def by_pyusb() -> list:
    pad = usb.core.find(idVendor=0x1209, idProduct=0x0002, backend=libusb_package.get_libusb1_backend())
    assert pad is not None
    pad.set_configuration()
    for _ in range(40):  # what has waited since the kernel has configured it
        with contextlib.suppress(usb.core.USBTimeoutError):
            pad.read(0x81, 512, 1000)
    return [list(struct.unpack(">100H", bytes(pad.read(0x81, 512, 2000)))) for _ in range(count)]


print(json.dumps({"node": "listed", **listed()}), flush=True)
for name, read in (("hidraw0", by_node), ("hidraw", lambda: by_hidapi(hidraw)), ("hid", lambda: by_hidapi(hid))):
    print(json.dumps({"node": name, "readings": read()}), flush=True)
print(json.dumps({"node": "bulk", "readings": by_pyusb()}), flush=True)
