"""``tactemu devices``: the table of devices, and the datasheet of one."""

from __future__ import annotations

import inspect
import json as json_module
import sys
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

import firmware_protocols
from firmware_protocols import CanWire, Device, Frame, SerialWire, Wire
from firmware_protocols.device import Layout, Patch
from tactemu.cli.heatmap import flattened
from tactemu.scene.file import load_device

MAX_LISTED = 100
"""Taxels that are listed one by one; of more than these, patches are."""
MAX_PITCHES = 40
"""A picture of a free layout is no wider than this many taxels."""


def print_table(*, json: bool = False) -> None:
    """Name, wire, taxels, rate, evidence and judge of every device."""
    rows = [_row(name, load_device(name)()) for name in firmware_protocols.names()]
    if json:
        print(json_module.dumps(rows))
        return
    table = Table(box=box.SIMPLE_HEAD)
    for title in ("name", "what", "wire", "taxels", "rate", "evidence", "read by"):
        table.add_column(title, no_wrap=title == "name", justify="right" if title in ("taxels", "rate") else "left")
    for row in rows:
        evidence = ", ".join(row["evidence"])
        table.add_row(
            row["name"], row["title"], ", ".join(row["wires"]), str(row["taxels"]), f"{row['rate_hz']:g} Hz", evidence,
            row["judge"],
        )  # fmt: skip
    Console(highlight=False, width=None if sys.stdout.isatty() else 160).print(table)


def describe_wire(wire: Wire) -> str:
    """``serial 115200 8N1``, ``USB serial``, ``CAN 1 Mbit/s``, ``TCP port 6000``."""
    if isinstance(wire, SerialWire):
        frame = f"{wire.baud} {wire.bytesize}{wire.parity}{wire.stopbits}"
        return f"{'USB serial' if wire.usb else 'serial'} {frame}"
    if isinstance(wire, CanWire):
        data = f" / {wire.data_bitrate / 1e6:g}" if wire.data_bitrate else ""
        return f"CAN{'-FD' if data else ''} {wire.bitrate / 1e6:g}{data} Mbit/s"
    return f"TCP port {wire.port}"


def print_datasheet(name: str, *, json: bool = False) -> None:
    """Wire, frames, commands, taxel map, sources and assumptions of one device.

    Raises:
        DeviceError: no such device.
    """
    device = load_device(name)()
    if json:
        layout = device.layout
        entry = _row(name, device) | {
            "positions_m": layout.positions.tolist(),
            "normals": layout.normals.tolist(),
            "wire_order": layout.wire_order.tolist(),
            "sources": list(device.sources),
            "assumed": list(device.assumed),
        }
        print(json_module.dumps(entry))
        return
    print("\n".join(datasheet(name, device)))


def _row(name: str, device: Device) -> dict[str, Any]:
    return {
        "name": name,
        "title": device.title,
        "wires": [describe_wire(wire) for wire in device.wires],
        "taxels": len(device.layout),
        "senses": device.senses,
        "rate_hz": device.rate_hz,
        "evidence": list(device.evidence),
        "judge": device.judge,
    }


def datasheet(name: str, device: Device) -> list[str]:
    """The lines of a datasheet."""
    lines = [f"{name}: {device.title}", "", *frame_page(device), "", "Wires"]
    lines += [f"  {describe_wire(wire)}" for wire in device.wires]
    lines += ["", f"Senses {device.senses} at {device.rate_hz:g} Hz with {len(device.layout)} taxels"]
    lines += _options(device) + _commands(device) + taxel_map(device.layout)
    lines += ["", f"Evidence: {', '.join(device.evidence)}", f"Read by: {device.judge}"]
    lines += ["Sources", *(f"  {source}" for source in device.sources)]
    lines += ["Assumed (no source states it)", *(f"  {item}" for item in device.assumed or ("nothing",))]
    return lines


