"""Conversion between entries and messages of ROS 2: ``ros2msg`` definitions and CDR, without ROS.

The definition of a type is the one table of its fields: it stands in the file, and
:class:`~firmware_protocols.cdr.Codec` encodes and decodes by it. A log is decoded by the definitions that it has, so
that a field that is added at the end of one keeps older logs readable.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np

from firmware_protocols import CanFrame, WireFrame
from firmware_protocols.cdr import NUMBERS, Codec, dtype_of, members_of
from tactemu.base.frame_text import checked, on_the_bus
from tactemu.truth.entries import BodyPose, Entry, Injection, Passage, PortEvent, Sample

_CAN_FLAGS = ("is_extended_id", "is_remote_frame", "is_fd", "bitrate_switch", "is_error_frame")
_ARRAYS = ("ideal", "measured", "counts")


class Message:
    """A type of message.

    Args:
        name: its name, with the package.
        about: the comment in its definition.
        fields: ROS type and name of each field, separated by commas.
    """

    def __init__(self, name: str, about: str, fields: str):
        self.name = name
        self.definition = f"# {about}\n" + "".join(f"{each.strip()}\n" for each in fields.split(","))
        """The ``ros2msg`` definition."""
        codec = Codec(members_of(self.definition))
        self.encode, self.decode = codec.encode, codec.decode


FRAME = Message(
    "tactemu/msg/Frame",
    "A frame; version 1. sample: number of the sample that it carries, -1: none. why: the reason why it never left.",
    "int64 t_ns, int64 sample, uint32 arbitration_id, bool is_can, "
    + ", ".join(f"bool {name}" for name in _CAN_FLAGS)
    + ", string why, uint8[] data",
)
INJECTION = Message(
    "tactemu/msg/Injection",
    "A fault that was injected; version 1. frame: number of the frame, -1: none.",
    "int64 t_ns, string what, string detail, string before, string[] after, int64 frame",
)
EVENT = Message("tactemu/msg/Event", "An event of the port; version 1.", "int64 t_ns, string what")
POSE = Message(
    "tactemu/msg/BodyPose",
    "Where a body of the scene is in the world [m], quaternion w x y z; version 1.",
    "int64 t_ns, " + ", ".join(f"float64 {name}" for name in ("x", "y", "z", "qw", "qx", "qy", "qz")),
)


@functools.cache
def sample_message(*types: str) -> Message:
    """Return the type of message for samples whose ``ideal``, ``measured`` and ``counts`` are of these ROS types."""
    return Message(
        "tactemu/msg/Sample" + "".join(map(str.capitalize, types)),
        "A sample; version 1. Taxels in layout order, row by row; the shapes are in the channel's metadata.",
        "int64 t_ns, int64 sample, " + ", ".join(f"{kind}[] {name}" for kind, name in zip(types, _ARRAYS)),
    )


_KINDS = {"pose": POSE, "tx": FRAME, "rx": FRAME, "drop": FRAME, "inject": INJECTION, "event": EVENT}


def message_of(entry: Entry) -> tuple[str, Message, Sequence[Any]]:
    """Return an entry's kind, its type of message, and the values of the message."""
    if isinstance(entry, Sample):
        arrays = [_portable(values) for values in (entry.ideal, entry.measured, entry.counts)]
        message = sample_message(*(str(values.dtype) for values in arrays))
        return "sample", message, (entry.t_ns, entry.number, *arrays)
    if isinstance(entry, Passage):
        number = -1 if entry.sample is None else entry.sample
        frame = entry.frame
        if not isinstance(frame, CanFrame):
            data, can = frame, (0, False, *(False for _ in _CAN_FLAGS))
        else:
            frame = on_the_bus(frame)
            data, can = frame.data, (frame.arbitration_id, True, *(getattr(frame, name) for name in _CAN_FLAGS))
        return entry.kind, FRAME, (entry.t_ns, number, *can, entry.why, np.frombuffer(data, np.uint8))
    if isinstance(entry, Injection):
        number = -1 if entry.frame is None else entry.frame
        return "inject", INJECTION, (entry.t_ns, entry.what, entry.detail, entry.before, entry.after, number)
    if isinstance(entry, BodyPose):
        return "pose", POSE, (entry.t_ns, *entry.position, *entry.quaternion)
    return "event", EVENT, (entry.t_ns, entry.what)


def _portable(values: np.ndarray) -> np.ndarray:
    """Return the array as ROS has it: little-endian, of a ROS type, contiguous."""
    dtype = values.dtype.newbyteorder("<")
    if dtype.name not in NUMBERS:
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
        there = members_of(definition)
        if self.kind == "sample":
            self.shapes = [tuple(map(int, metadata[f"{name}_shape"].split())) for name in _ARRAYS]
            types = {each.name: each.type for each in there}
            message = sample_message(*(dtype_of(types[name]).name for name in _ARRAYS))
        else:
            message = _KINDS[self.kind]
        here = members_of(message.definition)
        if there[: len(here)] != here[: len(there)]:
            raise ValueError(f"{message.name} with other fields than {', '.join(each.name for each in here)}")
        self._codec, self._count = Codec(there), len(here)

    def __call__(self, data: bytes) -> Entry:
        """Return the entry of one message.

        Raises:
            ValueError, struct.error: it is shorter than its fields claim, or does not have the channel's shapes.
        """
        values = self._codec.decode(data)[: self._count]
        if self.kind == "sample":
            t_ns, number, *arrays = values
            ideal, measured, counts = (each.reshape(shape) for each, shape in zip(arrays, self.shapes))
            return Sample(t_ns, self.device, ideal, measured, counts, number, self.sense)
        if self.kind == "pose":
            return BodyPose(values[0], self.device, tuple(values[1:4]), tuple(values[4:8]))
        if self.kind == "inject":
            t_ns, what, detail, before, after, number = [*values, -1][:6]  # older logs have no number
            return Injection(t_ns, self.device, what, detail, before, after, None if number < 0 else number)
        if self.kind == "event":
            return PortEvent(values[0], self.device, values[1])
        t_ns, number, ident, is_can, *flags, why, payload = values
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
