"""Drivers' ends of the devices in ``usb_devices.py``: hidapi, the node itself, pyusb."""

import contextlib
import struct

import libusb_package
import usb.core


def keys(report: bytes) -> list[int]:
    return list(struct.unpack(">Lh20H", bytes(report)[:46])[2:])


def by_hidapi(library, count: int) -> list:
    """Return readings as the reader of HAND takes them: the first interface of the vendor, 46 bytes."""
    path = next(each for each in library.enumerate() if each["vendor_id"] == 0x16C0 and each["interface_number"] == 0)
    device = library.device()
    device.open_path(path["path"])
    readings = [keys(bytes(device.read(46, 2000))) for _ in range(count)]
    # A late reader loses reports, also an answer, and finds old ones first: it asks again.
    for _ in range(10):
        device.write(b"\0" + b"?" + bytes(63))
        if any(bytes(device.read(64, 2000))[:2] == b"\xff\0" for _ in range(50)):
            break
    else:
        raise AssertionError("no answer to an output report")
    device.close()
    return readings


def by_node(count: int) -> list:
    with open("/dev/hidraw0", "r+b", buffering=0) as node:
        return [keys(node.read(64)) for _ in range(count)]


def by_pyusb(count: int) -> list:
    pad = usb.core.find(idVendor=0x1209, idProduct=0x0002, backend=libusb_package.get_libusb1_backend())
    assert pad is not None
    pad.set_configuration()
    for _ in range(40):  # what has waited since the kernel has configured it
        with contextlib.suppress(usb.core.USBTimeoutError):
            pad.read(0x81, 512, 1000)
    return [list(struct.unpack(">100H", bytes(pad.read(0x81, 512, 2000)))) for _ in range(count)]
