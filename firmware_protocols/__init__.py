"""What real tactile sensors say on their wires. Needs numpy only; knows nothing of simulation, ports or clocks.

>>> import firmware_protocols as fp
>>> device = fp.create("anyskin")
>>> counts = device.feel(fp.Reading({"force": ...}), t_ns=0)
>>> device.stream(0, "")      # -> frames
"""

from __future__ import annotations

from firmware_protocols.commands import Command
from firmware_protocols.connectors import USB, Can, Connector, Rs485, Serial, Tcp, Udp
from firmware_protocols.device import (
    Column,
    Convert,
    Counts,
    Device,
    Outs,
    Quantity,
    Reading,
    Restart,
    Rollover,
    Sense,
    Sent,
    Stream,
)
from firmware_protocols.frames import CanFrame, Frame
from firmware_protocols.layouts import Layout, Patch, grid_layout, points
from firmware_protocols.options import Option
from firmware_protocols.registry import DEVICES, create, load, names

__all__ = [
    "DEVICES", "USB", "Can", "CanFrame", "Column", "Command", "Connector", "Convert", "Counts", "Device", "Frame",
    "Layout", "Option", "Outs", "Patch", "Quantity", "Reading", "Restart", "Rollover", "Rs485", "Sense", "Sent",
    "Serial", "Stream", "Tcp", "Udp", "create", "grid_layout", "load", "names", "points",
]  # fmt: skip
