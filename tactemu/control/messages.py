"""The messages on a control socket: requests as they come in, answers as pieces of JSON.

`docs/live-control.md` describes both.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from typing import Annotated, Any, NamedTuple

import numpy as np

from firmware_protocols.bounds import Bounds
from tactemu.base.errors import TactemuError, no_such, shown
from tactemu.base.options import number
from tactemu.control.control_commands import DEFAULT_WATCH_RATE_HZ
from tactemu.control.state import row_of
from tactemu.truth import Sample
from tactemu.truth.jsonl_format import array_text

WatchHertz = Annotated[float, Bounds(unit="Hz", low=0.01, high=120)]
"""The rate at which a client watches the state; bounds the work of the loop."""
WireEntries = Annotated[int, Bounds(low=0, high=200)]
"""The number of frames, faults and events that come with a state."""
_ITEMS_PER_PIECE = 8
"""Number of items of a long list in one piece of a message."""


def parse_request(line: bytes) -> dict[str, Any]:
    """Return the JSON object on a line.

    Raises:
        TactemuError: the line is no JSON object.
    """
    try:
        request = json.loads(line, parse_constant=_refuse_constant)
    except (ValueError, RecursionError):
        request = line
    if not isinstance(request, dict):
        raise TactemuError(f"expected a JSON object on a line, got {shown(request)}")
    return request


def _refuse_constant(constant: str) -> None:
    raise ValueError(f"{constant} is no JSON")


def request_id(request: dict[str, Any]) -> Any:
    """Return the `id` of a request.

    Raises:
        TactemuError: it is no whole number or short text.
    """
    ident = request.get("id")
    if isinstance(ident, float | bool | list | dict) or len(str(ident)) > 100:
        raise TactemuError(f"id: expected a whole number or a short text, got {shown(ident)}")
    return ident


class WatchOptions(NamedTuple):
    """The arguments of `watch`, checked."""

    rate: float
    arrays: bool
    """True for arrays in base64, False for lists."""
    wire: int
    """Number of the latest frames, faults and events that come with a state."""
    skin: str | None


def watch_options(args: dict[str, Any]) -> WatchOptions:
    """Return the arguments of `watch`.

    Raises:
        TactemuError: an argument is unknown, or of a wrong type or value.
    """
    if unknown := [name for name in args if name not in WatchOptions._fields]:
        raise TactemuError(f"watch: {no_such('argument', unknown[0], WatchOptions._fields)}")
    rate = DEFAULT_WATCH_RATE_HZ if args.get("rate") is None else args["rate"]
    rate = number("watch", "rate", rate, WatchHertz)
    arrays = args.get("arrays")
    if arrays not in (None, "lists", "base64"):
        raise TactemuError(f"watch: arrays must be lists or base64, got {shown(arrays)}")
    wire = number("watch", "wire", args.get("wire") or 0, WireEntries)
    skin = args.get("skin")
    if skin is not None and not isinstance(skin, str):
        raise TactemuError(f"watch: skin must be a text, got {shown(skin)}")
    return WatchOptions(rate, arrays == "base64", wire, skin)


def message_pieces(value: Any, as_base64: bool = False) -> Iterator[str]:
    """Yield a message in JSON, in pieces that take little time each. Arrays are lists, or their bytes in base64 with
    their type and shape."""
    value = row_of(value) if isinstance(value, Sample) else value
    if isinstance(value, np.ndarray) and as_base64:
        head = {"dtype": value.dtype.str, "shape": value.shape}
        yield json.dumps(head)[:-1] + f', "base64": "{base64.b64encode(np.ascontiguousarray(value).data).decode()}"}}'
    elif isinstance(value, np.ndarray):
        yield from array_text(value)
    elif isinstance(value, dict):
        for k, (name, each) in enumerate(value.items()):
            yield f"{',' if k else '{'}{json.dumps(name)}:"
            yield from message_pieces(each, as_base64)
        yield "}" if value else "{}"
    elif isinstance(value, list) and len(value) > _ITEMS_PER_PIECE:
        for start in range(0, len(value), _ITEMS_PER_PIECE):
            yield ("," if start else "[") + json.dumps(value[start : start + _ITEMS_PER_PIECE])[1:-1]
        yield "]"
    else:
        yield json.dumps(value)
