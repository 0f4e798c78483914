"""The file of a state: an uncompressed ``.npz`` of NumPy with a tree of plain data as JSON, and the arrays in it.

Nothing in it is ever unpickled. Its content is not trusted: nothing is larger in memory than the file.
"""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Mapping
from typing import IO, Any

import numpy as np

_TREE = "tree"
_MAX_TEXT_BYTES = 16 << 20
"""Maximum size of the JSON texts; a hand of a thousand taxels has half a megabyte."""
_ARRAY_KINDS = "biufcV"
"""Kinds of NumPy types that an array may have: numbers, and records of them."""


def write(file: IO[bytes], state: dict[str, Any], **more: Any) -> None:
    """Write a state, and more JSON data by name."""
    arrays: dict[str, np.ndarray] = {}
    data = {**more, _TREE: _without_arrays(state, arrays)}
    texts = {name: np.frombuffer(json.dumps(each).encode(), np.uint8) for name, each in data.items()}
    np.savez(file, **texts, **arrays)  # type: ignore[arg-type]


def read(data: bytes, name: str = "") -> tuple[dict[str, Any], Any]:
    """Return the state in the bytes of a file, and the JSON data of a name, if one is given.

    Raises:
        ValueError: the bytes are no such file.
    """
    try:
        members = _members(data)
        more = json.loads(_text(members, name)) if name else None
        tree = json.loads(_text(members, _TREE))
        arrays = {key: _array(key, each) for key, each in members.items() if key not in (name, _TREE)}
        state = _with_arrays(tree, arrays)
    except (KeyError, TypeError, RecursionError) as error:
        raise ValueError(f"not the text of a state: {type(error).__name__} {error}") from None
    except (zipfile.BadZipFile, NotImplementedError, EOFError) as error:
        raise ValueError(str(error)) from None
    if not isinstance(state, dict):
        raise ValueError(f"not the text of a state: a {type(state).__name__}")
    return state, more


def to_bytes(state: dict[str, Any]) -> bytes:
    """Return a state as the bytes of a file."""
    file = io.BytesIO()
    write(file, state)
    return file.getvalue()


def _without_arrays(value: Any, arrays: dict[str, np.ndarray]) -> Any:
    if isinstance(value, np.ndarray):
        arrays[name := f"a{len(arrays)}"] = value
        return {"array": name}
    if isinstance(value, bytes):
        return {"bytes": value.hex()}
    if isinstance(value, list):
        return [_without_arrays(each, arrays) for each in value]
    if isinstance(value, dict):
        return {"dict": [[key, _without_arrays(each, arrays)] for key, each in value.items()]}
    return value


def _with_arrays(value: Any, arrays: dict[str, np.ndarray]) -> Any:
    if isinstance(value, list):
        return [_with_arrays(each, arrays) for each in value]
    if not isinstance(value, dict):
        return value
    ((kind, held),) = value.items()
    if kind == "array":
        return arrays.pop(held)  # once each: a tree that names one twice was not written by us
    return bytes.fromhex(held) if kind == "bytes" else {key: _with_arrays(each, arrays) for key, each in held}


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