def frame_page(device: Device) -> list[str]:
    """The frame table of a device, with the evidence for it: the docstring of its file."""
    return (inspect.getdoc(sys.modules[type(device).__module__]) or "").splitlines()


def _options(device: Device) -> list[str]:
    parameters = inspect.signature(type(device)).parameters.values()
    return ["", "Options (device_options)", *(f"  {parameter}" for parameter in parameters)] if parameters else []


def _commands(device: Device) -> list[str]:
    if not device.commands:
        return ["", "Commands: none"]
    lines = ["", "Commands"]
    for command in device.commands:
        lines.append(f"  {command.name:<24} {shown(command.request):<40} {command.about}".rstrip())
    return lines


def shown(frame: Frame) -> str:
    """A frame in hex, or in candump notation; long ones cut."""
    whole = frame.hex(" ") if isinstance(frame, bytes) else str(frame)
    return whole if len(whole) <= 40 else whole[:39] + "…"


# -- taxels ------------------------------------------------------------------------------------------------------------


def taxel_map(layout: Layout) -> list[str]:
    """Every patch as a picture of taxel numbers, then the table of positions; of many taxels a line for each patch."""
    if len(layout) > MAX_LISTED:
        return _patches(layout)
    lines = [""]
    for patch in layout.patches:
        lines += [f"Patch {patch.name!r}: taxel numbers, seen from outside", *_picture(layout, patch), ""]
    place = np.argsort(layout.wire_order)
    lines.append("taxel  on wire     x/mm     y/mm     z/mm   normal")
    for k, (position, normal) in enumerate(zip(layout.positions * 1e3, layout.normals, strict=True)):
        x, y, z = position + 0.0
        u, v, w = np.where(np.abs(normal) < 5e-4, 0.0, normal)
        lines.append(f"{k:5d}  {place[k]:7d}  {x:7.2f}  {y:7.2f}  {z:7.2f}   {u:6.3f} {v:6.3f} {w:6.3f}")
    return lines


def _patches(layout: Layout) -> list[str]:
    lines = ["", "Taxels, patch by patch; positions in mm, each of them with --json"]
    width = max(len(patch.name) for patch in layout.patches)
    for patch in layout.patches:
        numbers = np.arange(len(layout))[patch.taxels]
        first, last = layout.positions[numbers[[0, -1]]] * 1e3 + 0.0
        size = f"{patch.rows} rows of {patch.cols}" if patch.rows else f"{len(numbers)} taxels"
        places = (", ".join(f"{x:.2f}" for x in place) for place in (first, last))
        lines.append(f"  {patch.name:<{width}}  {numbers[0]} to {numbers[-1]}, {size}, from ({') to ('.join(places)})")
    return lines


def _picture(layout: Layout, patch: Patch) -> list[str]:
    numbers = np.arange(len(layout))[patch.taxels]
    width = len(str(numbers.max(initial=0))) + 1
    if patch.rows:
        grid = numbers.reshape(patch.rows, patch.cols)
        return ["  " + "".join(f"{number:{width}d}" for number in row) for row in grid]
    flat = flattened(layout.positions[patch.taxels], layout.normals[patch.taxels])
    flat = flat - flat.min(axis=0)
    # One row of text is about as high as two characters are wide.
    pitch = max(layout.pitch, float(flat[:, 0].max(initial=0.0)) / MAX_PITCHES, 1e-9)
    columns, rows = (np.rint(flat / (0.5 * pitch)).astype(int)).T
    lines: dict[int, list[tuple[int, int]]] = {}
    for number, column, row in zip(numbers, columns, rows, strict=True):
        lines.setdefault(int(row), []).append((int(column), int(number)))
    picture = []
    for row in range(int(rows.max()), -1, -1):
        text = ""
        for column, number in sorted(lines.get(row, [])):
            text = text.ljust(column * width) + f"{number:{width}d}"
        picture.append("  " + text)
    return picture
