"""What an emulator consists of, as plain data: for whoever draws it, and says what goes over its wires."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from firmware_protocols import Device
from firmware_protocols.check.facts import held
from firmware_protocols.frames import frame_of, text_of
from firmware_protocols.tables import Frame
from tactemu.emulator.channel import Channel
from tactemu.emulator.emulator import Emulator


def described(emulator: Emulator) -> Callable[[], dict[str, Any]]:
    """What gives the description. Call in the loop; what it gives takes long, and may be called in another thread."""
    faults = {channel.name: _faults(channel) for channel in emulator.channels}
    options = {skin["name"] or skin["device"].rpartition(":")[2]: skin for skin in emulator.recipe.get("skin", ())}
    around = emulator.truth.surroundings
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
    """Options that `set` may change, and `dead` if taxels may die."""
    spoil = channel.source.imperfections
    return [] if spoil is None else list(spoil.adjustable)


def _device(device: Device) -> dict[str, Any]:
    """Its frame tables, as text with what is bound; its commands; what rest and rated span its columns have."""
    own = [value for value in vars(device).values() if isinstance(value, Frame)]
    tables = {table.name: table for table in (*held(type(device), Frame), *own)}
    return {
        "tables": [_table(table) for table in tables.values()],
        "commands": [{"name": each.name, "request": text_of(frame_of(each.request))} for each in device.commands],
        "columns": [
            {"name": each.name, "rest": each.rest, "low": each.low, "high": each.high, "unit": each.unit}
            for each in device.columns
        ],
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
