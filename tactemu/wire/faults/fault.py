"""The text form of a fault, and the options of each kind.

::

    KIND [N% | every N | frame N,N-N,...] [id=0x201] [prefix=55aa] [to_driver | from_driver | both]
         [at T [for T] | from T] [to T] [by T] [bits N | bytes N | frames N | code N]
         [byte N [bit N]] [after N] [to N] [hex=aa07] [as NAME]

``N%`` is the probability per frame (for ``load`` and ``babble`` the share of the bus), ``every N`` hits each N-th frame
that the target matches, ``frame 37,40-42`` these and no other; without any of the three, all are hit. Frames are
counted from 1 since the fault was switched on, as far as the target matches them and a driver has the port open. Times
are emulation times: ``3s``, ``16ms``, ``200us``. A fault of frames with ``at T`` and no ``for`` hits the first frame
from then on. The default direction is ``to_driver``.

``byte N`` (from 0; from the end if negative) and ``bit N`` (0 is the lowest) give the changed place, ``after N`` the
number of bytes before a cut or an insertion, ``to N`` the number of bytes that are left; the default is random.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from difflib import get_close_matches
from typing import Any, Literal

from tactemu.base.errors import SceneError, shown
from tactemu.base.units import scaled

Direction = Literal["to_driver", "from_driver", "both"]
DIRECTIONS: tuple[Direction, ...] = ("to_driver", "from_driver", "both")
ALL_LINES = ("serial", "can", "tcp", "udp", "websocket", "dds")
"""The ``kind`` of every line model."""


@dataclass(frozen=True, slots=True)
class FaultKind:
    """A kind of fault."""

    about: str
    """The effect, as ``tactemu faults`` prints it."""
    wires: tuple[str, ...] = ALL_LINES
    """The kinds of line that can have it."""
    options: tuple[str, ...] = ()
    """The options, out of :data:`_AMOUNTS`, :data:`_PLACES`, ``by``, ``to`` (a length), ``hex=`` and ``as``."""
    acts_on_link: bool = False
    """True for a fault of the port or the bus, not of single frames: it has a time and no target."""
    by_ns: int = 0
    """The default of ``by`` [ns]."""
    keeps_frame: bool = False
    """True if the frame itself still arrives undamaged: the judge then expects its reading from the driver."""
    mixes_samples: bool = False
    """True if it can still damage a sample of several frames."""


_BYTES = ("serial", "tcp")
_CAN = ("can",)
_CONNECTED = ("tcp", "websocket")
KINDS: dict[str, FaultKind] = {
    # word: its effect, lines, options and consequences; docs/wire.md ("Adding a fault") names the other places
    "drop": FaultKind("the frame is lost"),
    "flip": FaultKind("bits of the data change", options=("bits", "byte", "bit")),
    "lose": FaultKind("one byte is missing", options=("byte",)),
    "truncate": FaultKind("the end is missing", options=("bytes", "to")),
    "length": FaultKind("the frame is too long (a full CAN frame too short)", options=("bytes",)),
    "checksum": FaultKind("the last bytes are wrong", options=("bytes",)),
    "duplicate": FaultKind("sent twice", keeps_frame=True),
    "reorder": FaultKind("sent after the next one", options=("frames",), keeps_frame=True, mixes_samples=True),
    "replace": FaultKind("other bytes in its place", options=("hex=",)),
    "garbage": FaultKind(
        "random bytes before the frame, or in it", _BYTES, ("bytes", "after", "hex="), keeps_frame=True
    ),
    "split": FaultKind(
        "arrives in two pieces, the second later",
        (*_BYTES, "websocket"),
        ("by", "after"),
        by_ns=1_000_000,
        keeps_frame=True,
    ),
    "chunk": FaultKind("arrives in pieces, each later", _BYTES, ("by", "bytes"), by_ns=1_000_000, keeps_frame=True),
    "merge": FaultKind("arrives together with the next one", _BYTES, keeps_frame=True),
    "late": FaultKind(
        "leaves later; on a byte stream, so does all that follows", options=("by",), by_ns=10_000_000, keeps_frame=True
    ),
    "stray": FaultKind("an earlier frame comes again, unasked", keeps_frame=True, mixes_samples=True),
    "silence": FaultKind("no frame passes"),
    "latency": FaultKind(
        "a USB-serial chip hands over 62 bytes, or what it has when its timer fires",
        ("serial",),
        ("by",),
        acts_on_link=True,
        by_ns=16_000_000,
        keeps_frame=True,
    ),
    "close": FaultKind("the connection is closed in its place, and may be opened again", _CONNECTED, ("code",)),
    "halfopen": FaultKind(
        "the connection stays, but the other end is dead", ("serial", *_CONNECTED), acts_on_link=True
    ),
    "unplug": FaultKind("the port goes away, and comes back", options=("as",), acts_on_link=True),
    "error": FaultKind("an error frame breaks the frame, which is sent again", _CAN),
    "busoff": FaultKind("the node leaves the bus, and recovers", _CAN, acts_on_link=True),
    "babble": FaultKind("another node fills the bus with the highest priority", _CAN, acts_on_link=True),
    "load": FaultKind("other traffic takes a share of the bus", _CAN, acts_on_link=True),
}

_MAX_TIME_NS = 10**18
_UNITS = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
_WORDS = (
    "N%",
    "every",
    "id=",
    "frame",
    "prefix=",
    "hex=",
    *DIRECTIONS,
    "at",
    "from",
    "to",
    "for",
    "by",
    "bits",
    "bytes",
    "frames",
    "code",
    "byte",
    "bit",
    "after",
    "as",
)
_PLACES = {"byte": (-65_536, 65_536), "bit": (0, 7), "after": (0, 65_536)}
"""Words that give a place, and their bounds."""
_AMOUNTS = {"bits": (1, 65_536), "bytes": (1, 65_536), "frames": (1, 65_536), "code": (1000, 4999)}
"""Words that give an amount, and their bounds."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Fault:
    """A parsed fault. Times are in emulation nanoseconds."""

    kind: str
    probability: float = 1.0
    every: int = 1
    direction: Direction = "to_driver"
    arbitration_id: int | None = None
    prefix: bytes = b""
    start_ns: int = 0
    stop_ns: int | None = None
    once: bool = False
    """True for a fault that hits one frame and is over."""
    by_ns: int = 0
    amount: int | None = None
    """The number of bits, bytes or frames, or the code, where the kind takes one."""
    frames: tuple[tuple[int, int], ...] = ()
    """First and last numbers of the frames that are hit; empty: frames are not chosen by number."""
    byte: int | None = None
    bit: int | None = None
    after: int | None = None
    """The number of bytes before the cut or the insertion."""
    length: int | None = None
    """The number of bytes that are left."""
    data: bytes = b""
    """The bytes that are inserted."""
    name: str = ""
    """The name of the port when it comes back."""
    text: str = ""

    def __post_init__(self):
        if self.kind not in KINDS or self.every < 1 or not 0 <= self.probability <= 1:
            raise SceneError(f"fault {str(self)!r}: no such kind or share of frames")

    def __str__(self) -> str:
        return self.text or self.kind

    def covers(self, t_ns: int) -> bool:
        """Return True if the fault applies at this time."""
        return self.start_ns <= t_ns and (self.stop_ns is None or t_ns < self.stop_ns)

    def scheduled(self, start_ns: int, stop_ns: int | None = None) -> Fault:
        """Return the fault from ``start_ns`` on, until ``stop_ns`` or for the duration in its own text.

        Raises:
            SceneError: its own text has a start, or its end is given twice.
        """
        words = self.text.split()
        if {"at", "from"} & set(words) or ("to" in words and self.length is None):
            raise SceneError(f"scenario: fault {self.text!r}: give its time as the event's `at` and `until`")
        lasts, text, start = "for" in words, " ".join(words), f"{start_ns}ns"
        if lasts and stop_ns is not None:
            raise SceneError(f"scenario: fault {self.text!r}: give `for` or `until`, not both")
        if lasts and self.stop_ns is not None:
            return replace(
                self, start_ns=start_ns, stop_ns=start_ns + self.stop_ns, text=text.replace("for", f"at {start} for", 1)
            )
        ends = "" if stop_ns is None else f" to {stop_ns}ns"
        return replace(self, start_ns=start_ns, stop_ns=stop_ns, text=f"{text} from {start}{ends}")

    def check_fits(self, wire_kind: str) -> None:
        """Raise if a wire of this kind cannot have the fault.

        Raises:
            SceneError: names the kinds that it can have.
        """
        if wire_kind not in KINDS[self.kind].wires:
            can = ", ".join(name for name, kind in KINDS.items() if wire_kind in kind.wires)
            raise SceneError(f"fault {str(self)!r}: a {wire_kind} wire cannot have it; expected one of: {can}")
        if self.arbitration_id is not None and wire_kind != "can":
            raise SceneError(
                f"fault {str(self)!r}: 'id=': a {wire_kind} wire has no identifiers; name frames by prefix=HEX"
            )


