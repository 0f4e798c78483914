"""The description of an emulator as plain data: for programs that draw it and decode what passes over its wires."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from firmware_protocols import Device
from firmware_protocols.frames import text_of
from firmware_protocols.tables import Frame
from tactemu.emulator.channel import Channel
from tactemu.emulator.emulator import Emulator

_COLUMN_FIELDS = ("name", "axis", "sense", "unit", "counts_per_unit", "shared", "rest", "low", "high")
"""The fields of a column of counts that a description has."""


def described(emulator: Emulator) -> Callable[[], dict[str, Any]]:
    """Return a function that returns the description. Call this in the loop; the function takes long, and another
    thread may call it."""
    faults = {channel.name: _faults(channel) for channel in emulator.channels}
    options = {skin["name"] or skin["device"].rpartition(":")[2]: skin for skin in emulator.recipe.get("skin", ())}
    around = emulator.truth.context
    return lambda: {
        "scene": {} if around is None else around.description(),
        "devices": {
            channel.name: {
                **_device(channel.device),
                "target": options.get(channel.name, {}).get("device"),
                "options": options.get(channel.name, {}).get("device_options", {}),
                "carriers": {port: wire.line_model.kind for port, wire in channel.wires.items()},
                "faults": faults[channel.name],
                "adjustable": _adjustable(channel),
            }
            for channel in emulator.channels
        },
    }


def _faults(channel: Channel) -> list[str]:
    return [str(each) for wire in channel.wires.values() for each in wire.faults]


def _adjustable(channel: Channel) -> list[str]:
    """Return the options that `set` may change, and `dead` if taxels may die."""
    imperfections = channel.source.imperfections
    return [] if imperfections is None else list(imperfections.adjustable)


def _device(device: Device) -> dict[str, Any]:
    """Return the device's frame tables, as text with the bound values; its commands; name, scale, rest and span of its
    columns."""
    from firmware_protocols.declared import frames_of  # only who draws a device needs it

    tables: dict[str, Frame] = {}
    for table in frames_of(device):  # bound ones come first, and stand for those of the class
        tables.setdefault(table.name, table)
    return {
        "tables": [_table(table) for table in tables.values()],
        "commands": [{"name": each.name, "request": text_of(each.frame)} for each in device.commands],
        "columns": [{name: getattr(each, name) for name in _COLUMN_FIELDS} for each in device.columns],
    }


def _table(table: Frame) -> dict[str, Any]:
    state = table.__getstate__()
    order = state["wire_order"]
    bound: Mapping[str, int] = state["bound"]
    return {
        "text": state["text"],
        "bound": {name: int(value) for name, value in bound.items()},
        "wire_order": None if order is None else [int(k) for k in order],
    }
