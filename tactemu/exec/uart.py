"""What a UART of the board itself looks like in sysfs and in udev's data: ``ttyS0`` of a PC, ``ttyAMA0``, ``ttyTHS1``.

It has no ids. What tells it from others is the bus that its device is on: pyserial lists those on ``pnp`` and ``amba``
and leaves out those on ``platform``, which a driver opens by name. Like the rest of what runs in the keeper it needs
nothing but the standard library.
"""

from __future__ import annotations

from dataclasses import dataclass

ROOT = "/sys/devices/tactemu"
"""Where our devices are among the machine's."""


@dataclass(frozen=True)
class Chip:
    """A kind of UART: the bus that its device is on, its driver there, and where it is."""

    bus: str
    driver: str
    address: int
    step: int
    """From one UART to the next, of the address."""

    def device_name(self, number: int) -> str:
        """Name of the device of UART ``number`` on its bus."""
        at = self.address + number * self.step
        return f"00:{at:02x}" if self.bus == "pnp" else f"{at:x}.serial"


CHIPS = {
    "ttyS": Chip("pnp", "serial", 5, 1),
    "ttyAMA": Chip("amba", "uart-pl011", 0x3F20_1000, 0x200),
    "ttyTHS": Chip("platform", "serial-tegra", 0x0310_0000, 0x1_0000),
    "ttymxc": Chip("platform", "imx-uart", 0x0202_0000, 0x4000),
    "ttyO": Chip("platform", "omap_uart", 0x4806_A000, 0x2000),
}
"""By the beginning of the node's name: PCs, Arm's PL011 (Raspberry Pi), Tegra (Jetson), i.MX, OMAP (BeagleBone)."""


@dataclass(frozen=True)
class Uart:
    """One UART that is there; the same questions as to :class:`~tactemu.exec.usb.Plugged`."""

    kind: str
    """``ttyAMA``."""
    number: int
    pty: tuple[int, int]
    """Major and minor of its pseudo terminal."""

    @property
    def node(self) -> str:
        """``ttyAMA0``."""
        return f"{self.kind}{self.number}"

    @property
    def chip(self) -> Chip:
        """What is behind a node of this name."""
        return CHIPS[self.kind]

    @property
    def name(self) -> str:
        """The device's name on its bus."""
        return self.chip.device_name(self.number)

    @property
    def device(self) -> str:
        """The folder of the device."""
        return f"{ROOT}/{self.chip.bus}/{self.name}"

    @property
    def function(self) -> str:
        """The folder that goes with the port: the device has one port."""
        return self.device

    @property
    def tty(self) -> str:
        """The folder of the port, of the class ``tty``."""
        return f"{self.device}/tty/{self.node}"

    def covers(self) -> list[str]:
        """Return the folders of the machine that get something of it."""
        return [f"/sys/bus/{self.chip.bus}/{folder}" for folder in ("devices", "drivers")]

    def kernel_properties(self) -> dict[str, dict[str, str]]:
        """What the kernel says of each folder, outermost first."""
        major, minor = map(str, self.pty)
        return {
            self.device: {"DRIVER": self.chip.driver, "SUBSYSTEM": self.chip.bus},
            self.tty: {"MAJOR": major, "MINOR": minor, "DEVNAME": self.node, "SUBSYSTEM": "tty"},
        }

    def files(self) -> dict[str, str]:
        """Return every file below the device's folder, with its text."""
        found = {f"{self.tty}/dev": f"{self.pty[0]}:{self.pty[1]}", f"{self.tty}/line": str(self.number)}
        for folder, properties in self.kernel_properties().items():
            found[f"{folder}/uevent"] = "\n".join(
                f"{key}={value}" for key, value in properties.items() if key != "SUBSYSTEM"
            )
        if self.chip.bus == "pnp":
            found[f"{self.device}/id"] = "PNP0501"
        return {name: f"{text}\n" for name, text in found.items()}

    def links(self) -> dict[str, str]:
        """Return every link, in the folder and to it."""
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
        """No link: udev makes those of ``/dev/serial`` for USB alone."""
        return []

    def udev_properties(self) -> dict[str, dict[str, str]]:
        """What udev's rules add to each folder."""
        return {self.device: {}, self.tty: {"ID_PATH": f"{self.chip.bus}-{self.name}", "TAGS": ":systemd:"}}

    def udev_data(self) -> dict[str, str]:
        """Return the files of ``/run/udev/data``."""
        lines = ["I:1", *(f"E:{key}={value}" for key, value in self.udev_properties()[self.tty].items())]
        return {f"c{self.pty[0]}:{self.pty[1]}": "\n".join(lines) + "\n"}
