"""The contract between a sensor's firmware model and whoever runs it.

A :class:`Device` is a state machine: readings and the driver's bytes go in, frames come out. It does no I/O, owns
no clock and draws no random number, so that every test is instant and the same inputs give the same bytes.

* ``__init__`` is power-up: what it sets is the firmware's memory, and a restart runs it again. Only ``flash`` survives.
* Time is an argument: ``t_ns``, integer nanoseconds on the device's own clock. Nothing here asks for it.
* A method returns what the firmware does, in order: frames to send, :class:`Sent`, :class:`Convert`, :class:`Restart`.

Frames and signs, once and for all:

* SI units up to the ADC, counts only after it.
* Vectors are in the frame of the *link that carries the skin*; a taxel's normal points out of the skin.
* Forces are those acting *on the skin*: a push has a negative component along the taxel's normal.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Literal

import numpy as np

from firmware_protocols import state as plain
from firmware_protocols.commands import Command
from firmware_protocols.connectors import Connector
from firmware_protocols.facts import Fact
from firmware_protocols.frames import CanFrame
from firmware_protocols.layouts import Layout
from firmware_protocols.motors import Motors

Quantity = Literal[
    "force", "pressure", "depth", "displacement", "touch", "field", "resistance", "capacitance",
    "temperature", "acceleration", "angular_velocity", "wrench", "vibration", "load",
]  # fmt: skip
"""What transducers see, at the n points of a layout.

Per taxel: ``force`` [N] (n, 3), ``pressure`` [Pa] (n,), ``depth`` [m] (n,), ``displacement`` [m] (n, 3), ``touch`` bool
(n,); where the scene has a transducer: ``field`` [T] (n, 3), ``resistance`` [Ohm] (n,), ``capacitance`` [F] (n,).
Around it: ``temperature`` [°C] (n,), ``acceleration`` [m/s²] (n, 3), proper, so that at rest it points up,
``angular_velocity`` [rad/s] (n, 3). Of all the skin's taxels together, about each point: ``wrench`` [N, Nm] (n, 6);
``vibration`` [Pa] (n,), the pressure in a common medium. ``load`` [Nm, N] (n,) of each joint, in the order of
:meth:`Device.joints`.
"""

TOUCH = ("force", "pressure", "depth", "displacement", "touch")
"""Quantities of each taxel by itself, which a model of touch gives."""
TRANSDUCED = ("field", "resistance", "capacitance")
"""Those that a transducer of the scene makes of them, for a device that sees them (its option ``sees``)."""
CONTACT = (*TOUCH, *TRANSDUCED)
VECTORS = ("force", "displacement", "field")
"""Quantities of three numbers."""
_DERIVED = {"wrench": "force", "vibration": "force"}
"""Quantities of all taxels together, and what they follow from."""

Axis = Literal["", "x", "y", "z"]

Evidence = Literal["captured", "vendor document", "firmware", "driver", "assumed"]
"""Where a byte table comes from, best first."""

Kind = Literal["hand", "fingertip", "glove", "force-torque sensor", "skin", ""]
"""What is bought: a hand, a gripper or its servos; a fingertip or a pad; a glove; a force-torque sensor; a skin, or
what joins many sensors to one line; or something else."""

if TYPE_CHECKING:  # a device's frames are bytes unless it says Device[CanFrame]
    from typing_extensions import TypeVar

    F = TypeVar("F", bound=bytes | CanFrame, default=bytes)
else:
    from typing import TypeVar

    F = TypeVar("F")


@dataclass(frozen=True, slots=True)
class Sent(Generic[F]):
    """A frame that is not simply sent now, where the cause came from."""

    frame: F
    port: str = ""
    """Default: where the request came in, else the device's first port."""
    delay_ns: int = 0
    """After the call (conversion, flash write ...); for an answer: after the request's last bit."""
    turn: int = 0
    """Place among the answers to one broadcast on a shared line: it begins when those before have ended."""


@dataclass(frozen=True, slots=True)
class Convert:
    """One conversion of a stream, out of its period: the runner calls ``measure`` and ``stream`` then."""

    stream: str = ""
    delay_ns: int = 0


@dataclass(frozen=True, slots=True)
class Restart:
    """Power-up again (reset command, watchdog, DTR), boot time included."""

    delay_ns: int = 0


Transmissions = Sequence["F | Sent[F] | Convert | Restart"]
Counts = np.ndarray | Mapping[str, np.ndarray]
"""What a perfect driver would decode, points in layout order; by sense where a stream converts several."""


