"""Arrays of CAN frames in Linux's memory layout, for devices that send dozens a sample and encode them with NumPy."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from firmware_protocols.frames import CanFrame

CAN_FRAME = np.dtype([("can_id", "=u4"), ("len", "u1"), ("pad", "V3"), ("data", "u1", (8,))])
"""``struct can_frame`` of Linux: 16 bytes."""
_CAN_FRAME = struct.Struct("=IB3x8s")
_FRAME_BYTES = CAN_FRAME.itemsize


if TYPE_CHECKING:
    Frames = Sequence[CanFrame]
else:  # each frame on its way is tested for being a run, which takes ten times as long with an abstract class
    Frames = object


@Sequence.register  # pyright: ignore[reportAttributeAccessIssue] - a method of its metaclass
class CanFrames(Frames):
    """A sequence of classic data frames with standard identifiers, in the order in which they leave.

    Its items are :class:`CanFrame`; a transport may send the array as it is.

    Args:
        array: frames as :data:`CAN_FRAME`, contiguous, shape ``(n,)``; it is not copied, so do not change it.
    """

    __slots__ = ("array",)

    def __init__(self, array: np.ndarray):
        self.array = array

    @staticmethod
    def of(idents: Any, data: np.ndarray) -> CanFrames:
        """Return frames with these identifiers, shape ``(n,)``, and data bytes, uint8 ``(n, size)``.

        Raises:
            ValueError: an identifier of more than 11 bits, or more than 8 bytes.
        """
        array = np.zeros(len(data), CAN_FRAME)
        if np.any((np.asarray(idents) < 0) | (np.asarray(idents) >= 1 << 11)) or data.shape[1] > 8:
            raise ValueError(f"expected identifiers below 0x800 and at most 8 bytes, got {idents} and {data.shape[1]}")
        array["can_id"] = idents
        array["len"] = size = data.shape[1]
        array["data"][:, :size] = data
        return CanFrames(array)

    def with_data(self, data: np.ndarray) -> CanFrames:
        """Return the same frames with other data bytes, uint8 ``(n, 8)``."""
        array = self.array.copy()
        array["data"] = data
        return CanFrames(array)

    @overload
    def __getitem__(self, index: int) -> CanFrame: ...
    @overload
    def __getitem__(self, index: slice) -> CanFrames: ...
    def __getitem__(self, index: int | slice) -> CanFrame | CanFrames:
        if isinstance(index, slice):
            return CanFrames(np.ascontiguousarray(self.array[index]))
        try:
            ident, size, data = _CAN_FRAME.unpack_from(self.array, index * _FRAME_BYTES)  # type: ignore[arg-type]  # a buffer
        except struct.error:
            raise IndexError(f"expected an index below {len(self.array)}, got {index}") from None
        return CanFrame(arbitration_id=ident, data=data[:size])

    def __iter__(self) -> Iterator[CanFrame]:
        for ident, size, data in self.unpacked():
            yield CanFrame(arbitration_id=ident, data=data[:size])

    def unpacked(self) -> Iterator[tuple[int, int, bytes]]:
        """Return an iterator over identifier, number of data bytes, and 8 bytes of each frame."""
        return _CAN_FRAME.iter_unpack(self.array.tobytes())

    def __len__(self) -> int:
        return len(self.array)

    def __eq__(self, other: object) -> bool:
        return list(self) == list(other) if isinstance(other, Sequence) else NotImplemented

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"CanFrames({', '.join(map(str, self))})"
