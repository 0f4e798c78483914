"""``tactemu devices NAME``: the datasheet of a device, from its declarations."""

from __future__ import annotations

import inspect
import json as json_module
import re
import sys
import typing
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from firmware_protocols import Column, Device
from firmware_protocols.declared import tables_of
from firmware_protocols.facts import Basis, Part
from firmware_protocols.layouts import Layout, Patch
from firmware_protocols.options import declared
from firmware_protocols.registers import RegisterMap
from firmware_protocols.tables import Frame
from tactemu.base.errors import DeviceError
from tactemu.cli.fitting import PIPE_WIDTH, filled, fitted, output_width
from tactemu.scene.building import make_device
from tactemu.session.heatmap import flattened
from tactemu.wire.line_models import line_model_for

MAX_LISTED = 100
"""Maximum number of taxels listed one by one; of more, the patches are listed."""
MAX_PITCHES = 40
"""Maximum width of the picture of a free layout [taxels]."""


def ports_of(device: Device) -> list[str]:
    """Return ``serial 115200 8N1``, ``fingers: USB serial ...``; ports not in use by default are marked."""
    lines = []
    for k, connector in enumerate(device.ports):
        text = line_model_for(connector).describe()
        text = f"{connector.name}: {text}" if connector.name else text
        lines.append(text if connector.is_plugged or not k else f"{text} (if asked for)")
    return lines


def rates_of(device: Device, requested: float | Mapping[str, float] | None = None) -> str:
    """Return ``100 Hz``, or the rate of each stream by name; ``requested`` is the user's."""
    own = {stream: 1e9 / period if period else 0.0 for stream, period in device.periods.items()}
    wanted = requested if isinstance(requested, Mapping) else dict.fromkeys(own, requested) if requested else {}
    rates = {stream: wanted.get(stream) or hz for stream, hz in own.items()}
    said = {stream: f"{hz:g} Hz" if hz else "when asked" for stream, hz in rates.items()}
    return ", ".join(f"{stream} {text}".strip() for stream, text in said.items())


def print_datasheet(name: str, options: Mapping[str, Any] | None = None, *, json: bool = False) -> None:
    """Print ports, frames, commands, taxel map, sources and assumptions of a device.

    Raises:
        DeviceError: no such device, or an option that it does not take.
    """
    device = make_device(name, dict(options or {}))
    if json:
        layout = device.layout
        entry = row_of(name, device) | {
            "positions_m": layout.positions.tolist(),
            "normals": layout.normals.tolist(),
            "wire_order": layout.wire_order.tolist(),
            "sources": list(device.sources),
            "facts": [asdict(fact) for fact in device.facts],
        }
        print(json_module.dumps(entry))
        return
    width = output_width()
    print("\n".join(fitted(datasheet(name, device, width), width)))


def row_of(name: str, device: Device) -> dict[str, Any]:
    """Return the row of a device in the table of devices.

    Raises:
        DeviceError: its class lacks title, evidence or sources.
    """
    missing = [each for each in ("title", "evidence", "sources") if not hasattr(device, each)]
    if missing:
        raise DeviceError(f"its class lacks {', '.join(missing)}")
    return {
        "name": name,
        "title": device.title,
        "kind": device.kind,
        "ports": ports_of(device),
        "taxels": len(device.layout),
        "senses": [sense.key for sense in device.sensed],
        "rate": rates_of(device),
        "evidence": list(device.evidence),
        "judge": device.judge,
    }


def datasheet(name: str, device: Device, width: int = PIPE_WIDTH) -> list[str]:
    """Return the lines of a datasheet, with paragraphs of at most ``width`` characters a line."""
    lines = [f"{name}: {device.title}", "", *frame_page(device, width), *_tables(device), "", "Ports"]
    lines += [f"  {line}" for line in ports_of(device)]
    lines += ["", f"Streams: {rates_of(device)}", "Senses", *_senses(device)]
    if device.columns:
        lines += ["", "What the driver decodes", *(f"  {_column(column)}" for column in device.columns)]
    for roll in device.rollovers:
        lines.append(f"  {roll.name}: {roll.bits} bits, then from 0 again{', a clock' if roll.clock else ''}")
    lines += _options(device) + _commands(device) + taxel_map(device.layout)
    lines += ["", f"Evidence: {', '.join(device.evidence)}", f"Read by: {device.judge}"]
    lines += ["Sources", *(f"  {source}" for source in device.sources)]
    return lines + _facts(device)


