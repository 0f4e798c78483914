"""Documented commands, each with a worked example and its origin."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from firmware_protocols.frames import WireFrame, frame_of, matches


@dataclass(frozen=True, kw_only=True, slots=True)
class Command:
    """One documented command: a driver's request and the firmware's answer. `tactemu check` sends each.

    Frames are written as text (hex for bytes, candump notation for CAN) and are literal: bytes from the code under
    test would only agree with themselves. In an answer ``..`` is any byte, ``..{12}`` twelve of them, ``*`` any
    number of them.
    """

    name: str
    request: WireFrame | str
    reply: WireFrame | str | Sequence[WireFrame | str] | Callable[[list[Any]], bool] | None = None
    """The answer, or several in order; ``None``: documented silence; a predicate where no pattern can describe it."""
    about: str = ""
    after: Sequence[WireFrame | str] = ()
    """Requests to send first (select a port, unlock ...)."""
    port: str = ""
    """The port that it is sent to; default: the device's first port."""
    origin: str = ""
    """The source of the example: a manual's page, a capture, the driver that sends it."""
    safe: bool = False
    """True if the request and those in ``after`` only read: they write nothing that lasts, reset, zero or move nothing,
    and change neither rate nor mode. `tactemu compare` sends only such requests, unless you add ``--ask-all``."""

    @property
    def frame(self) -> WireFrame:
        """The request as a frame."""
        return frame_of(self.request)

    def agrees(self, frames: Sequence[Any]) -> bool:
        """Return True if these frames are the documented answer."""
        if callable(self.reply):
            return bool(self.reply(list(frames)))
        wanted: list[Any] = [] if self.reply is None else [self.reply]
        if isinstance(self.reply, list | tuple):
            wanted = list(self.reply)
        return len(frames) == len(wanted) and all(map(matches, wanted, frames))
