"""Calls into a device. What its code does wrong becomes one sentence for its author: method, input, file and line."""

from __future__ import annotations

import inspect
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from firmware_protocols.can_frames import CanFrames
from firmware_protocols.connectors import Can, Connector
from firmware_protocols.device import Convert, Device, Reading, Restart, Sent
from firmware_protocols.frames import FD_LENGTHS, CanFrame, text_of


class AuthorError(Exception):
    """A device raised, or returned what cannot be used."""

    def __init__(self, text: str, *, data: str = "", file: str = "", line: int = 0):
        super().__init__(text)
        self.data, self.file, self.line = data, file, line


def measure(device: Device, reading: Reading, t_ns: int) -> Any:
    """Return one conversion; the counts.

    Raises:
        AuthorError: the device raised, or returned no array.
    """
    counts = run(device, "measure", reading, t_ns)
    if not isinstance(counts, np.ndarray | Mapping):
        hint = "return the counts as an array, by sense if several"
        raise misused(device, "measure", f"returned {type(counts).__name__}: {hint}")
    return counts


def outs(device: Device, method: str, *args: Any, port: str = "") -> Sequence[Any]:
    """What ``stream``, ``receive``, ``lines``, ``boot`` or ``wake`` returns; ``port``: where its cause came from.

    Raises:
        AuthorError: the device raised, or returned what cannot be sent.
    """
    found = run(device, method, *args)
    if isinstance(found, CanFrames):
        if isinstance(device.connector(port) if port else device.ports[0], Can):
            return found
        found = list(found)
    if not isinstance(found, list | tuple):
        one = isinstance(found, bytes | CanFrame | Sent)
        hint = "return [frame]" if one else "return a list of frames, or ()"
        raise misused(device, method, f"returned {type(found).__name__}: {hint}")
    connectors = (device.connector(port),) if port else device.ports
    can = isinstance(connectors[0], Can)
    for out in found:
        ordinary = _ordinary_can(out) if can else type(out) is bytes and out
        if not ordinary and (fault := _fault(device, out, connectors)):
            raise misused(device, method, fault)
    return list(found)


def _ordinary_can(out: Any) -> bool:
    """Return a classic frame with a standard identifier: what nearly all are, decided at once."""
    return type(out) is CanFrame and out.arbitration_id >> 11 == 0 and len(out.data) <= 8 and not out.is_fd


def _fault(device: Device, out: Any, connectors: Sequence[Connector]) -> str:
    """Why it cannot be sent on any of these connectors, unless it names another; empty: it can."""
    if isinstance(out, Convert):
        return "" if out.stream in device.periods else f"asked for stream {out.stream!r}; it has {list(device.periods)}"
    if isinstance(out, Restart):
        return ""
    frame, port = (out.frame, out.port) if isinstance(out, Sent) else (out, "")
    if port:
        if port.partition("/")[0] not in (names := [each.name for each in device.ports]):
            return f"sent to port {port!r}; it has {names}"
        connectors = (device.connector(port),)
    faults = [_uncarried(frame, connector) for connector in connectors]
    return faults[0] if all(faults) else ""


def _uncarried(frame: Any, connector: Connector) -> str:
    """Why the line behind a connector cannot carry it; empty: it can."""
    if not isinstance(connector, Can):
        fits = isinstance(frame, bytes) and frame
        said = str(frame) if isinstance(frame, CanFrame) else repr(frame)
        return "" if fits else f"sent {said}: expected bytes that are not empty"
    if not isinstance(frame, CanFrame):
        return f"sent {frame!r}: expected a CanFrame"
    size, top = len(frame.data), 1 << 29 if frame.is_extended_id else 1 << 11
    if not 0 <= frame.arbitration_id < top:
        return f"sent {frame}: an identifier is below {top:#x}, got {frame.arbitration_id:#x}"
    if frame.is_fd and not connector.data_bitrate:
        return f"sent {frame}: a CAN-FD frame on a connector without data_bitrate"
    if size not in (FD_LENGTHS if frame.is_fd else range(9)):
        return f"sent {frame}: no frame has {size} data bytes"
    return ""


def run(device: Device, method: str, *args: Any) -> Any:
    """Call a method.

    Raises:
        AuthorError: the device raised.
    """
    try:
        return getattr(device, method)(*args)
    except Exception as error:
        raise blamed(type(device), device.name, method, args, error) from error


def blamed(cls: type, name: str, method: str, args: tuple, error: Exception) -> AuthorError:
    """Return the sentence for an exception, with the line in the device's own file."""
    data = text_of(args[0])[:200] if method == "receive" else ""
    files = {inspect.getfile(each) for each in cls.__mro__ if each is not Device and issubclass(each, Device)}
    calls = traceback.extract_tb(error.__traceback__)
    own = next((call for call in reversed(calls) if call.filename in files), None)
    file, line, source = (own.filename, own.lineno or 0, own.line) if own else (*place(cls, method), "")
    said = f"{name}.{method}{f' on {data}' if data else ''} raised {type(error).__name__}: {error}"
    where = f" at {Path(file).name}:{line}" + (f": {source}" if source else "")
    return AuthorError(said + where, data=data, file=file, line=line)


def misused(device: Device, method: str, what: str) -> AuthorError:
    """Return the sentence for what a method returned."""
    file, line = place(type(device), method)
    text = f"{device.name}.{method} {what} ({Path(file).name}:{line})"
    return AuthorError(text, file=file, line=line)


def place(cls: type, method: str = "") -> tuple[str, int]:
    """File and line of a method, or of the class."""
    found = inspect.unwrap(getattr(cls, method)) if method else cls
    try:
        return inspect.getsourcefile(found) or "", inspect.getsourcelines(found)[1]
    except (OSError, TypeError):
        return inspect.getfile(cls), 0
