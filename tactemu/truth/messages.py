"""Conversion between entries and messages of ROS 2: ``ros2msg`` definitions and CDR, without ROS.

A message is a fixed part, a :mod:`struct`, and after it texts and arrays, each with its length in front and aligned
to its items. One table per type gives the definition in the file, the encoding and the decoding.
"""

from __future__ import annotations

import functools
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from firmware_protocols import CanFrame, WireFrame
from tactemu.base.frame_text import checked, on_the_bus
from tactemu.truth.entries import BodyPose, Entry, Injection, Passage, PortEvent, Sample

_LITTLE_ENDIAN_CDR = b"\x00\x01\x00\x00"
_ROS_TYPES = {
    "b1": "bool", "i1": "int8", "i2": "int16", "i4": "int32", "i8": "int64",
    "u1": "uint8", "u2": "uint16", "u4": "uint32", "u8": "uint64", "f4": "float32", "f8": "float64",
}  # fmt: skip
_DTYPES = {f"{name}[]": np.dtype(f"<{code}") for code, name in _ROS_TYPES.items()}
_STRUCT_TYPES = {"q": "int64", "d": "float64", "I": "uint32", "?": "bool"}
_LENGTH = struct.Struct("<I")


@dataclass(frozen=True, eq=False)
class Message:
    """A type of message: numbers at fixed offsets first, then texts and arrays."""

    name: str
    about: str
    fixed: tuple[tuple[str, str], ...]
    """Name and :mod:`struct` type of each number, in an order that needs no padding."""
    variable: tuple[tuple[str, str], ...]
    """Name and ROS type of each other field: ``string``, ``string[]`` or an array of numbers."""
    layout: struct.Struct = field(init=False)
    """The layout of the fixed part."""

    def __post_init__(self):
        object.__setattr__(self, "layout", struct.Struct("<" + "".join(kind for _, kind in self.fixed)))

    @property
    def definition(self) -> str:
        """The ``ros2msg`` definition."""
        fields = [(name, _STRUCT_TYPES[kind]) for name, kind in self.fixed] + list(self.variable)
        return f"# {self.about}\n" + "".join(f"{kind} {name}\n" for name, kind in fields)

    def encode(self, fixed: Sequence, variable: Sequence[str | Sequence[str] | np.ndarray]) -> bytes:
        """Return the message in CDR; arrays must have the types of the table."""
        parts, at = [_LITTLE_ENDIAN_CDR, self.layout.pack(*fixed)], self.layout.size

        def put(data: Any, size: int, align: int) -> None:
            nonlocal at
            gap = -at % align
            parts.extend((bytes(gap), data))
            at += gap + size

        def put_text(value: str) -> None:
            data = value.encode("utf-8", "replace") + b"\0"
            put(_LENGTH.pack(len(data)) + data, 4 + len(data), 4)

        for value in variable:
            if isinstance(value, str):
                put_text(value)
                continue
            put(_LENGTH.pack(np.size(value)), 4, 4)
            if not isinstance(value, np.ndarray):
                for each in value:
                    put_text(each)
            elif value.size:
                put(value.data, value.nbytes, value.itemsize)
        return b"".join(parts)

    def decode(self, data: bytes) -> tuple[tuple, list]:
        """Return the fixed and the variable part of a message; arrays are flat and share its memory.

        Raises:
            ValueError, struct.error: it is shorter than its fields claim.
        """
        body = memoryview(data)[len(_LITTLE_ENDIAN_CDR) :]
        fixed, at = self.layout.unpack_from(body), self.layout.size

        def take_length() -> int:
            nonlocal at
            at += -at % _LENGTH.size
            (length,) = _LENGTH.unpack_from(body, at)
            at += _LENGTH.size
            return length

        def take_text() -> str:
            nonlocal at
            length = take_length()
            at += length
            if not length or at > len(body):
                raise ValueError("a text does not fit its message")
            return str(body[at - length : at - 1], "utf-8")

        def take_array(dtype: np.dtype) -> np.ndarray:
            nonlocal at
            length = take_length()
            if not length:
                return np.zeros(0, dtype)
            start = at + -at % dtype.itemsize
            at = start + length * dtype.itemsize
            return np.frombuffer(body, dtype, length, start)

        variable: list = []
        for _, kind in self.variable:
            if kind == "string":
                variable.append(take_text())
            elif kind == "string[]":
                variable.append(tuple(take_text() for _ in range(take_length())))
            else:
                variable.append(take_array(_DTYPES[kind]))
        return fixed, variable


_NUMBERED = (("t_ns", "q"), ("sample", "q"))
_CAN_FLAGS = ("is_extended_id", "is_remote_frame", "is_fd", "bitrate_switch", "is_error_frame")
FRAME = Message(
    "tactemu/msg/Frame",
    "A frame; version 1. sample: number of the sample that it carries, -1: none. why: the reason why it never left.",
    (*_NUMBERED, ("arbitration_id", "I"), ("is_can", "?"), *((name, "?") for name in _CAN_FLAGS)),
    (("why", "string"), ("data", "uint8[]")),
)
INJECTION = Message(
    "tactemu/msg/Injection",
    "A fault that was injected; version 1.",
    (("t_ns", "q"),),
    (("what", "string"), ("detail", "string"), ("before", "string"), ("after", "string[]")),
)
EVENT = Message("tactemu/msg/Event", "An event of the port; version 1.", (("t_ns", "q"),), (("what", "string"),))
POSE = Message(
    "tactemu/msg/BodyPose",
    "Where a body of the scene is in the world [m], quaternion w x y z; version 1.",
    (("t_ns", "q"), *((name, "d") for name in ("x", "y", "z", "qw", "qx", "qy", "qz"))),
    (),
)
_KINDS = {"pose": POSE, "tx": FRAME, "rx": FRAME, "drop": FRAME, "inject": INJECTION, "event": EVENT}


