"""The hardware behind a port, as far as Linux knows it: driver, USB ids, maker and product, serial number."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

_UART_TYPES = {"1": "8250", "2": "16450", "3": "16550", "4": "16550A"}
"""The types of a PC's UARTs: ``PORT_8250`` ... of ``linux/serial_core.h``."""

_IN_BETWEEN = ("", "port", "ctrl")
"""Drivers that newer kernels have between a port and the hardware's own."""


@dataclass(frozen=True)
class Adapter:
    """The hardware behind a port; empty where Linux does not tell."""

    driver: str = ""
    """The driver of the kernel, such as ``ftdi_sio``."""
    usb: str = ""
    """The USB ids of vendor and product, such as ``0403:6001``."""
    title: str = ""
    """The words of the maker and the product, or the type of a UART."""
    serial_number: str = ""

    def __str__(self) -> str:
        number = f"serial number {self.serial_number}" if self.serial_number else ""
        return ", ".join(filter(None, (self.driver, " ".join(filter(None, (self.usb, self.title))), number)))


def tty_adapter(node: str, sys: Path = Path("/sys")) -> Adapter:
    """Return the hardware behind ``/dev/NODE``."""
    folder = sys / "class/tty" / node
    return _adapter(folder, _UART_TYPES.get(_text(folder / "type"), ""))


def net_adapter(name: str, sys: Path = Path("/sys")) -> Adapter:
    """Return the hardware behind a network interface."""
    return _adapter(sys / "class/net" / name, "")


def _adapter(folder: Path, title: str) -> Adapter:
    device = Path(os.path.realpath(folder / "device"))
    driver = next((name for at in (device, *device.parents) if (name := _driver(at)) not in _IN_BETWEEN), "")
    usb = next((at for at in (device, *device.parents) if (at / "idVendor").exists()), None)
    if usb is None:
        return Adapter(driver, title=title)
    words = " ".join(filter(None, (_text(usb / "manufacturer"), _text(usb / "product"))))
    return Adapter(driver, f"{_text(usb / 'idVendor')}:{_text(usb / 'idProduct')}", words, _text(usb / "serial"))


def _driver(device: Path) -> str:
    return os.path.basename(os.path.realpath(device / "driver")) if (device / "driver").exists() else ""


def _text(path: Path) -> str:
    try:
        return path.read_text().strip()
    except (OSError, ValueError):
        return ""
