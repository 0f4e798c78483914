"""CAN frames as requests, for the methods of a device that answer them.

    CAN_ID = Identifier("ppppptttttttt00000001wddddddd", {"part": "p", "message": "t", "write": "w", "device": "d"})

    self.packets = CanRequests(CAN_ID, by="message", is_fd=True)    # in the device's __init__
    self.packets = CanRequests()                                    # by the whole identifier

A request has the parts of its identifier as attributes, the identifier as ``id``, and ``data``, which is ``None`` in a
remote frame. A content that a method returns is the data of an answer under the request's identifier; a frame under
another one is made by :meth:`CanRequests.frame`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

from firmware_protocols.frames import CanFrame, with_payload
from firmware_protocols.framing import Cutter
from firmware_protocols.table_lines import Identifier


class CanRequests(Cutter):
    """The frames on a CAN bus that are requests.

    Args:
        ident: the bits of their identifiers; by default any of 11 bits. Other frames count as ``ignored``.
        by: the part of the identifier by which the device tells requests apart; by default the whole identifier, and
            then those that no method answers count as ``ignored``, too.
        is_fd: True for CAN-FD frames.
    """

    misfit = "ignored"

    def __init__(self, ident: Identifier | None = None, *, by: str = "id", is_fd: bool = False):
        self._ident, self.by, self._is_fd = ident, by, is_fd
        self._is_extended = ident is not None and ident.extended
        self.unknown = "ignored" if by == "id" else "unknown_command"

    def cut(self, data: CanFrame, t_ns: int = 0) -> list[CanFrame]:
        """Return the frame."""
        return [data]

    def fields(self, content: CanFrame) -> dict[str, Any] | None:
        """Return identifier, its parts and data; ``None`` for a frame of another kind, or under other identifiers."""
        if content.is_error_frame or content.is_extended_id != self._is_extended or content.is_fd != self._is_fd:
            return None
        parts = {} if self._ident is None else self._ident.read(content.arbitration_id)
        return (
            None
            if parts is None
            else {**parts, "id": content.arbitration_id, "data": None if content.is_remote_frame else content.data}
        )

    def data(self, fields: Mapping[str, Any]) -> bytes | None:
        """Return the data of a request, ``None`` for a remote frame."""
        return fields["data"]

    def frame(self, ident: int, data: bytes = b"") -> CanFrame:
        """Return a frame of the same kind, of CAN-FD padded with zeros to a valid length."""
        made = CanFrame(
            arbitration_id=ident, is_extended_id=self._is_extended, is_fd=self._is_fd, bitrate_switch=self._is_fd
        )
        return cast(CanFrame, with_payload(made, data))
