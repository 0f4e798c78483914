"""The file of a state: an uncompressed ``.npz`` of NumPy with its header, its tree of plain data as JSON, and arrays.

Nothing in it is ever unpickled. Its content is not trusted: nothing is larger in memory than the file, and a file that
is much larger than a state of this run can be is refused before it is read.
"""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from firmware_protocols import state as plain
from tactemu.base.errors import StateError
from tactemu.base.files import writing
from tactemu.version import __version__

FORMAT = 1
MAX_TIME_NS = 10 * 366 * 86_400_000_000_000
"""Latest time of a state, ten years: times of a run that begins there still fit 64 bits."""
_HEADER = "header"
_TREE = "tree"
_MAX_TEXT_BYTES = 16 << 20
"""Maximum size of the JSON texts; a hand of a thousand taxels has half a megabyte."""
_MAX_EXTRA_BYTES = 64 << 20
"""Maximum size of the state of devices, queues and the like, beside the simulation."""
_ARRAY_KINDS = "biufcV"
"""Kinds of NumPy types that an array may have: numbers, and records of them."""


def header(recipe: Mapping[str, Any], t_ns: int) -> dict[str, Any]:
    """Return the header of a state: format, version of tactemu, time, and the recipe as texts."""
    return {"format": FORMAT, "tactemu": __version__, "t_ns": t_ns, "made_of": flat(recipe)}


def check_header(found: Any, recipe: Mapping[str, Any], where: str) -> None:
    """Raise if another version wrote the state, or if it is of another scene.

    Raises:
        StateError: names the difference.
    """
    here = header(recipe, 0)
    if not isinstance(found, dict) or found.keys() != here.keys():
        raise StateError(f"{where}: no state of tactemu, or of a much older or newer one")
    for name in ("format", "tactemu"):
        if found[name] != here[name]:
            raise StateError(
                f"{where}: was saved by tactemu {found['tactemu']!s:.40} (format {found['format']!s:.40}), this is "
                f"{here['tactemu']} (format {FORMAT}); a state is for the version that wrote it"
            )
    t_ns = found["t_ns"]
    if type(t_ns) is not int or not 0 <= t_ns <= MAX_TIME_NS:
        raise StateError(f"{where}: its time is {t_ns!r:.40} ns; expected 0 to {MAX_TIME_NS}")
    there = found["made_of"]
    if not isinstance(there, dict):
        raise StateError(f"{where}: its header names no scene")
    differs = [name for name in [*here["made_of"], *there] if here["made_of"].get(name) != there.get(name)]
    if differs:
        lines = [
            f"{name}: saved with {_shown(there, name)}, here {_shown(here['made_of'], name)}"
            for name in dict.fromkeys(differs)
        ]
        more = f"; and {len(lines) - 3} more" if len(lines) > 3 else ""
        raise StateError(f"{where}: is of another run: {'; '.join(lines[:3])}{more}")


def _shown(table: Mapping[str, Any], name: str) -> str:
    return f"{table[name]!s:.60}" if name in table else "nothing"


def flat(tree: Any, name: str = "") -> dict[str, str]:
    """Return a tree of plain data as one table of texts: ``{"skin[0].options.noise": "0.001"}``."""
    if isinstance(tree, Mapping):
        pairs = [(f"{name}.{key}".lstrip("."), value) for key, value in tree.items()]
    elif isinstance(tree, list | tuple):
        pairs = [(f"{name}[{k}]", value) for k, value in enumerate(tree)]
    else:
        return {name: str(tree)}
    found: dict[str, str] = {}
    for key, value in pairs:
        found |= flat(value, key)
    return found


def write(path: str | Path, head: Mapping[str, Any], state: dict[str, Any]) -> int:
    """Write a state; return its size [byte]. An older file of this name stays until the new one is complete.

    Raises:
        StateError: the file cannot be written.
    """
    path = Path(path)
    text, arrays = plain.to_text(state)
    texts = {_HEADER: json.dumps(head), _TREE: text}
    members = {name: np.frombuffer(each.encode(), np.uint8) for name, each in texts.items()} | arrays
    try:
        with writing(path) as file:
            np.savez(file, **members)  # type: ignore[arg-type]
        return path.stat().st_size
    except OSError as error:
        raise StateError(f"{path}: cannot write the state: {error.strerror}") from None


def read(path: str | Path, recipe: Mapping[str, Any], own_bytes: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the header of a file and the state in it.

    Args:
        path: the file.
        recipe: the recipe that the state must have.
        own_bytes: size of the simulation's arrays here; it bounds the size of the file.

    Raises:
        StateError: the file cannot be read, or is no state of such a run; names the reason.
    """
    path = Path(path)
    try:
        size, most = path.stat().st_size, _MAX_EXTRA_BYTES + 4 * own_bytes
        if not path.is_file():
            raise StateError(f"{path}: is no file")
        if size > most:
            raise StateError(f"{path}: has {size} bytes; a state of this run has at most {most}")
        data = path.read_bytes()
    except OSError as error:
        raise StateError(f"{path}: cannot read the state: {error.strerror}") from None
    try:
        members = _members(data)
        head = json.loads(_text(members, _HEADER))
        check_header(head, recipe, str(path))
        arrays = _SingleUseArrays(
            {name: _array(name, each) for name, each in members.items() if name not in (_HEADER, _TREE)}
        )
        return head, plain.from_text(_text(members, _TREE), arrays)
    except (ValueError, KeyError, RecursionError, zipfile.BadZipFile, NotImplementedError, EOFError) as error:
        raise StateError(f"{path}: no state, or a damaged one: {error!s:.200}") from None


class _SingleUseArrays(dict[str, np.ndarray]):
    """Arrays that can be read once each: a tree that names one twice was not written by tactemu."""

    def __getitem__(self, name: str) -> np.ndarray:
        return self.pop(name)


def _members(data: bytes) -> dict[str, memoryview]:
    """Return the members of the file, by name, without further copies.

    Raises:
        ValueError, BadZipFile: it is no zip file, or its members are compressed.
    """
    found, total = {}, 0
    with zipfile.ZipFile(io.BytesIO(data)) as file:
        for info in file.infolist():
            total += info.file_size
            if info.compress_type != zipfile.ZIP_STORED or total > len(data) or info.flag_bits & 1:
                raise ValueError(f"{info.filename!r:.40} is compressed; the members of a state are not")
            found[info.filename.removesuffix(".npy")] = memoryview(file.read(info))
    return found


def _array(name: str, member: memoryview) -> np.ndarray:
    """Return the array of a member, whose shape must fit its bytes.

    Raises:
        ValueError: it is no array of numbers.
    """
    file = io.BytesIO(member[:4096])
    version = np.lib.format.read_magic(file)
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    shape, by_columns, dtype = readers[version](file, max_header_size=4000)
    numbers = member[file.tell() :]
    if dtype.kind not in _ARRAY_KINDS or dtype.hasobject:
        raise ValueError(f"{name}: an array of {dtype}; states have numbers")
    if min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != len(numbers):
        raise ValueError(f"{name}: an array {shape!s:.60} of {dtype} has other than {len(numbers)} bytes")
    return np.frombuffer(numbers, dtype).reshape(shape, order="F" if by_columns else "C")


def _text(members: Mapping[str, memoryview], name: str) -> bytes:
    array = _array(name, members[name])
    if array.dtype != np.uint8 or array.nbytes > _MAX_TEXT_BYTES:
        raise ValueError(
            f"{name}: expected at most {_MAX_TEXT_BYTES} bytes of text, got {array.nbytes} of {array.dtype}"
        )
    return array.tobytes()
