"""The contract between a sensor's firmware model and the program that runs it.

A :class:`Device` is a state machine: readings and the driver's bytes go in, frames come out. It does no I/O, owns
no clock and draws no random number, so that every test is instant and the same inputs give the same bytes.

* ``__init__`` is power-up: what it sets is the firmware's memory, and a restart runs it again. Only ``flash`` survives.
* Time is an argument: ``t_ns``, integer nanoseconds on the device's own clock. A device reads no clock.
* A method returns what the firmware does, in order: frames to send, :class:`Sent`, :class:`Convert`, :class:`Restart`.

Frames of reference and signs:

* SI units up to the ADC, counts only after it.
* Vectors are in the frame of the *link that carries the skin*; a taxel's normal points out of the skin.
* Forces are those acting *on the skin*: a push has a negative component along the taxel's normal.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Literal

from firmware_protocols import requests
from firmware_protocols import state as plain
from firmware_protocols.can_requests import CanRequests
from firmware_protocols.commands import Command, handled_in
from firmware_protocols.connectors import Connector
from firmware_protocols.conversion import conversion
from firmware_protocols.facts import Fact
from firmware_protocols.frames import CanFrame
from firmware_protocols.layouts import Layout
from firmware_protocols.motors import Motors
from firmware_protocols.senses import CONTACT, DERIVED, Column, Counts, Quantity, Reading, Rollover, Sense, Stream

Evidence = Literal["captured", "vendor document", "firmware", "driver", "assumed"]
"""The kinds of source of a byte table, best first."""

DeviceKind = Literal["hand", "fingertip", "glove", "force-torque sensor", "skin", ""]
"""The kind of product: a hand, a gripper or its servos; a fingertip or a pad; a glove; a force-torque sensor; a skin,
or a hub that joins many sensors to one line; empty for any other."""

if TYPE_CHECKING:  # a device's frames are bytes unless it says Device[CanFrame]
    import numpy as np
    from typing_extensions import TypeVar

    F = TypeVar("F", bound=bytes | CanFrame, default=bytes)
else:
    from typing import TypeVar

    F = TypeVar("F")


@dataclass(frozen=True, slots=True)
class Sent(Generic[F]):
    """A frame that leaves later, on another port, or in turn; a plain frame leaves at once on the request's port."""

    frame: F
    port: str = ""
    """The port; default: the one on which the request arrived, else the device's first."""
    delay_ns: int = 0
    """The delay after the call (conversion, flash write ...); of an answer: after the request's last bit."""
    turn: int = 0
    """The place among the answers to one broadcast on a shared line: it begins when those before it have ended."""


@dataclass(frozen=True, slots=True)
class Convert:
    """A conversion of a stream outside its period: the runner then calls ``measure`` and ``stream``."""

    stream: str = ""
    delay_ns: int = 0


@dataclass(frozen=True, slots=True)
class Restart:
    """A restart (reset command, watchdog, DTR): power-up again, boot time included."""

    delay_ns: int = 0


Transmissions = Sequence[F | Sent[F] | Convert | Restart]
"""The actions of the firmware, in order."""


