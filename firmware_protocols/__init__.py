"""What real tactile sensors say on their wires. Needs numpy only; knows nothing of simulation, ports or clocks.

>>> import firmware_protocols as fp
>>> device = fp.create("anyskin")
>>> device.sample(fp.Reading(t_ns=0, values=...), t_ns=0)      # -> frames
"""

from __future__ import annotations

import functools
import importlib
import importlib.util
import sys
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType

from firmware_protocols.device import (
    CanFrame,
    CanWire,
    Command,
    Delayed,
    Device,
    Frame,
    Layout,
    Outgoing,
    Patch,
    Reading,
    SerialWire,
    TcpWire,
    Wire,
    grid_layout,
)

__all__ = [
    "DEVICES", "CanFrame", "CanWire", "Command", "Delayed", "Device", "Frame", "Layout", "Outgoing", "Patch",
    "Reading", "SerialWire", "TcpWire", "Wire", "create", "grid_layout", "load", "names",
]  # fmt: skip

DEVICES: dict[str, str] = {
    # name: "module:Class", imported only when asked for
    "ability_hand": "firmware_protocols.devices.ability_hand:AbilityHand",
    "flexitac": "firmware_protocols.devices.flexitac:FlexiTac",
    "inspire_rh56dftp": "firmware_protocols.devices.inspire_rh56dftp:InspireRh56dftp",
    "optoforce": "firmware_protocols.devices.optoforce:OptoForce",
    "paxini_gen2": "firmware_protocols.devices.paxini_gen2:PaxiniGen2",
    "paxini_px6ax": "firmware_protocols.devices.paxini_px6ax:PaxiniPx6ax",
    "robotiq_tsf85": "firmware_protocols.devices.robotiq_tsf85:RobotiqTsf85",
    "anyskin": "firmware_protocols.devices.anyskin:AnySkin",
    "icub_skin": "firmware_protocols.devices.icub_skin:IcubSkin",
    "linker_hand_l6": "firmware_protocols.devices.linker_hand:LinkerHandL6",
    "linker_hand_l10": "firmware_protocols.devices.linker_hand:LinkerHandL10",
    "linker_hand_o6": "firmware_protocols.devices.linker_hand:LinkerHandO6",
    "xela_uskin": "firmware_protocols.devices.xela_uskin:XelaUskin",
}

ENTRY_POINT_GROUP = "tactemu.devices"


def names() -> list[str]:
    """Every device that :func:`load` knows by name, those of installed packages included."""
    return sorted({*DEVICES, *(point.name for point in entry_points(group=ENTRY_POINT_GROUP))})


def load(name: str) -> type[Device]:
    """The device class called ``name``: a registered name, or ``path/to/file.py:Class``.

    Raises:
        LookupError: no such device; the message names the nearest.
    """
    if ".py:" in name:
        return _load_file(name)
    if name in DEVICES:
        module, _, attribute = DEVICES[name].partition(":")
        return getattr(importlib.import_module(module), attribute)
    for point in entry_points(group=ENTRY_POINT_GROUP, name=name):
        return point.load()
    raise LookupError(_unknown(name))


def create(name: str, **options) -> Device:
    """A new device by name, powered off, with its options (see the class)."""
    return load(name)(**options)


def _load_file(target: str) -> type[Device]:
    path, _, attribute = target.rpartition(":")
    if not Path(path).is_file():
        raise LookupError(f"no such device file: {path}")
    module = _module_of(Path(path).resolve(), Path(path).stat().st_mtime_ns)
    if not hasattr(module, attribute):
        raise LookupError(f"{path} has no class {attribute!r}")
    return getattr(module, attribute)


@functools.cache
def _module_of(path: Path, _written_ns: int) -> ModuleType:
    """A device file, executed once until it is written anew: whoever asks again gets the same classes."""
    spec = importlib.util.spec_from_file_location(f"device_file_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise LookupError(f"not a Python file: {path}")
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _unknown(name: str) -> str:
    from difflib import get_close_matches

    near = get_close_matches(name, names(), n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"unknown device {name!r}{hint} (known: {', '.join(names())})"