def _facts(device: Device) -> list[str]:
    """Return the number of facts of each part by their basis, then every fact."""
    facts = device.facts
    bases = typing.get_args(Basis)
    lines = ["", "Facts besides the byte tables", f"  {'':<14}" + "".join(f"{basis:>10}" for basis in bases)]
    for part in typing.get_args(Part):
        numbers = [sum(fact.part == part and fact.basis == basis for fact in facts) for basis in bases]
        lines.append(f"  {part:<14}" + "".join(f"{number:>10}" for number in numbers))
    for basis in bases:
        own = [_with_single_backticks(f"  {fact.part}: {fact}") for fact in facts if fact.basis == basis]
        lines += [basis.capitalize(), *own] if own else []
    return lines


def _senses(device: Device) -> list[str]:
    lines = []
    for sense in device.sensed:
        points = len(sense.at) if sense.at is not None else 0
        what = sense.quantity if sense.key == sense.quantity else f"{sense.key} ({sense.quantity})"
        lines.append(f"  {what} at {points} points" + (f", {sense.burst} values each" if sense.burst > 1 else ""))
    links = [link for link in device.layout.links if link]
    return lines + ([f"  on the links {', '.join(links)}"] if links else [])


def _column(column: Column) -> str:
    scale = f", {column.counts_per_unit:g} per {column.unit}" if column.counts_per_unit else f" {column.unit}".rstrip()
    moves = {1: ", a push raises it", -1: ", a push lowers it", 0: ""}[column.push]
    return f"{column.name}: {column.low:g} to {column.high:g}, at rest {column.rest:g}{scale}{moves}"


def frame_page(device: Device, width: int) -> list[str]:
    """Return the docstring of a device's file, its frames and the evidence for them, filled to ``width`` characters."""
    text = inspect.getdoc(sys.modules[type(device).__module__]) or ""
    return list(filled(map(_with_single_backticks, text.splitlines()), width))


def _with_single_backticks(line: str) -> str:
    """Return a line with `NAME` for ``NAME``; the columns of a table stay where they are."""
    text, removed = "", 0
    for part in re.split("( {2,})", line):
        if part.isspace():
            part, removed = part + " " * removed, 0
        removed += part.count("``")
        text += part.replace("``", "`")
    return text


def _tables(device: Device) -> list[str]:
    """Return the frame and register tables that the device declares."""
    return [line for table in tables_of(type(device), (Frame, RegisterMap)) for line in ("", *str(table).splitlines())]


def _options(device: Device) -> list[str]:
    options = declared(type(device)).values()
    return ["", "Options (`tactemu run NAME OPTION=VALUE`)", *(f"  {each}" for each in options)] if options else []


def _commands(device: Device) -> list[str]:
    if not device.commands:
        return ["", "Commands: none"]
    lines = ["", "Commands"]
    for command in device.commands:
        port = f" [{command.port}]" if command.port else ""
        lines.append(f"  {command.name + port:<24} {short_frame(command.frame):<40} {command.about}".rstrip())
    return lines


def short_frame(frame: Any) -> str:
    """Return a frame in hex, or in candump notation; long ones are cut."""
    text = frame.hex(" ") if isinstance(frame, bytes) else str(frame)
    return text if len(text) <= 40 else text[:39] + "…"


# -- taxels ------------------------------------------------------------------------------------------------------------


def taxel_map(layout: Layout) -> list[str]:
    """Return every patch as a picture of taxel numbers and the table of positions; of many taxels, one line for each
    patch."""
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
    pitch = max(patch.pitch, float(flat[:, 0].max(initial=0.0)) / MAX_PITCHES, 1e-9)
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