def parse(text: str) -> Fault:
    """Return the fault that ``text`` describes.

    Raises:
        SceneError: names the word that is wrong and those that are expected.
    """
    words = text.split()
    if not words:
        raise SceneError(f"an empty fault; expected one of: {', '.join(KINDS)}")
    kind, *options = words
    if kind not in KINDS:
        raise SceneError(
            f"fault {shown(text)}: unknown kind {shown(kind)}{_near(kind, KINDS)}; expected one of: {', '.join(KINDS)}"
        )
    return _Words(text, kind, options).fault()


class _Words:
    """A parser of the words after the kind."""

    def __init__(self, text: str, kind: str, words: list[str]):
        self.text, self.kind, self.words = text, kind, words
        self.values: dict[str, Any] = {}

    def fault(self) -> Fault:
        while self.words:
            self._take(self.words.pop(0))
        values, acts_on_link = self.values, KINDS[self.kind].acts_on_link
        at, length = values.pop("at", None), values.pop("for", None)
        if at is not None:
            if "start_ns" in values:
                raise self._wrong("at", "give 'at' or 'from', not both")
            values["start_ns"] = at
            values["once"] = length is None and not acts_on_link
        if length is not None:
            if "stop_ns" in values:
                raise self._wrong("for", "give 'for' or 'to', not both")
            values["stop_ns"] = values.get("start_ns", 0) + length
        fault = replace(Fault(kind=self.kind, text=self.text, by_ns=KINDS[self.kind].by_ns), **values)
        self._check_combination(fault)
        if fault.stop_ns is not None and fault.stop_ns <= fault.start_ns:
            raise self._wrong("to" if length is None else "for", "it ends before it begins")
        return fault

    def _check_combination(self, fault: Fault) -> None:
        """Raise if words are missing that others need, or if words exclude each other."""
        if fault.frames and (fault.every > 1 or fault.probability < 1):
            raise self._wrong("frame", "give 'frame', 'every' or a percentage, not two of them")
        if fault.bit is not None and fault.byte is None:
            raise self._wrong("bit", "of which byte? Name it, as in 'byte 10 bit 3'")
        if fault.byte is not None and fault.amount is not None:
            raise self._wrong("byte", f"give one place or {fault.amount} random bits, not both")
        if fault.length is not None and fault.amount is not None:
            raise self._wrong("to", "give 'to' or 'bytes', not both")
        if fault.kind == "replace" and not fault.data:
            raise self._wrong("replace", "by what? Give the bytes, as in 'replace frame 3 hex=01830286'")

    def _take(self, word: str) -> None:
        if match := re.fullmatch(r"([\d.]+)%", word):
            self._set(word, "probability", self._percent(word, match[1]))
        elif word in DIRECTIONS:
            self._set(word, "direction", word)
        elif word.startswith("id="):
            self._set(word, "arbitration_id", self._integer(word, word[3:], 0x1FFF_FFFF))
        elif word.startswith("prefix="):
            self._set(word, "prefix", self._hex(word))
        elif word.startswith("hex="):
            self._set(word, "data", self._hex(word))
        elif word == "frame":
            self._set(word, "frames", self._numbers(self._next(word)))
        elif word in _PLACES:
            least, most = _PLACES[word]
            self._set(word, word, self._integer(word, self._next(word), most, least=least))
        elif word == "as":
            self._set(word, "name", self._name(self._next(word)))
        elif word == "to" and self.words[:1] and self.words[0].isdigit() and "to" in KINDS[self.kind].options:
            self._set(word, "length", self._integer(word, self._next(word), 65_536))
        elif word in ("at", "from", "to", "for", "by"):
            name = {"from": "start_ns", "to": "stop_ns", "by": "by_ns"}.get(word, word)
            self._set(word, name, self._duration(word, self._next(word)))
        elif word == "every":
            self._set(word, word, self._integer(word, self._next(word), 65_536, least=1))
        elif word in _AMOUNTS:
            least, most = _AMOUNTS[word]
            self._set(word, "amount", self._integer(word, self._next(word), most, least=least))
        elif self.kind == "latency" and word[:1].isdigit():
            self._set(word, "by_ns", self._duration(word, word))
        else:
            raise self._wrong(word, f"unknown word{_near(word, _WORDS)}; expected {', '.join(_WORDS)}")
        self._check_allowed(word)

    def _check_allowed(self, word: str) -> None:
        kind = KINDS[self.kind]
        option = "hex=" if word.startswith("hex=") else word
        if option in ("by", "hex=", "as", *_AMOUNTS, *_PLACES) and option not in kind.options:
            takes = ", ".join(name for name, each in KINDS.items() if option in each.options)
            raise self._wrong(word, f"{self.kind} has no such option; these have: {takes}")
        targets = word in ("every", "frame") or word in DIRECTIONS or word.startswith(("prefix=", "id="))
        traffic = self.kind in ("babble", "load")
        if kind.acts_on_link and (
            (targets and not (traffic and word.startswith("id="))) or (word[-1] == "%" and not traffic)
        ):
            raise self._wrong(word, f"{self.kind} is a fault of the link: give it a time only")

    def _set(self, word: str, name: str, value: Any) -> None:
        if name in self.values:
            raise self._wrong(word, "given twice")
        self.values[name] = value

    def _next(self, word: str) -> str:
        if not self.words:
            raise self._wrong(word, "a value must follow, as in 'at 3s', 'every 10', 'bits 2'")
        return self.words.pop(0)

    def _duration(self, word: str, value: str) -> int:
        time_ns = scaled(value, _UNITS)
        if time_ns is None or not 0 <= time_ns <= _MAX_TIME_NS:
            raise self._wrong(word, f"expected a time such as 3s, 16ms or 200us, got {value!r}")
        return round(time_ns)

    def _percent(self, word: str, digits: str) -> float:
        try:
            value = float(digits) / 100
        except ValueError:
            value = -1.0
        if not 0 <= value <= 1:
            raise self._wrong(word, "expected 0% to 100%")
        return value

    def _integer(self, word: str, value: str, most: int, least: int = 0) -> int:
        try:
            number = int(value, 0)
        except ValueError:
            number = -1
        if not least <= number <= most:
            raise self._wrong(word, f"expected a whole number from {least} to {most} (0x{most:X}), got {value!r}")
        return number

    def _numbers(self, value: str) -> tuple[tuple[int, int], ...]:
        """Return the first and last numbers of ranges such as ``37,40-42``."""
        pairs = []
        for part in value.split(","):
            first, dash, last = part.partition("-")
            low = self._integer("frame", first, 10**9, least=1)
            pairs.append((low, self._integer("frame", last, 10**9, least=low) if dash else low))
        return tuple(pairs)

    def _name(self, value: str) -> str:
        if "/" in value or value in (".", ".."):
            raise self._wrong("as", f"expected a name in the same folder, such as ttyUSB1, got {value!r}")
        return value

    def _hex(self, word: str) -> bytes:
        value = word.partition("=")[2]
        try:
            return bytes.fromhex(value.removeprefix("0x"))
        except ValueError:
            raise self._wrong(word, f"expected bytes in hex such as 55aa, got {value!r}") from None

    def _wrong(self, word: str, why: str) -> SceneError:
        return SceneError(f"fault {self.text!r}: {word!r}: {why}")


def _near(word: str, known) -> str:
    near = get_close_matches(word, list(known), n=1)
    return f", did you mean {near[0]!r}?" if near else ""
