"""The view's ``/dev``, ``/sys`` and ``/run/udev``: those of the machine, with the emulated devices added.

A folder that needs additions is covered by one in memory, in which everything of the machine's folder is mounted or
linked again. The machine's own serial ports are left out, so that a driver under test finds no real hardware to move.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import re
import stat
from pathlib import Path

from tactemu.exec import shared_page, system
from tactemu.exec.uart import CHIPS, Uart
from tactemu.exec.uevents import Events
from tactemu.exec.usb import BUS, Plugged

ROOM = Path("/run/udev/.tactemu")
"""The folder that emulator and preload library share."""
_PORTS = ROOM / "ports"
"""The folder of the shared pages and pipes of all ports."""
_REAL_PORTS = re.compile(rf"(ttyUSB|ttyACM|ttyXRUSB|ttyAP|rfcomm|{'|'.join(CHIPS)})\d+|serial\d*")


class View:
    """The view in the namespaces of this process."""

    def __init__(self):
        self._cover_udev()
        self._cover_dev()
        self._cover_sys()
        self.events = Events(ROOM / "events")
        self._plugged: dict[str, Plugged | Uart] = {}
        """The plugged-in ports, by node."""
        self._covered: set[str] = set()
        """The covered folders of buses other than USB."""
        self._unplugged: dict[str, tuple[int, int]] = {}
        """The pseudo terminals of unplugged nodes, which a driver may still have open: file system and number."""

    # -- making room ---------------------------------------------------------------------------------------------------

    def _cover_udev(self) -> None:
        if not os.path.isdir("/run/udev"):
            _cover("/run")
            os.mkdir("/run/udev")
        _cover("/run/udev")
        ROOM.mkdir()
        _PORTS.mkdir()
        behind = ROOM / "udev-data"
        behind.mkdir()
        if os.path.isdir("/run/udev/data"):
            system.mount("/run/udev/data", str(behind), flags=system.MS_BIND | system.MS_REC)
        _put_memory_over("/run/udev/data")
        for name in os.listdir(behind):  # too many for a mount each
            os.symlink(behind / name, f"/run/udev/data/{name}")
        Path("/run/udev/control").touch()  # libudev checks for it to see that udev runs

    def _cover_dev(self) -> None:
        machine = ROOM / "dev"
        machine.mkdir()
        system.mount("/dev", str(machine), flags=system.MS_BIND | system.MS_REC)
        _cover("/dev", without=_REAL_PORTS)
        if not os.path.islink("/dev/ptmx"):  # it works only beside the machine's `pts`
            system.unmount("/dev/ptmx")
            os.unlink("/dev/ptmx")
            os.symlink(machine / "ptmx", "/dev/ptmx")

    def _cover_sys(self) -> None:
        _cover("/sys/devices")
        _cover("/sys/class/tty", without=_REAL_PORTS)
        _cover("/sys/dev/char")
        _cover("/sys/bus")
        for folder in ("usb/devices", "usb/drivers", "usb-serial/devices", "usb-serial/drivers"):
            _cover(f"/sys/bus/{folder}", without=_REAL_PORTS)
        taken = [int(name[3:]) for name in os.listdir("/sys/bus/usb/devices") if re.fullmatch(r"usb\d+", name)]
        self._bus = max(taken, default=0) + 1

    # -- plug and unplug -----------------------------------------------------------------------------------------------

    def plug(self, usb: dict, pty: str, *, number: int | None, hub_port: int) -> tuple[str, list[int]]:
        """Plug a device in: create the node, sysfs, udev's data and links, then send the events.

        Args:
            usb: vid, pid, manufacturer, product, serial, interface, node (``ttyACM``, ``ttyUSB``); for a UART of the
                board itself only the node is used (``ttyS``, ``ttyAMA`` ...).
            pty: the path of the pseudo terminal.
            number: the number of the node; None: the lowest free one, as in the kernel.
            hub_port: the number of the hub's port that the device is plugged into.

        Returns:
            The name of the node, and the descriptors of the port's page and pipe.
        """
        kind = usb["node"]
        number = self._free(kind) if number is None else number
        node = f"{kind}{number}"
        if node in self._plugged:
            raise ValueError(f"/dev/{node} exists already")
        self._unplugged.pop(node, None)
        if kind in CHIPS:
            device = Uart(kind, number, _number(pty))
            self._make_room(device.covers())
        else:
            device = Plugged(**{**usb, "node": node}, pty=_number(pty), bus=self._bus, hub_port=hub_port)
        shared = shared_page.create(_PORTS, device.pty, number)
        _mount_file(pty, f"/dev/{node}")
        others = self._others()
        self._write(device, others)
        self._plugged[node] = device
        self._tell("add", device, others)
        return node, shared

    def replace(self, node: str, pty: str) -> list[int]:
        """Exchange the pseudo terminal behind a node without events, and return the descriptors of page and pipe."""
        before = self._plugged.pop(node)
        others = self._others()
        self._erase(before, keep=others)
        system.unmount(f"/dev/{node}")
        device = dataclasses.replace(before, pty=_number(pty))
        shared = shared_page.create(_PORTS, device.pty, int(re.sub(r"\D", "", node)))
        system.mount(pty, f"/dev/{node}", flags=system.MS_BIND)
        self._write(device, others)
        self._plugged[node] = device
        return shared

    def unplug(self, node: str) -> None:
        """Unplug a device, whose pseudo terminal is hung up already."""
        device = self._plugged.pop(node)
        keep = self._others()
        self._unplugged[node] = (os.stat(f"/dev/{node}").st_dev, os.makedev(*device.pty))
        system.unmount(f"/dev/{node}")
        os.unlink(f"/dev/{node}")
        self._erase(device, keep)
        self._tell("remove", device, keep)
        self.events.tidy()

    def unplug_all(self) -> None:
        """Unplug all devices, after the emulator has ended."""
        for node in list(self._plugged):
            self.unplug(node)

    def _make_room(self, folders: list[str]) -> None:
        for folder in folders:
            if folder not in self._covered:
                _cover(folder)
                self._covered.add(folder)

    def _others(self) -> set[str]:
        """Return the folders and links of all plugged-in ports; ports of one board share some of them."""
        return {path for each in self._plugged.values() for path in (*each.kernel_properties(), *each.links())}

    def _free(self, kind: str) -> int:
        """Return the lowest number that is not taken, not even by an unplugged port that a driver still has open."""
        held = None
        number = 0
        while True:
            node = f"{kind}{number}"
            if node in self._unplugged:
                held = _held() if held is None else held
                if self._unplugged[node] not in held:
                    del self._unplugged[node]
            if node not in self._plugged and node not in self._unplugged:
                return number
            number += 1

    def _write(self, device: Plugged | Uart, others: set[str]) -> None:
        for path, text in device.files().items():
            if os.path.dirname(path) not in others:
                os.makedirs(os.path.dirname(path), exist_ok=True)
                Path(path).write_text(text)
        for path, target in device.links().items():
            os.makedirs(os.path.dirname(path), exist_ok=True)
            _link(path, target)
            if target.startswith("/sys/bus"):
                os.makedirs(target, exist_ok=True)
        for name, text in device.udev_data().items():
            path = Path("/run/udev/data", name)
            path.unlink(missing_ok=True)
            path.write_text(text)
        for link in device.node_links():
            os.makedirs(os.path.dirname(f"/dev/{link}"), exist_ok=True)
            _link(f"/dev/{link}", f"/dev/{device.node}")

    def _erase(self, device: Plugged | Uart, keep: set[str]) -> None:
        """Remove all files of a port, and those of its device, unless another port of it stays."""
        paths: list[str | Path] = [*shared_page.paths(_PORTS, device.pty)]
        paths += [path for path in device.links() if path not in keep]
        if device.device not in keep:
            paths += [f"/run/udev/data/{each}" for each in device.udev_data()]
        else:
            paths += [f"/run/udev/data/c{device.pty[0]}:{device.pty[1]}"]
        paths += [f"/dev/{link}" for link in device.node_links()]
        for path in map(Path, paths):
            path.unlink(missing_ok=True)
        _remove_tree(device.function if device.device in keep else device.device)
        for folder in ("/dev/serial/by-id", "/dev/serial/by-path", "/dev/serial"):
            with contextlib.suppress(OSError):  # other ports have links there
                os.rmdir(folder)

    def _tell(self, action: str, device: Plugged | Uart, others: set[str]) -> None:
        told, added = device.kernel_properties(), device.udev_properties()
        folders = [folder for folder in told if folder not in others]
        for folder in folders if action == "add" else reversed(folders):
            self.events.send(action, folder.removeprefix("/sys"), told[folder], added[folder])


def _cover(path: str, without: re.Pattern[str] | None = None) -> None:
    """Cover a folder of the machine by one in memory with the same content; create it if it does not exist."""
    behind = os.open(path, os.O_PATH) if os.path.isdir(path) else -1
    _put_memory_over(path)
    if behind < 0:
        return
    for entry in os.listdir(f"/proc/self/fd/{behind}"):
        source, target = f"/proc/self/fd/{behind}/{entry}", f"{path}/{entry}"
        if without and without.fullmatch(entry):
            continue
        mode = os.lstat(source).st_mode
        if stat.S_ISLNK(mode):
            os.symlink(os.readlink(source), target)
        elif stat.S_ISDIR(mode):
            os.mkdir(target)
            system.mount(source, target, flags=system.MS_BIND | system.MS_REC)
        else:
            _mount_file(source, target)
    os.close(behind)


def _put_memory_over(path: str) -> None:
    os.makedirs(path, exist_ok=True)
    system.mount("tmpfs", path, "tmpfs", system.MS_NOSUID, "mode=755")


def _mount_file(source: str, target: str) -> None:
    os.close(os.open(target, os.O_CREAT | os.O_WRONLY, 0o600))
    system.mount(source, target, flags=system.MS_BIND)


def _link(path: str, target: str) -> None:
    with contextlib.suppress(FileNotFoundError):
        os.unlink(path)
    os.symlink(os.path.relpath(target, os.path.dirname(path)), path)


def _number(pty: str) -> tuple[int, int]:
    rdev = os.stat(pty).st_rdev
    return os.major(rdev), os.minor(rdev)


def _remove_tree(folder: str) -> None:
    for here, folders, files in os.walk(folder, topdown=False):
        for name in files + [each for each in folders if os.path.islink(f"{here}/{each}")]:
            os.unlink(f"{here}/{name}")
        os.rmdir(here)


def _held() -> set[tuple[int, int]]:
    """Return file system and number of every device that a process of the view has open."""
    ours = os.stat("/proc/self/ns/mnt").st_ino
    found = set()
    for pid in filter(str.isdigit, os.listdir("/proc")):
        with contextlib.suppress(OSError):  # it has ended meanwhile, or belongs to another user
            if os.stat(f"/proc/{pid}/ns/mnt").st_ino != ours:
                continue
            for fd in os.listdir(f"/proc/{pid}/fd"):
                with contextlib.suppress(OSError):
                    seen = os.stat(f"/proc/{pid}/fd/{fd}")
                    found.add((seen.st_dev, seen.st_rdev))
    return found


__all__ = ["BUS", "ROOM", "View"]