@dataclass(frozen=True)
class Sense:
    """One quantity at the points of a layout; a quantity alone stands for ``Sense(quantity)`` at ``device.layout``."""

    quantity: Quantity
    at: Layout | None = None
    name: str = ""
    """Key in the reading and in the counts; default: the quantity."""
    burst: int = 1
    """Values per conversion, evenly over the time since the last, oldest first: a last axis of this length."""

    @property
    def key(self) -> str:
        """Its name in readings and counts."""
        return self.name or self.quantity


@dataclass(frozen=True)
class Stream:
    """Conversions at one rate, of some of the senses."""

    rate_hz: float
    """After power-up; 0 waits for the firmware to set a period, or for :class:`Convert`."""
    senses: tuple[str, ...] = ()
    """Keys; default: all."""


@dataclass(frozen=True, slots=True)
class Reading:
    """What the senses of one stream see at one instant: ``reading["force"]``, SI, points in layout order."""

    values: Mapping[str, np.ndarray]
    stream: str = ""

    def __getitem__(self, key: str) -> np.ndarray:
        if key not in self.values:
            raise KeyError(f"stream {self.stream!r} converts {sorted(self.values)}, not {key!r}: add it to `senses`")
        return self.values[key]


@dataclass(frozen=True, kw_only=True)
class Column:
    """One number of what :meth:`Device.measure` returns for a point: a column of the counts."""

    name: str
    axis: Axis = ""
    """Of the taxel's own frame; "" for a magnitude. A name tells columns apart, this does not."""
    unit: str = ""
    """SI unit; "" where no scale is published."""
    counts_per_unit: float | None = None
    """``None`` where it is not published, or the law is no line."""
    low: float
    """The least count that it can show."""
    high: float
    """The greatest count that it can show."""
    rest: float = 0
    """The count when nothing touches it, at 25 °C."""
    push: Literal[-1, 0, 1] = 0
    """Which way it goes as its taxel is pushed; 0: it need not move."""
    sense: str = ""
    """Key of the counts, where a device has several senses."""
    shared: bool = False
    """One number for all points, not one each."""


@dataclass(frozen=True, kw_only=True)
class Rollover:
    """A counter or clock on the wire that begins anew when it is full."""

    name: str
    bits: int
    step: int = 1
    """Per frame; of a clock: per second."""
    clock: bool = False
    """It counts time, not frames."""
    state: str = ""
    """The attribute that holds it (of a clock: what is added to the time), so that :meth:`Device.preset` can set it."""


