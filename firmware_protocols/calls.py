"""Calls into a device. A mistake in its code becomes one sentence for its author: method, input, file and line."""

from __future__ import annotations

import inspect
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from firmware_protocols.can_frames import CanFrames
from firmware_protocols.connectors import Can, Connector
from firmware_protocols.device import Convert, Device, Restart, Sent
from firmware_protocols.frames import FD_LENGTHS, CanFrame, text_of
from firmware_protocols.senses import Reading


class AuthorError(Exception):
    """A mistake in a device's code: a method raised, or returned a value that cannot be used."""

    def __init__(self, text: str, *, data: str = "", file: str = "", line: int = 0):
        super().__init__(text)
        self.data, self.file, self.line = data, file, line


def measure(device: Device, reading: Reading, t_ns: int) -> Any:
    """Run one conversion and return the counts.

    Raises:
        AuthorError: the device raised, or returned no array, or counts that are not finite.
    """
    counts = run(device, "measure", reading, t_ns)
    if not isinstance(counts, np.ndarray | Mapping):
        hint = "return the counts as an array, by sense if several"
        raise error_of_result(device, "measure", f"returned {type(counts).__name__}: {hint}")
    for values in counts.values() if isinstance(counts, Mapping) else (counts,):
        is_whole = isinstance(values, np.ndarray) and values.dtype.kind in "iub"  # the usual case, in no time
        if not is_whole and not np.isfinite(values).all():
            raise error_of_result(device, "measure", "returned counts that are not finite")
    return counts


def transmissions(device: Device, method: str, *args: Any, port: str = "") -> Sequence[Any]:
    """Call ``stream``, ``receive``, ``lines``, ``boot`` or ``wake`` and return its transmissions.

    ``port`` is the port on which the cause of the call arrived, if any.

    Raises:
        AuthorError: the device raised, or returned a value that cannot be sent.
    """
    found = run(device, method, *args)
    if isinstance(found, CanFrames):
        if isinstance(device.connector(port) if port else device.ports[0], Can):
            return found
        found = list(found)
    if not isinstance(found, list | tuple):
        one = isinstance(found, bytes | CanFrame | Sent)
        hint = "return [frame]" if one else "return a list of frames, or ()"
        raise error_of_result(device, method, f"returned {type(found).__name__}: {hint}")
    connectors = (device.connector(port),) if port else device.ports
    can = isinstance(connectors[0], Can)
    for out in found:
        frame = out.frame if type(out) is Sent and not out.port else out
        is_ordinary = _is_classic_frame(frame) if can else type(frame) is bytes and frame
        if not is_ordinary and (fault := _fault(device, out, connectors)):
            raise error_of_result(device, method, fault)
    return list(found)


def _is_classic_frame(out: Any) -> bool:
    """Return True for a classic CAN frame with a standard identifier, the usual case, without the full check."""
    return type(out) is CanFrame and out.arbitration_id >> 11 == 0 and len(out.data) <= 8 and not out.is_fd


def _fault(device: Device, out: Any, connectors: Sequence[Connector]) -> str:
    """Return why ``out`` cannot be sent on its own port or on any of these connectors; empty if it can."""
    if isinstance(out, Convert):
        return "" if out.stream in device.periods else f"asked for stream {out.stream!r}; it has {list(device.periods)}"
    if isinstance(out, Restart):
        return ""
    frame, port = (out.frame, out.port) if isinstance(out, Sent) else (out, "")
    if port:
        if port.partition("/")[0] not in (names := [each.name for each in device.ports]):
            return f"sent to port {port!r}; it has {names}"
        connectors = (device.connector(port),)
    faults = [_why_not_carried(frame, connector) for connector in connectors]
    return faults[0] if all(faults) else ""


def _why_not_carried(frame: Any, connector: Connector) -> str:
    """Return why the line of a connector cannot carry a frame; empty if it can."""
    if not isinstance(connector, Can):
        fits = isinstance(frame, bytes) and frame
        shown = str(frame) if isinstance(frame, CanFrame) else repr(frame)
        return "" if fits else f"sent {shown}: expected bytes that are not empty"
    if not isinstance(frame, CanFrame):
        return f"sent {frame!r}: expected a CanFrame"
    size, top = len(frame.data), 1 << 29 if frame.is_extended_id else 1 << 11
    if not 0 <= frame.arbitration_id < top:
        return f"sent {frame}: expected an identifier below {top:#x}, got {frame.arbitration_id:#x}"
    if frame.is_fd and not connector.data_bitrate:
        return f"sent {frame}: a CAN-FD frame on a connector without data_bitrate"
    if size not in (FD_LENGTHS if frame.is_fd else range(9)):
        return f"sent {frame}: a frame cannot have {size} data bytes"
    return ""


def run(device: Device, method: str, *args: Any) -> Any:
    """Call a method and return its result.

    Raises:
        AuthorError: the device raised.
    """
    try:
        return getattr(device, method)(*args)
    except Exception as error:
        raise error_of_exception(type(device), device.name, method, args, error) from error


def error_of_exception(cls: type, name: str, method: str, args: tuple, error: Exception) -> AuthorError:
    """Return the error for an exception in a device, with the line in the device's own file."""
    data = text_of(args[0])[:200] if method == "receive" else ""
    files = {inspect.getfile(each) for each in cls.__mro__ if each is not Device and issubclass(each, Device)}
    calls = traceback.extract_tb(error.__traceback__)
    own = next((call for call in reversed(calls) if call.filename in files), None)
    file, line, source = (own.filename, own.lineno or 0, own.line) if own else (*source_line(cls, method), "")
    text = f"{name}.{method}{f' on {data}' if data else ''} raised {type(error).__name__}: {error}"
    where = f" at {Path(file).name}:{line}" + (f": {source}" if source else "")
    return AuthorError(text + where, data=data, file=file, line=line)


def error_of_result(device: Device, method: str, what: str) -> AuthorError:
    """Return the error for a result of a method that breaks the contract; ``what`` says how."""
    file, line = source_line(type(device), method)
    text = f"{device.name}.{method} {what} ({Path(file).name}:{line})"
    return AuthorError(text, file=file, line=line)


def source_line(cls: type, method: str = "") -> tuple[str, int]:
    """Return file and line of a method, or of the class."""
    found = inspect.unwrap(getattr(cls, method)) if method else cls
    try:
        return inspect.getsourcefile(found) or "", inspect.getsourcelines(found)[1]
    except (OSError, TypeError):
        return inspect.getfile(cls), 0
