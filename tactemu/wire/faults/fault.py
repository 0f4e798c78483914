"""The base classes of faults: their common options, their text, and when they apply.

A fault is an object of its class, the same whether text names it (:func:`tactemu.wire.faults.parse`) or Python makes
it: ``Flip(frames=((37, 37),), byte=10, bit=3)`` is ``flip frame 37 byte 10 bit 3``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace
from functools import cache
from typing import Annotated, Any, ClassVar, Self, get_type_hints

import numpy as np

from firmware_protocols import CanFrame, WireFrame
from tactemu.base.errors import SceneError
from tactemu.wire.faults.options import (
    DIRECTION,
    END,
    EVERY,
    FRAMES,
    IDENTIFIER,
    LASTS,
    PREFIX,
    SHARE,
    START,
    Direction,
    Option,
    Ranges,
)

_TIMES = (START, END, LASTS)
Parts = list[tuple[WireFrame, int]]
"""Frames, each with its delay [ns]."""
Key = tuple[str, str]
"""Source and direction of a frame; a fault holds frames back separately for each."""


@dataclass(frozen=True, kw_only=True)
class Fault(ABC):
    """A fault of a wire. Times are in emulation nanoseconds.

    Raises:
        SceneError: an option is out of bounds, or two of them exclude each other.
    """

    word: ClassVar[str]
    """The name of the fault in texts, counters and logs."""
    about: ClassVar[str]
    """The effect, as ``tactemu faults`` prints it."""
    every_line: ClassVar[bool] = True
    """True if every line can have it; otherwise the line models that can have it name it in their ``faults``."""
    keeps_frame: ClassVar[bool] = False
    """True if the frame itself still arrives undamaged: the judge then expects its reading from the driver."""
    mixes_samples: ClassVar[bool] = False
    """True if it can still damage a sample of several frames."""

    start_ns: Annotated[int | None, START] = None
    """The time from which it applies; None: from the beginning."""
    until_ns: Annotated[int | None, END] = None
    """The time at which it ends; None: never, or after :attr:`lasts_ns`."""
    lasts_ns: Annotated[int | None, LASTS] = None
    """The time for which it applies."""
    once: bool = False
    """True for a fault of frames that hits one and is over."""
    text: str = ""
    """The fault as text, as it was written or in a fixed order; its random stream is named after it."""

    def __post_init__(self):
        if not self.text:
            object.__setattr__(self, "text", " ".join(self._words()))
        for word, why in self._errors():
            raise SceneError(f"fault {self.text!r}: {word!r}: {why}")

    def __str__(self) -> str:
        return self.text

    @property
    def stop_ns(self) -> int | None:
        """The time at which it ends; None: never."""
        return self.until_ns if self.lasts_ns is None else (self.start_ns or 0) + self.lasts_ns

    def covers(self, t_ns: int) -> bool:
        """Return True if the fault applies at this time."""
        if self.start_ns is not None and t_ns < self.start_ns:
            return False
        if self.until_ns is None and self.lasts_ns is None:
            return True
        return t_ns < (self.stop_ns or 0)

    def scheduled(self, start_ns: int, until_ns: int | None = None) -> Self:
        """Return the fault from ``start_ns`` on, until ``until_ns`` or for its own duration.

        Raises:
            ValueError: it has a start of its own, or its end is given twice.
        """
        if self.start_ns is not None or self.until_ns is not None:
            raise ValueError(f"fault: {self.text!r}: give its time as the event's `at` and `until`")
        if self.lasts_ns is not None and until_ns is not None:
            raise ValueError(f"fault: {self.text!r}: give `for` or `until`, not both")
        words = self.text.split()  # the other words stay in their order, which names the random stream
        if self.lasts_ns is None:
            words += ["from", f"{start_ns}ns"] + ([] if until_ns is None else ["to", f"{until_ns}ns"])
        else:
            words.insert(words.index("for"), f"at {start_ns}ns")
        return replace(self, start_ns=start_ns, until_ns=until_ns, text=" ".join(words))

    @classmethod
    @cache
    def options(cls) -> dict[str, Option]:
        """Return the options by the names of their fields."""
        hints = get_type_hints(cls, include_extras=True).items()
        return {name: each for name, hint in hints for each in getattr(hint, "__metadata__", ())}

    @classmethod
    def own_options(cls) -> list[str]:
        """Return the options beside times and targets, as the list of faults has them: ``bits N``."""
        options = [option for option in cls.options().values() if not option.is_target and option not in _TIMES]
        return [f"{each.word}{'' if each.word.endswith('=') else ' '}{each.sample}" for each in options]

    def _given(self) -> list[tuple[Option, Any]]:
        """Return the options that do not have their default, with their values."""
        defaults = {each.name: each.default for each in fields(self)}
        values = {name: getattr(self, name) for name in self.options()}
        return [(self.options()[name], value) for name, value in values.items() if value != defaults[name]]

    def _words(self) -> Iterator[str]:
        """Yield the words of the fault in their fixed order."""
        yield self.word
        for option, value in sorted(self._given(), key=lambda each: each[0].rank):
            is_moment = option is START and (self.once or self.lasts_ns is not None)
            yield f"at {option.text(value)}" if is_moment else option.show(value)

    def _errors(self) -> Iterator[tuple[str, str]]:
        """Yield the word of each error, and the reason."""
        for option, value in self._given():
            try:
                option.read(option.text(value))
            except ValueError as why:
                yield option.word, str(why)
        if self.lasts_ns is not None and self.until_ns is not None:
            yield "for", "give 'for' or 'to', not both"
        if self.stop_ns is not None and self.stop_ns <= (self.start_ns or 0):
            yield "to" if self.lasts_ns is None else "for", "it ends before it begins"


@dataclass
class Memory:
    """The random stream of a fault that is on, and the frames that it remembers."""

    rng: np.random.Generator
    held: dict[Key, tuple[WireFrame, int]] = field(default_factory=dict)
    """The frame that is held back, with the number of frames that go before it."""
    earlier: dict[Key, deque[WireFrame]] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class FrameFault(Fault):
    """A fault of single frames: those that its target matches."""

    needs_all: ClassVar[bool] = True
    """True if it also needs the frames that it does not hit."""
    probability: Annotated[float, SHARE] = 1.0
    every: Annotated[int, EVERY] = 1
    frames: Annotated[Ranges, FRAMES] = ()
    """First and last numbers of the frames that are hit; empty: frames are not chosen by number."""
    arbitration_id: Annotated[int | None, IDENTIFIER] = None
    prefix: Annotated[bytes, PREFIX] = b""
    direction: Annotated[Direction, DIRECTION] = "to_driver"

    @property
    def close_code(self) -> int | None:
        """The code with which the connection is closed after a hit; None: it stays."""
        return None

    @abstractmethod
    def apply(self, frame: WireFrame, key: Key, hit: bool, memory: Memory) -> tuple[Parts, bool]:
        """Return what becomes of a frame that the target matches or not, and whether the fault was injected."""

    def _errors(self) -> Iterator[tuple[str, str]]:
        yield from super()._errors()
        if self.frames and (self.every > 1 or self.probability < 1):
            yield "frame", "give 'frame', 'every' or a percentage, not two of them"


class Corruption(FrameFault):
    """A fault that changes a frame by itself.

    On CAN, a changed frame is one that a faulty node or gateway sent with a good CRC: the bus itself would have
    rejected it.
    """

    needs_all = False

    def apply(self, frame: WireFrame, key: Key, hit: bool, memory: Memory) -> tuple[Parts, bool]:
        """Return the corrupted frame if it is hit."""
        changed = self.corrupt(frame, memory.rng) if hit else None
        return ([(frame, 0)], False) if changed is None else (changed, True)

    @abstractmethod
    def corrupt(self, frame: WireFrame, rng: np.random.Generator) -> Parts | None:
        """Return the frames that arrive, or None where nothing can be corrupted, which is not counted."""


class LinkFault(Fault):
    """A fault of the port or the bus, not of single frames: it has a time and no target."""


class Outage(LinkFault):
    """A fault that has the link down while it applies."""

    removes_port: ClassVar[bool] = False
    """True if the port goes away; a driver sees that it is closed."""
    is_half_open: ClassVar[bool] = False
    """True if the connection stays, but the port neither reads nor answers."""

    @property
    def new_name(self) -> str:
        """The name under which the port comes back; "": its own."""
        return ""


@dataclass(frozen=True, kw_only=True)
class Traffic(LinkFault):
    """A fault by frames of another node, which take a share of the bus."""

    share: Annotated[float, SHARE] = 1.0
    arbitration_id: Annotated[int | None, IDENTIFIER] = None

    @abstractmethod
    def frame(self, rng: np.random.Generator) -> CanFrame:
        """Return the node's next frame."""