class Device(ABC, Generic[F]):
    """A model of one sensor's firmware. One file, one family; the file's docstring is its datasheet.

    Write :meth:`measure`, then :meth:`stream` and :meth:`receive` where the sensor has them. Declarations are class
    attributes or, where an option decides, set in ``__init__`` (keyword-only options with defaults); the datasheet is
    printed from an instance. State is plain data (:mod:`firmware_protocols.state`).
    """

    name: ClassVar[str]
    """Registry name, lower case with underscores."""
    title: str
    """Vendor and model as people call it."""
    kind: Kind = ""
    """Where a list of devices has it."""
    ports: tuple[Connector, ...]
    """Its connectors, the usual one first. Live: a firmware that changes its baud rate replaces one."""
    senses: tuple[Quantity | Sense, ...] = ("force",)
    rate_hz: float = 100.0
    """Conversions per second after power-up, of a device with one stream. The user's wish overrides it."""
    streams: Mapping[str, Stream] = {}
    """Of a device with several, by name."""
    columns: tuple[Column, ...] = ()
    """What the counts mean."""
    rollovers: tuple[Rollover, ...] = ()
    boot_s: float = 0.0
    """After power-up or a restart: how long it neither samples nor hears [s]."""
    evidence: tuple[Evidence, ...]
    sources: tuple[str, ...]
    """Where each table comes from: repository@commit file, manual page, capture."""
    judge: str = "none"
    """The unmodified driver (package and version) that has read this device."""
    facts: tuple[Fact, ...] = ()
    """What is known beside the byte tables, and what each of it rests on."""
    scene: ClassVar[str] = ""
    """Default scene in the scene file's TOML (``docs/scene-files.md``), for a class outside the tree; it is not
    inherited. Empty: one is made from the layout, a ball that presses the middle of each patch."""

    layout: Layout
    """Where the taxels are. From the options alone: a restart makes an equal one."""

    options: Mapping[str, Any]
    """Given: what ``__init__`` got."""
    flash: dict[str, Any]
    """Given: survives power-off; empty in a new device."""
    counters: Counter[str]
    """Given: what became of the driver's bytes (``requests``, ``bad_checksum``, ``unknown_command`` ...). Of the
    emulation, not of the firmware: survives too."""
    wake_ns: int | None
    """Set it, and :meth:`wake` is called at that time of the device's clock."""

    if not TYPE_CHECKING:  # editors and checkers see the signature of __init__

        def __new__(cls, **options):  # noqa: D102
            device = super().__new__(cls)
            device.options, device.flash, device.counters, device.wake_ns = options, {}, Counter(), None
            return device

    # -- what the runner asks --------------------------------------------------------------------------------------

    @cached_property
    def periods(self) -> dict[str, int]:
        """The firmware's sampling periods by stream [ns]; 0 is off. A change starts counting anew."""
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
        """``senses`` in full."""
        whole = (Sense(each) if isinstance(each, str) else each for each in self.senses)
        return tuple(s if s.at is not None else Sense(s.quantity, self.layout, s.name, s.burst) for s in whole)

    @property
    def contact(self) -> tuple[str, ...]:
        """What a model of touch must give at the taxels of :attr:`layout`, first sense first; ``force`` if nothing."""
        wanted = [_DERIVED.get(sense.quantity, sense.quantity) for sense in self.sensed]
        return tuple(dict.fromkeys(name for name in wanted if name in CONTACT)) or ("force",)

    @property
    def drives(self) -> Motors | None:
        """What a physics engine may move: its attribute ``motors``, if those have the names of joints."""
        motors = vars(self).get("motors")
        return motors if isinstance(motors, Motors) and motors.names else None

    def senses_of(self, stream: str) -> tuple[Sense, ...]:
        """What one stream converts."""
        wanted = self.streams[stream].senses if self.streams else ()
        return tuple(sense for sense in self.sensed if not wanted or sense.key in wanted)

    def connector(self, port: str) -> Connector:
        """Return the connector called ``port``; a client of one (``tcp/2``) is the connector's own."""
        name = port.partition("/")[0]
        return next(each for each in self.ports if each.name == name)

    def power_cycle(self) -> None:
        """Forget everything but options, flash and counters, and power up. The runner's, as is the time it takes."""
        kept = {name: getattr(self, name) for name in ("options", "flash", "counters")}
        vars(self).clear()
        vars(self).update(kept, wake_ns=None)
        self.__init__(**self.options)

    def snapshot(self) -> dict[str, Any]:
        """Return the whole state as plain data, for :meth:`restore` of a device with the same options, also
        elsewhere.
        """
        return plain.save(self)

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a snapshot, as often as you like."""
        plain.load(self, state)

    def preset(self, name: str, value: int) -> None:
        """Set a counter or clock of :attr:`rollovers`, so that a test need not wait until it is full.

        Raises:
            KeyError: it has none of this name that can be set.
        """
        for each in self.rollovers:
            if each.name == name and each.state:
                setattr(self, each.state, value)
                return
        raise KeyError(f"{self.name}: no counter {name!r} to preset: {[r.name for r in self.rollovers if r.state]}")

    # -- what a device writes --------------------------------------------------------------------------------------

    @abstractmethod
    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return the ADC: SI values into state; returns what a perfect driver would decode, saturation included.

        Points in layout order, shape ``(n_points,)`` or ``(n_points, n_columns)``; by sense where there are several.
        Sends nothing. Called once after boot, before the first period, so that a polled device knows a value.
        """

    def stream(self, t_ns: int, name: str) -> Transmissions[F]:
        """What leaves unasked after each conversion of the stream ``name``."""
        return ()

    def receive(self, data: F, t_ns: int, port: str) -> Transmissions[F]:
        """Return bytes in chunks of any size, or one CAN frame, from the driver; the firmware's answers.

        Never raises on bad input: it is counted in ``self.counters`` and answered as the firmware would, or not at all.
        """
        self.counters["ignored"] += 1
        return ()

    def boot(self, t_ns: int) -> Transmissions[F]:
        """What it says when it has booted."""
        return ()

    def lines(self, dtr: bool, rts: bool, t_ns: int, port: str) -> Transmissions[F]:
        """Modem lines moved; where there are none, both follow the port: opened or connected, closed."""
        return ()

    def wake(self, t_ns: int) -> Transmissions[F]:
        """``wake_ns`` has come (and is ``None`` again)."""
        return ()

    def joints(self, t_ns: int) -> Mapping[str, float]:
        """Where its actuators are [rad, m]; bodies of the scene may follow."""
        return {}

    @property
    def commands(self) -> tuple[Command, ...]:
        """Every documented command, for the datasheet and for ``tactemu check``."""
        return ()
