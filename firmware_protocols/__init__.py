"""Firmware models of real tactile sensors: the bytes on their wires, without simulation, ports or clocks.

>>> import firmware_protocols as fp
>>> device = fp.create("anyskin")
>>> counts = device.measure(fp.Reading({"force": ...}), t_ns=0)
>>> device.stream(0, "")      # -> frames

Names are imported on first use, so that asking for the names of devices does not wait for numpy.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # for editors; the table below serves Python
    from firmware_protocols.commands import Command as Command
    from firmware_protocols.connectors import USB as USB
    from firmware_protocols.connectors import Can as Can
    from firmware_protocols.connectors import Connector as Connector
    from firmware_protocols.connectors import Dds as Dds
    from firmware_protocols.connectors import Rs485 as Rs485
    from firmware_protocols.connectors import Serial as Serial
    from firmware_protocols.connectors import Tcp as Tcp
    from firmware_protocols.connectors import Topic as Topic
    from firmware_protocols.connectors import Udp as Udp
    from firmware_protocols.connectors import WebSocket as WebSocket
    from firmware_protocols.device import Column as Column
    from firmware_protocols.device import Convert as Convert
    from firmware_protocols.device import Counts as Counts
    from firmware_protocols.device import Device as Device
    from firmware_protocols.device import Quantity as Quantity
    from firmware_protocols.device import Reading as Reading
    from firmware_protocols.device import Restart as Restart
    from firmware_protocols.device import Rollover as Rollover
    from firmware_protocols.device import Sense as Sense
    from firmware_protocols.device import Sent as Sent
    from firmware_protocols.device import Stream as Stream
    from firmware_protocols.device import Transmissions as Transmissions
    from firmware_protocols.facts import Fact as Fact
    from firmware_protocols.facts import assumed as assumed
    from firmware_protocols.facts import measured as measured
    from firmware_protocols.facts import stated as stated
    from firmware_protocols.frames import CanFrame as CanFrame
    from firmware_protocols.frames import WireFrame as WireFrame
    from firmware_protocols.layouts import Layout as Layout
    from firmware_protocols.layouts import Patch as Patch
    from firmware_protocols.layouts import grid_layout as grid_layout
    from firmware_protocols.layouts import points as points
    from firmware_protocols.options import Option as Option
    from firmware_protocols.registry import DEVICES as DEVICES
    from firmware_protocols.registry import create as create
    from firmware_protocols.registry import device_class as device_class
    from firmware_protocols.registry import names as names

_PUBLIC = {
    # module: its public names
    "commands": ("Command",),
    "connectors": ("USB", "Can", "Connector", "Dds", "Rs485", "Serial", "Tcp", "Topic", "Udp", "WebSocket"),
    "device": (
        "Column", "Convert", "Counts", "Device", "Quantity", "Reading", "Restart", "Rollover", "Sense", "Sent",
        "Transmissions",
        "Stream",
    ),
    "facts": ("Fact", "assumed", "measured", "stated"),
    "frames": ("CanFrame", "WireFrame"),
    "layouts": ("Layout", "Patch", "grid_layout", "points"),
    "options": ("Option",),
    "registry": ("DEVICES", "create", "device_class", "names"),
}  # fmt: skip
_MODULE_OF = {name: module for module, names in _PUBLIC.items() for name in names}

__all__ = list(_MODULE_OF)  # pyright: ignore[reportUnsupportedDunderAll]


if not TYPE_CHECKING:  # a type checker would accept any name of a module that has __getattr__

    def __getattr__(name: str):
        if name not in _MODULE_OF:
            raise AttributeError(f"module 'firmware_protocols' has no attribute {name!r}")
        found = globals()[name] = getattr(importlib.import_module(f"firmware_protocols.{_MODULE_OF[name]}"), name)
        return found


def __dir__():
    return __all__