class Device(Generic[F]):
    """A model of one sensor's firmware. One file, one family; the file's docstring is its datasheet.

    Declarations are class attributes or, where an option decides, set in ``__init__`` (keyword-only options with
    defaults); the datasheet is printed from an instance. :meth:`measure` follows from ``columns``; write
    :meth:`stream`, and methods that answer commands (:func:`~firmware_protocols.command`) where the sensor has them.
    State is plain data (:mod:`firmware_protocols.state`).
    """

    name: ClassVar[str]
    """The name in the registry, lower case with underscores."""
    title: str
    """Vendor and model as people call it."""
    kind: DeviceKind = ""
    """The heading of the device in lists of devices."""
    ports: tuple[Connector, ...]
    """The connectors, the usual one first. Live: a firmware that changes its baud rate replaces one."""
    senses: tuple[Quantity | Sense, ...] = ("force",)
    """The quantities that its transducers measure."""
    rate_hz: float = 100.0
    """The conversions per second after power-up, of a device with one stream. An option of the run overrides it."""
    streams: Mapping[str, Stream] = {}
    """The streams of a device with several, by name."""
    columns: tuple[Column, ...] = ()
    """The meaning of the counts."""
    tables: ClassVar[tuple[Any, ...]] = ()
    """The frames and registers of this class, where its module has others, too; default: all of the module."""
    rollovers: tuple[Rollover, ...] = ()
    """The counters and clocks on the wire."""
    boot_s: float = 0.0
    """The time after power-up or a restart in which it neither samples nor receives [s]."""
    evidence: tuple[Evidence, ...]
    """The kinds of source of its byte tables."""
    sources: tuple[str, ...]
    """The source of each table: repository@commit file, manual page, capture."""
    judge: str = "none"
    """The unmodified driver (package and version) that has read this device."""
    facts: tuple[Fact, ...] = ()
    """The facts besides the byte tables, each with its basis."""
    documented: tuple[Command, ...] = ()
    """Documented commands beside those of methods, of a device with default options."""
    origin: str = ""
    """The source of the examples of commands, where they have no other."""
    documented_with: tuple[str, ...] | None = ()
    """The options that leave the documented commands as they are; ``None``: all of them."""
    scene: ClassVar[str] = ""
    """The default scene in the scene file's TOML (``docs/scene-files.md``), for a class outside the tree; it is not
    inherited. Empty: one is made from the layout, a ball that presses the middle of each patch."""

    packets: Any
    """The cutter of requests, for methods that declare commands; made in ``__init__``."""
    zero: Any = 0.0
    """The values of the first sense that count as 0 [SI]; a tare sets it to ``present``."""
    present: Any
    """The values of the first sense at the latest conversion [SI], one for each column, before the zero."""
    counts: Any
    """The counts of the latest conversion, as :meth:`measure` returned them."""

    layout: Layout
    """The positions of the taxels. They follow from the options alone: a restart makes an equal layout."""

    options: Mapping[str, Any]
    """The arguments of ``__init__``; set for you."""
    flash: dict[str, Any]
    """The memory that survives power-off, empty in a new device; set for you."""
    counters: Counter[str]
    """The counts of requests and errors in the driver's bytes (``requests``, ``bad_checksum``, ``unknown_command``
    ...); set for you. They belong to the emulation, not to the firmware, and survive, too."""
    wake_ns: int | None
    """The time of the device's clock at which :meth:`wake` is called; ``None``: never. Set it in your methods."""

    if not TYPE_CHECKING:  # editors and checkers see the signature of __init__

        def __new__(cls, **options):  # noqa: D102
            device = super().__new__(cls)
            device.options, device.flash, device.counters, device.wake_ns = options, {}, Counter(), None
            return device

    # -- called by the runner --------------------------------------------------------------------------------------

    @cached_property
    def periods(self) -> dict[str, int]:
        """The firmware's sampling periods by stream [ns]; 0 is off. A change restarts the period."""
        streams = self.streams or {"": Stream(self.rate_hz)}
        return {name: round(1e9 / each.rate_hz) if each.rate_hz else 0 for name, each in streams.items()}

    @property
    def period_ns(self) -> int:
        """The period of a device with one stream [ns]; a command may change it."""
        return self.periods[""]

    @period_ns.setter
    def period_ns(self, value: int) -> None:
        if value < 0:
            raise ValueError(f"{self.name}: a sampling period must be >= 0 ns, got {value}")
        self.periods[""] = int(value)

    @property
    def sensed(self) -> tuple[Sense, ...]:
        """``senses`` as :class:`Sense`, each with its layout."""
        senses = (Sense(each) if isinstance(each, str) else each for each in self.senses)
        return tuple(s if s.at is not None else Sense(s.quantity, self.layout, s.name, s.burst) for s in senses)

    @property
    def contact(self) -> tuple[str, ...]:
        """The quantities that a sensor model must compute at the taxels, first sense first; ``force`` if none."""
        wanted = [DERIVED.get(sense.quantity, sense.quantity) for sense in self.sensed]
        return tuple(dict.fromkeys(name for name in wanted if name in CONTACT)) or ("force",)

    @property
    def drives(self) -> Motors | None:
        """The motors that a physics engine may move: the attribute ``motors``, if it names joints."""
        motors = vars(self).get("motors")
        return motors if isinstance(motors, Motors) and motors.names else None

    def senses_of(self, stream: str) -> tuple[Sense, ...]:
        """Return the senses that one stream converts."""
        wanted = self.streams[stream].senses if self.streams else ()
        return tuple(sense for sense in self.sensed if not wanted or sense.key in wanted)

    def connector(self, port: str) -> Connector:
        """Return the connector called ``port``; the port of one client (``tcp/2``) belongs to the connector ``tcp``.

        Raises:
            LookupError: there is no such connector.
        """
        name = port.partition("/")[0]
        for each in self.ports:
            if each.name == name:
                return each
        raise LookupError(f"no connector {name!r}; there are: {', '.join(each.name for each in self.ports)}")

    def power_cycle(self) -> None:
        """Forget everything but options, flash and counters, and power up. Only the runner calls it."""
        kept = {name: getattr(self, name) for name in ("options", "flash", "counters")}
        vars(self).clear()
        vars(self).update(kept, wake_ns=None)
        self.__init__(**self.options)

    def snapshot(self) -> dict[str, Any]:
        """Return the whole state as plain data, for :meth:`restore` of a device with these options in any process."""
        return plain.snapshot(self)

    def restore(self, state: dict[str, Any]) -> None:
        """Set the state to that of a snapshot, which may be used many times."""
        plain.restore(self, state)

    def preset(self, name: str, value: int) -> None:
        """Set a counter or clock of :attr:`rollovers`, so that a test need not wait until it is full.

        Raises:
            KeyError: the device has no counter or clock of this name that can be set.
        """
        for each in self.rollovers:
            if each.name == name and each.state:
                setattr(self, each.state, value)
                return
        raise KeyError(f"{self.name}: no counter {name!r} to preset: {[r.name for r in self.rollovers if r.state]}")

    # -- written by the author of a device -------------------------------------------------------------------------

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Convert SI values, keep the counts in the state, and return them: the ADC, saturation included.

        They are the values that a perfect driver would decode, points in layout order, shape ``(n_points,)`` or
        ``(n_points, n_columns)``; by sense where there are several. The method sends nothing. It is also called once
        after boot, before the first period, so that a polled device has a value.

        By default each sense is converted by its columns (:mod:`firmware_protocols.conversion`); senses without columns
        are left out.
        """
        found = {}
        for k, sense in enumerate(self.senses_of(reading.stream)):
            is_first = k == 0 and sense.key == self.sensed[0].key
            if (own := conversion(self.columns, sense, is_first)) is None:
                continue
            values = own.values(sense, reading[sense.key])
            if is_first:
                self.present = values = self.filtered(values, t_ns)
            found[sense.key] = own.counts(values - self.zero if is_first else values)
        is_one = len(found) == 1 and not self.streams and len(self.sensed) == 1
        self.counts = next(iter(found.values())) if is_one else found
        return self.counts

    def filtered(self, values: np.ndarray, t_ns: int) -> np.ndarray:
        """Return the values of the first sense behind the firmware's filter; by default there is none."""
        return values

    def stream(self, t_ns: int, name: str) -> Transmissions[F]:
        """Return the transmissions that follow each conversion of the stream ``name`` without a request."""
        return ()

    def receive(self, data: F, t_ns: int, port: str) -> Transmissions[F]:
        """Return the firmware's answers to bytes in chunks of any size, or to one CAN frame, from the driver.

        The method never raises on bad input: it counts it in ``self.counters`` and answers as the firmware would, if at
        all. By default the requests that a cutter ``packets`` cuts go to the methods that declare them.
        """
        if not hasattr(self, "packets"):
            self.counters["ignored"] += 1
            return ()
        return requests.answers(self, data, t_ns, port)

    def obey(self, request: F, t_ns: int, port: str = "") -> Transmissions[F]:
        """Return the answers to one whole request, such as one that a silence has ended."""
        return requests.answer(self, request, t_ns, port)

    def accepts(self, request: requests.Request) -> bool:
        """Return True if a request of the table is for this device; others count as ``packets.others``."""
        return True

    def reply(self, request: requests.Request, content: bytes) -> Transmissions[F]:
        """Return the answer with this content to a request; by default the content itself, and nothing if empty.

        On CAN it is the data of a frame under the request's identifier.
        """
        if content and isinstance(self.packets, CanRequests):
            return [self.packets.frame(request.id, content)]  # type: ignore[list-item]
        return [content] if content else ()  # type: ignore[list-item]

    def staged(self, request: requests.Request) -> Transmissions[F]:
        """Return the answers to a later stage of a request, the bytes that ``packets.expect`` asked for."""
        return ()

    def refused(self, request: requests.Request, why: str) -> Transmissions[F]:
        """Return the answer to a request that was counted as ``unknown_command``, ``bad_length`` or ``refused``.

        Also to a broken one of a cutter that returns those, with their counter.
        """
        return ()

    def boot(self, t_ns: int) -> Transmissions[F]:
        """Return the transmissions at the end of booting, such as a banner."""
        return ()

    def lines(self, dtr: bool, rts: bool, t_ns: int, port: str) -> Transmissions[F]:
        """Return the answers to a change of the modem lines.

        Where there are none, both follow the port: high when it is opened or connected, low when it is closed.
        """
        return ()

    def wake(self, t_ns: int) -> Transmissions[F]:
        """Return the transmissions at the time ``wake_ns``, which is ``None`` again."""
        return ()

    def joints(self, t_ns: int) -> Mapping[str, float]:
        """Return the positions of the actuators by joint [rad, m]; bodies of the scene may follow them.

        By default those of ``motors``, if they are named.
        """
        return self.drives.joints(t_ns) if self.drives else {}

    @property
    def commands(self) -> tuple[Command, ...]:
        """Every documented command, for the datasheet and for ``tactemu check``.

        By default ``documented`` and those of the methods, in the order of the file; none if an option may change them.
        """
        if self.documented_with is not None and self.options.keys() - set(self.documented_with):
            return ()
        named = [each for handled in handled_in(type(self)).values() for each in handled.commands]
        return (*self.documented, *(each if each.origin else replace(each, origin=self.origin) for each in named))
