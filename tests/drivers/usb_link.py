"""The rig's end of a serial port that is a USB device of this machine's own kernel: in a guest with ``vhci-hcd``."""

import contextlib
import threading
import time
from pathlib import Path

from firmware_protocols import Serial
from tactemu import transports
from tactemu.transports.transport import LinesChanged, Received
from tactemu.transports.usb import vhci

APPEARS_S = 60.0


def _nodes() -> set[str]:
    return {str(each) for pattern in ("ttyACM*", "ttyUSB*") for each in Path("/dev").glob(pattern)}


class UsbLink:
    """A device on USB/IP, attached by this process to its own kernel.

    Args:
        chip: the name of the chip.
        connector: the device's.
    """

    def __init__(self, chip: str, connector: Serial):
        self.port = transports.create(f"usbip:{chip}@0")
        self.port.set_connector(connector)
        self.port.open()
        words = self.port.address.split()
        before = _nodes()
        attached: list[int] = []
        host = threading.Thread(target=lambda: attached.append(vhci.attach("127.0.0.1", int(words[2]), words[-1])))
        host.start()
        deadline = time.monotonic() + APPEARS_S
        while not (new := _nodes() - before) or host.is_alive():
            assert time.monotonic() < deadline, "the kernel makes no node"
            self.port.poll()
            time.sleep(0.001)
        self.node, (self.number,) = min(new), attached
        self._events = []

    def filenos(self):
        return self.port.filenos()

    def read(self):
        events, self._events = [*self._events, *self.port.poll()], []
        return [
            event.data if isinstance(event, Received) else event.dtr
            for event in events
            if isinstance(event, (Received, LinesChanged))
        ]

    def unread(self):
        return 0

    def write(self, frame):
        """Write a frame; what nobody has the port open for is lost."""
        deadline = time.monotonic() + 10
        while self.port.has_reader and not self.port.write(frame) and time.monotonic() < deadline:
            self._events += self.port.poll()
            time.sleep(0.001)

    def close(self):
        with contextlib.suppress(OSError):
            vhci.detach(self.number)
        self.port.close()


def open_usb(chip: str, connector: Serial):
    """Return the node of a new USB device, and the rig's end of it."""
    link = UsbLink(chip, connector)
    return link.node, link
