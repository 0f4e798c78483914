"""The files of a UART of the board itself in sysfs and in udev's data: ``ttyS0`` of a PC, ``ttyAMA0``, ``ttyTHS1``.

A UART has no USB ids. It is identified by the bus of its device: pyserial lists UARTs on ``pnp`` and ``amba``, but not
those on ``platform``, which a driver opens by name. Like all modules of the keeper, this one needs nothing but the
standard library.
"""

from __future__ import annotations

from dataclasses import dataclass

ROOT = "/sys/devices/tactemu"
"""The folder of the emulated devices."""


@dataclass(frozen=True)
class Chip:
    """A kind of UART: the bus of its device, its driver, and the address of the first one."""

    bus: str
    driver: str
    address: int
    step: int
    """The difference of the addresses of one UART and the next."""

    def device_name(self, number: int) -> str:
        """Return the name of the device of UART ``number`` on its bus."""
        at = self.address + number * self.step
        return f"00:{at:02x}" if self.bus == "pnp" else f"{at:x}.serial"


CHIPS = {
    "ttyS": Chip("pnp", "serial", 5, 1),
    "ttyAMA": Chip("amba", "uart-pl011", 0x3F20_1000, 0x200),
    "ttyTHS": Chip("platform", "serial-tegra", 0x0310_0000, 0x1_0000),
    "ttymxc": Chip("platform", "imx-uart", 0x0202_0000, 0x4000),
    "ttyO": Chip("platform", "omap_uart", 0x4806_A000, 0x2000),
}
"""The kinds by prefix of the node: PCs, Arm's PL011 (Raspberry Pi), Tegra (Jetson), i.MX, OMAP (BeagleBone)."""


@dataclass(frozen=True)
class Uart:
    """A plugged-in UART, with the interface of :class:`~tactemu.exec.usb.Plugged`."""

    kind: str
    """The prefix of the node, such as ``ttyAMA``."""
    number: int
    pty: tuple[int, int]
    """Major and minor number of its pseudo terminal."""

    @property
    def node(self) -> str:
        """The name of the node, such as ``ttyAMA0``."""
        return f"{self.kind}{self.number}"

    @property
    def chip(self) -> Chip:
        """The kind of this UART."""
        return CHIPS[self.kind]

    @property
    def name(self) -> str:
        """The name of the device on its bus."""
        return self.chip.device_name(self.number)

    @property
    def device(self) -> str:
        """The folder of the device."""
        return f"{ROOT}/{self.chip.bus}/{self.name}"

    @property
    def function(self) -> str:
        """The folder that is removed with the port: that of the device, which has one port."""
        return self.device

    @property
    def tty(self) -> str:
        """The folder of the port, of the class ``tty``."""
        return f"{self.device}/tty/{self.node}"

    def covers(self) -> list[str]:
        """Return the folders of the machine in which it has entries."""
        return [f"/sys/bus/{self.chip.bus}/{folder}" for folder in ("devices", "drivers")]

    def kernel_properties(self) -> dict[str, dict[str, str]]:
        """Return the kernel's properties of each folder, outermost first."""
        major, minor = map(str, self.pty)
        return {
            self.device: {"DRIVER": self.chip.driver, "SUBSYSTEM": self.chip.bus},
            self.tty: {"MAJOR": major, "MINOR": minor, "DEVNAME": self.node, "SUBSYSTEM": "tty"},
        }

    def files(self) -> dict[str, str]:
        """Return every file below the device's folder with its text."""
        found = {f"{self.tty}/dev": f"{self.pty[0]}:{self.pty[1]}", f"{self.tty}/line": str(self.number)}
        for folder, properties in self.kernel_properties().items():
            found[f"{folder}/uevent"] = "\n".join(
                f"{key}={value}" for key, value in properties.items() if key != "SUBSYSTEM"
            )
        if self.chip.bus == "pnp":
            found[f"{self.device}/id"] = "PNP0501"
        return {name: f"{text}\n" for name, text in found.items()}

    def links(self) -> dict[str, str]:
        """Return every link with its target, in the folder and to it."""
        bus = f"/sys/bus/{self.chip.bus}"
        return {
            f"/sys/class/tty/{self.node}": self.tty,
            f"/sys/dev/char/{self.pty[0]}:{self.pty[1]}": self.tty,
            f"{bus}/devices/{self.name}": self.device,
            f"{self.device}/subsystem": bus,
            f"{self.device}/driver": f"{bus}/drivers/{self.chip.driver}",
            f"{self.tty}/device": self.device,
            f"{self.tty}/subsystem": "/sys/class/tty",
        }

    def node_links(self) -> list[str]:
        """Return no links: udev makes those of ``/dev/serial`` for USB only."""
        return []

    def udev_properties(self) -> dict[str, dict[str, str]]:
        """Return the properties that udev's rules add to each folder."""
        return {self.device: {}, self.tty: {"ID_PATH": f"{self.chip.bus}-{self.name}", "TAGS": ":systemd:"}}

    def udev_data(self) -> dict[str, str]:
        """Return the files in ``/run/udev/data`` with their text."""
        lines = ["I:1", *(f"E:{key}={value}" for key, value in self.udev_properties()[self.tty].items())]
        return {f"c{self.pty[0]}:{self.pty[1]}": "\n".join(lines) + "\n"}
