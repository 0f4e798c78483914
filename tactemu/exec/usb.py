"""The files and links of a USB serial port in sysfs and in udev's data, for :mod:`tactemu.exec.view`.

Like all modules of the keeper, this one needs nothing but the standard library.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from tactemu.exec.uart import ROOT

BUS = ROOT
"""The folder of the emulated USB host."""
_DRIVERS = {0x0403: "ftdi_sio", 0x10C4: "cp210x", 0x1A86: "ch341", 0x067B: "pl2303"}
_USB_MAJOR = 189


@dataclass(frozen=True)
class Plugged:
    """A serial port of a USB device that is plugged in."""

    vid: int
    pid: int
    manufacturer: str
    product: str
    serial: str
    interface: int
    node: str
    """The name of the node, such as ``ttyACM0`` or ``ttyUSB1``."""
    pty: tuple[int, int]
    """Major and minor number of its pseudo terminal."""
    bus: int
    hub_port: int
    """The number of the hub's port that the device is plugged into."""

    @property
    def is_acm(self) -> bool:
        """True for CDC-ACM, False for a USB-serial bridge."""
        return self.node.startswith("ttyACM")

    @property
    def name(self) -> str:
        """The name of the device on the bus, such as ``9-1``."""
        return f"{self.bus}-{self.hub_port}"

    @property
    def device(self) -> str:
        """The folder of the device."""
        return f"{BUS}/usb{self.bus}/{self.name}"

    @property
    def function(self) -> str:
        """The folder of its interface."""
        return f"{self.device}/{self.name}:1.{self.interface}"

    @property
    def tty(self) -> str:
        """The folder of the port, of the class ``tty``."""
        return f"{self.function}/tty/{self.node}" if self.is_acm else f"{self.function}/{self.node}/tty/{self.node}"

    @property
    def driver(self) -> str:
        """The name of the kernel's driver."""
        return "cdc_acm" if self.is_acm else _DRIVERS.get(self.vid, "usbserial_generic")

    @property
    def minor(self) -> int:
        """The minor number of the USB device."""
        return (self.bus - 1) * 128 + self.hub_port

    # -- sysfs -------------------------------------------------------------------------------------------------------

    def kernel_properties(self) -> dict[str, dict[str, str]]:
        """Return the kernel's properties of each folder, outermost first."""
        product = f"{self.vid:x}/{self.pid:x}/100"
        kind = "2/2/1" if self.is_acm else "255/0/0"
        found = {
            self.device: {
                "MAJOR": str(_USB_MAJOR), "MINOR": str(self.minor),
                "DEVNAME": f"bus/usb/{self.bus:03d}/{self.hub_port + 1:03d}", "DEVTYPE": "usb_device", "DRIVER": "usb",
                "PRODUCT": product, "TYPE": "2/0/0" if self.is_acm else "0/0/0",
                "BUSNUM": f"{self.bus:03d}", "DEVNUM": f"{self.hub_port + 1:03d}", "SUBSYSTEM": "usb",
            },
            self.function: {
                "DEVTYPE": "usb_interface", "DRIVER": self.driver, "PRODUCT": product, "INTERFACE": kind,
                "SUBSYSTEM": "usb",
            },
        }  # fmt: skip
        if not self.is_acm:
            found[f"{self.function}/{self.node}"] = {"DRIVER": self.driver, "SUBSYSTEM": "usb-serial"}
        major, minor = self.pty
        found[self.tty] = {"MAJOR": str(major), "MINOR": str(minor), "DEVNAME": self.node, "SUBSYSTEM": "tty"}
        return found

    def device_files(self) -> dict[str, str]:
        """Return the attribute files of the device with their text."""
        texts = {"manufacturer": self.manufacturer, "product": self.product, "serial": self.serial}
        return {
            "idVendor": f"{self.vid:04x}", "idProduct": f"{self.pid:04x}", "bcdDevice": "0100",
            "bDeviceClass": "02" if self.is_acm else "00", "bDeviceSubClass": "00", "bDeviceProtocol": "00",
            "bNumInterfaces": f"{self.interface + 1 + self.is_acm:2d}", "bNumConfigurations": "1",
            "bConfigurationValue": "1", "bmAttributes": "80", "bMaxPower": "100mA", "busnum": str(self.bus),
            "devnum": str(self.hub_port + 1), "devpath": str(self.hub_port), "speed": "12", "version": " 2.00",
            "authorized": "1", "removable": "removable", "dev": f"{_USB_MAJOR}:{self.minor}",
        } | {name: text for name, text in texts.items() if text}  # fmt: skip

    def files(self) -> dict[str, str]:
        """Return every file below the device's folder with its text."""
        found = {f"{self.device}/{name}": text for name, text in self.device_files().items()}
        for folder, properties in self.kernel_properties().items():
            lines = [f"{key}={value}" for key, value in properties.items() if key != "SUBSYSTEM"]
            found[f"{folder}/uevent"] = "\n".join(lines)
        found |= {
            f"{self.function}/bInterfaceNumber": f"{self.interface:02x}",
            f"{self.function}/bInterfaceClass": "02" if self.is_acm else "ff",
            f"{self.function}/bInterfaceSubClass": "02" if self.is_acm else "00",
            f"{self.function}/bInterfaceProtocol": "01" if self.is_acm else "00",
            f"{self.function}/bAlternateSetting": " 0",
            f"{self.tty}/dev": f"{self.pty[0]}:{self.pty[1]}",
        }
        if self.driver == "ftdi_sio":
            found[f"{self.function}/{self.node}/latency_timer"] = "16"
        return {name: f"{text}\n" for name, text in found.items()}

    def links(self) -> dict[str, str]:
        """Return every link with its target, in the folder and to it."""
        found = {
            f"/sys/class/tty/{self.node}": self.tty,
            f"/sys/dev/char/{self.pty[0]}:{self.pty[1]}": self.tty,
            f"/sys/dev/char/{_USB_MAJOR}:{self.minor}": self.device,
            f"/sys/bus/usb/devices/{self.name}": self.device,
            f"/sys/bus/usb/devices/{self.name}:1.{self.interface}": self.function,
            f"{self.function}/driver": f"/sys/bus/usb/drivers/{self.driver}",
            f"{self.tty}/device": self.function if self.is_acm else f"{self.function}/{self.node}",
        }
        for folder, properties in self.kernel_properties().items():
            kind = properties["SUBSYSTEM"]
            found[f"{folder}/subsystem"] = "/sys/class/tty" if kind == "tty" else f"/sys/bus/{kind}"
        if not self.is_acm:
            found |= {
                f"/sys/bus/usb-serial/devices/{self.node}": f"{self.function}/{self.node}",
                f"{self.function}/{self.node}/driver": f"/sys/bus/usb-serial/drivers/{self.driver}",
            }
        return found

    # -- udev --------------------------------------------------------------------------------------------------------

    @property
    def by_id(self) -> str:
        """The name of the link in ``/dev/serial/by-id``."""
        name = "_".join(_plain(text) for text in (*self._names(), self.serial) if text)
        return f"usb-{name}-if{self.interface:02d}" + ("" if self.is_acm else "-port0")

    @property
    def by_path(self) -> str:
        """The name of the link in ``/dev/serial/by-path``."""
        return f"tactemu-usb-{self.bus}:{self.hub_port}:1.{self.interface}" + ("" if self.is_acm else "-port0")

    def node_links(self) -> list[str]:
        """Return the links that udev makes below ``/dev``."""
        return [f"serial/by-id/{self.by_id}", f"serial/by-path/{self.by_path}"]

    def _names(self) -> tuple[str, str]:
        return self.manufacturer or f"{self.vid:04x}", self.product or f"{self.pid:04x}"

    def udev_properties(self) -> dict[str, dict[str, str]]:
        """Return the properties that udev's rules add to each folder."""
        vendor, model = map(_plain, self._names())
        device = {
            "ID_BUS": "usb", "ID_VENDOR": vendor, "ID_VENDOR_ID": f"{self.vid:04x}", "ID_MODEL": model,
            "ID_MODEL_ID": f"{self.pid:04x}", "ID_REVISION": "0100",
            "ID_SERIAL": "_".join(_plain(text) for text in (vendor, model, self.serial) if text),
        } | ({"ID_SERIAL_SHORT": self.serial} if self.serial else {})  # fmt: skip
        port = device | {
            "ID_TYPE": "generic", "ID_USB_DRIVER": self.driver, "ID_USB_INTERFACE_NUM": f"{self.interface:02d}",
            "ID_PATH": f"tactemu-usb-{self.bus}:{self.hub_port}:1.{self.interface}",
            "DEVLINKS": " ".join(f"/dev/{link}" for link in self.node_links()), "TAGS": ":systemd:",
        }  # fmt: skip
        added = {folder: {} for folder in self.kernel_properties()}
        return added | {self.device: device, self.function: {"ID_BUS": "usb"}, self.tty: port}

    def udev_data(self) -> dict[str, str]:
        """Return the files in ``/run/udev/data`` with their text."""
        added = self.udev_properties()
        names = {
            f"c{self.pty[0]}:{self.pty[1]}": self.tty,
            f"c{_USB_MAJOR}:{self.minor}": self.device,
            f"+usb:{self.name}:1.{self.interface}": self.function,
        }
        found = {}
        for name, folder in names.items():
            links = [f"S:{link}" for link in self.node_links()] if folder == self.tty else []
            lines = [*links, "I:1", *(f"E:{key}={value}" for key, value in added[folder].items() if key != "DEVLINKS")]
            found[name] = "\n".join(lines) + "\n"
        return found


def _plain(text: str) -> str:
    """Return a string with the replacements that udev makes for names."""
    return re.sub(r"[^0-9A-Za-z#+\-.:=@_/\\]", "_", text.strip()).replace("/", "_")