def sample_message(*types: str) -> Message:
    """Return the type of message for samples whose ``ideal``, ``measured`` and ``counts`` are of these ROS types."""
    return Message(
        "tactemu/msg/Sample" + "".join(each.removesuffix("[]").capitalize() for each in types),
        "A sample; version 1. Taxels in layout order, row by row; the shapes are in the channel's metadata.",
        _NUMBERED,
        tuple(zip(("ideal", "measured", "counts"), types)),
    )


_sample_message = functools.cache(sample_message)


def message_of(entry: Entry) -> tuple[str, Message, tuple, Sequence]:
    """Return an entry's kind, its type of message, and the message's fixed and variable part."""
    if isinstance(entry, Sample):
        arrays = [_portable(values) for values in (entry.ideal, entry.measured, entry.counts)]
        message = _sample_message(*(f"{_ROS_TYPES[values.dtype.str[1:]]}[]" for values in arrays))
        return "sample", message, (entry.t_ns, entry.number), arrays
    if isinstance(entry, Passage):
        number = -1 if entry.sample is None else entry.sample
        frame = entry.frame
        if not isinstance(frame, CanFrame):
            data, fixed = frame, (0, False, *(False for _ in _CAN_FLAGS))
        else:
            frame = on_the_bus(frame)
            data, fixed = frame.data, (frame.arbitration_id, True, *(getattr(frame, name) for name in _CAN_FLAGS))
        return entry.kind, FRAME, (entry.t_ns, number, *fixed), (entry.why, np.frombuffer(data, np.uint8))
    if isinstance(entry, Injection):
        return "inject", INJECTION, (entry.t_ns,), (entry.what, entry.detail, entry.before, entry.after)
    if isinstance(entry, BodyPose):
        return "pose", POSE, (entry.t_ns, *entry.position, *entry.quaternion), ()
    return "event", EVENT, (entry.t_ns,), (entry.what,)


def _portable(values: np.ndarray) -> np.ndarray:
    """Return the array as ROS has it: little-endian, of a ROS type, contiguous."""
    dtype = values.dtype.newbyteorder("<")
    if dtype.str[1:] not in _ROS_TYPES:
        dtype = np.dtype("<f8")
    return np.ascontiguousarray(values, dtype).reshape(values.shape)


class Decoder:
    """A decoder for the messages of one kind from one device, or of one body.

    Args:
        metadata: that of the channel: ``device`` or ``body``, ``kind`` and, for samples, the arrays' shapes.
        definition: that of the messages.

    Raises:
        ValueError, KeyError: this version of the format does not have such messages.
    """

    def __init__(self, metadata: dict[str, str], definition: str):
        self.kind, self.sense = metadata["kind"], metadata.get("sense", "")
        self.device = metadata["body" if self.kind == "pose" else "device"]
        self.shapes: list[tuple[int, ...]] = []
        if self.kind == "sample":
            fields = [line.split() for line in definition.splitlines() if not line.startswith("#")]
            types = {name: kind for kind, name in fields}
            names = ("ideal", "measured", "counts")
            self.message = _sample_message(*(types[name] for name in names))
            self.shapes = [tuple(map(int, metadata[f"{name}_shape"].split())) for name in names]
        else:
            self.message = _KINDS[self.kind]

    def __call__(self, data: bytes) -> Entry:
        """Return the entry of one message.

        Raises:
            ValueError, struct.error: it is shorter than its fields claim, or does not have the channel's shapes.
        """
        fixed, variable = self.message.decode(data)
        if self.kind == "sample":
            ideal, measured, counts = (values.reshape(shape) for values, shape in zip(variable, self.shapes))
            return Sample(fixed[0], self.device, ideal, measured, counts, fixed[1], self.sense)
        if self.kind == "pose":
            return BodyPose(fixed[0], self.device, fixed[1:4], fixed[4:8])
        if self.kind == "inject":
            return Injection(fixed[0], self.device, *variable)
        if self.kind == "event":
            return PortEvent(fixed[0], self.device, *variable)
        t_ns, number, ident, is_can, *flags = fixed
        why, payload = variable
        data = payload.tobytes()
        can = CanFrame(arbitration_id=ident, data=data, **dict(zip(_CAN_FLAGS, flags))) if is_can else None
        frame: WireFrame = data if can is None else checked(can)
        return Passage(t_ns, self.device, self.kind, frame, None if number < 0 else number, why)  # type: ignore[arg-type]


def metadata_of(entry: Entry, kind: str) -> dict[str, str]:
    """Return the metadata of a channel: the device or body of its messages, and the shapes of a sample's arrays."""
    if isinstance(entry, BodyPose):
        return {"body": entry.body, "kind": kind}
    metadata = {"device": entry.device, "kind": kind}
    if isinstance(entry, Sample):
        shapes = {"ideal": entry.ideal.shape, "measured": entry.measured.shape, "counts": entry.counts.shape}
        metadata |= {"sense": entry.sense} if entry.sense else {}
        metadata |= {f"{name}_shape": " ".join(map(str, shape)) for name, shape in shapes.items()}
    return metadata
