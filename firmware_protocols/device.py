"""The contract between a sensor's firmware model and whoever runs it.

A :class:`Device` is a state machine: readings and the driver's bytes go in, frames come out. It does no I/O, owns
no clock and draws no random number; the time is an argument (``t_ns``, integer nanoseconds since power-on of the
emulation), so that every test is instant and the same inputs give the same bytes.

Frames and signs, once and for all:

* SI units up to the ADC, counts only after it.
* Vectors are in the *link frame of the skin*; a taxel's normal points out of the skin.
* Forces are those acting *on the skin*: a push has a negative component along the taxel's normal.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import numpy as np

Quantity = Literal["force", "pressure", "depth", "displacement", "touch"]
"""What a device's transducers see: ``force`` [N] (n, 3), ``pressure`` [Pa] (n,), ``depth`` [m] (n,),
``displacement`` [m] (n, 3), ``touch`` bool (n,)."""

Evidence = Literal["captured", "vendor document", "firmware", "driver", "assumed"]
"""Where a byte table comes from, best first."""


@dataclass(frozen=True, kw_only=True, slots=True)
class CanFrame:
    """One CAN or CAN-FD frame. ``data`` is at most 8 bytes, or a valid FD length when ``is_fd``."""

    arbitration_id: int
    data: bytes = b""
    is_extended_id: bool = False
    is_remote_frame: bool = False
    is_fd: bool = False
    bitrate_switch: bool = False
    is_error_frame: bool = False
    """Not a frame of a device: the bus was disturbed while this frame was on it (made by faults, seen by drivers)."""

    def __str__(self) -> str:
        """``candump`` notation: ``027#B1C6`` (classic), ``18FF0000##1AABB`` (FD, flags digit)."""
        ident = f"{self.arbitration_id:08X}" if self.is_extended_id else f"{self.arbitration_id:03X}"
        if self.is_error_frame:
            return f"{ident}#ERROR"
        if self.is_remote_frame:
            return f"{ident}#R"
        mark = f"##{int(self.bitrate_switch)}" if self.is_fd else "#"
        return f"{ident}{mark}{self.data.hex().upper()}"


Frame = bytes | CanFrame
"""A serial frame is ``bytes`` and is written in one ``write()``; a CAN frame is a :class:`CanFrame`."""


@dataclass(frozen=True, slots=True)
class Delayed:
    """A frame that the firmware sends ``delay_ns`` after the call that caused it (conversion, flash write ...)."""

    frame: Frame
    delay_ns: int


Outgoing = Frame | Delayed


@dataclass(frozen=True, kw_only=True)
class SerialWire:
    """A UART or a USB-CDC port. On a true UART (``usb=False``) the driver's baud must match and bytes take time."""

    baud: int
    bytesize: int = 8
    parity: Literal["N", "E", "O"] = "N"
    stopbits: int = 1
    usb: bool = False
    """USB-CDC: the baud rate is a number that nobody uses; neither pacing nor mismatch applies."""

    kind: ClassVar[str] = "serial"

    @property
    def bits_per_byte(self) -> int:
        """Start, data, parity and stop bits."""
        return 1 + self.bytesize + (self.parity != "N") + self.stopbits


@dataclass(frozen=True, kw_only=True)
class CanWire:
    """A CAN bus; ``data_bitrate`` makes it CAN-FD with bit rate switching."""

    bitrate: int = 1_000_000
    data_bitrate: int | None = None

    kind: ClassVar[str] = "can"


@dataclass(frozen=True, kw_only=True)
class TcpWire:
    """A TCP server that speaks a framing of its own (Modbus TCP ...), not a raw serial stream."""

    port: int

    kind: ClassVar[str] = "tcp"


Wire = SerialWire | CanWire | TcpWire


@dataclass(frozen=True, kw_only=True)
class Patch:
    """A run of taxels that forms a picture: ``rows * cols`` taxels from index ``start``, row-major.

    ``rows = 0`` marks a free layout of ``cols`` taxels that is drawn by position.
    """

    name: str
    start: int
    rows: int
    cols: int

    @property
    def taxels(self) -> slice:
        """Indices of this patch in every ``(n_taxels, ...)`` array."""
        return slice(self.start, self.start + max(self.rows, 1) * self.cols)


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Where the taxels are. All arrays in the skin's link frame.

    Raises:
        ValueError: shapes disagree, a normal is not a unit vector, or ``wire_order`` is not a permutation.
    """

    positions: np.ndarray
    """Taxel centres [m], shape ``(n_taxels, 3)``."""
    normals: np.ndarray
    """Unit normals out of the skin, shape ``(n_taxels, 3)``."""
    x_axes: np.ndarray = field(default=None)  # type: ignore[assignment]
    """Unit x axes of the taxels' own frames (z is the normal), shape ``(n_taxels, 3)``; default: link x projected."""
    wire_order: np.ndarray = field(default=None)  # type: ignore[assignment]
    """``wire_order[k]`` is the taxel sent at place k, shape ``(n_taxels,)``; default: as listed."""
    patches: tuple[Patch, ...] = ()
    pitch: float = 0.002
    """Distance of neighbours [m]: sets default probe radii and drawing."""
    area: float = 0.0
    """Area that one taxel stands for [m²]; default ``pitch**2``."""

    def __post_init__(self):
        positions = np.atleast_2d(np.asarray(self.positions, float)).reshape(-1, 3)
        n = len(positions)
        normals = np.broadcast_to(np.asarray(self.normals, float), (n, 3))
        if n and not np.allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-6):
            raise ValueError("Layout.normals: every normal must have length 1")
        order = np.arange(n) if self.wire_order is None else np.asarray(self.wire_order, int)
        if sorted(order.tolist()) != list(range(n)):
            raise ValueError(f"Layout.wire_order: expected a permutation of 0..{n - 1}, got {order}")
        x_axes = _default_x_axes(normals) if self.x_axes is None else np.asarray(self.x_axes, float)
        store = object.__setattr__
        store(self, "positions", positions)
        store(self, "normals", normals)
        store(self, "x_axes", np.broadcast_to(x_axes, (n, 3)))
        store(self, "wire_order", order)
        store(self, "area", self.area or self.pitch**2)
        if not self.patches:
            store(self, "patches", (Patch(name="all", start=0, rows=0, cols=n),))

    def __len__(self) -> int:
        return len(self.positions)

    def to_taxel_frame(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors of the link frame, shape ``(n_taxels, 3)``, in each taxel's own frame (x, y, z = normal)."""
        y_axes = np.cross(self.normals, self.x_axes)
        return np.stack([(vectors * axis).sum(-1) for axis in (self.x_axes, y_axes, self.normals)], axis=-1)

    def push(self, forces: np.ndarray) -> np.ndarray:
        """How hard each taxel is pushed into the skin [N], shape ``(n_taxels,)``; ``forces`` as in :class:`Reading`."""
        return -(np.asarray(forces) * self.normals).sum(-1)


def _default_x_axes(normals: np.ndarray) -> np.ndarray:
    """Link x projected on each tangent plane; link y where the normal is (nearly) along x."""
    seed = np.where(np.abs(normals[:, :1]) > 0.9, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
    tangent = seed - normals * (seed * normals).sum(-1, keepdims=True)
    return tangent / np.linalg.norm(tangent, axis=-1, keepdims=True)


def grid_layout(rows: int, cols: int, pitch: float, *, name: str = "pad", origin=(0.0, 0.0, 0.0)) -> Layout:
    """A flat grid centred on ``origin`` [m], normal +z; row 0 at the largest y, column 0 at the smallest x."""
    x = (np.arange(cols) - (cols - 1) / 2) * pitch
    y = ((rows - 1) / 2 - np.arange(rows)) * pitch
    xx, yy = np.meshgrid(x, y)
    positions = np.stack([xx, yy, np.zeros_like(xx)], -1).reshape(-1, 3) + np.asarray(origin, float)
    patch = Patch(name=name, start=0, rows=rows, cols=cols)
    return Layout(positions=positions, normals=np.array([0.0, 0.0, 1.0]), pitch=pitch, patches=(patch,))


@dataclass(frozen=True, kw_only=True)
class Reading:
    """What the transducers of one device see at one instant, in SI units, taxels in layout order."""

    t_ns: int
    values: np.ndarray
    """Shape and unit by the device's ``senses`` (see :data:`Quantity`); vectors in the link frame."""
    temperature: float | np.ndarray = 25.0
    """[°C], one number or shape ``(n_taxels,)``."""
    acceleration: tuple[float, float, float] = (0.0, 0.0, 9.80665)
    """Proper acceleration of the link [m/s²], link frame (at rest: up)."""
    angular_velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Of the link [rad/s], link frame."""


@dataclass(frozen=True, kw_only=True)
class Command:
    """One documented command: what a driver sends and what the firmware answers. The contract test sends each.

    ``reply`` is the exact answer, ``None`` for documented silence, or a predicate over the answer's frames where the
    answer holds a reading.
    """

    name: str
    request: Frame
    reply: Sequence[Frame] | Callable[[list[Frame]], bool] | None
    about: str = ""
    after: Sequence[Frame] = ()
    """Requests to send first (select a port, unlock ...)."""


class Device(ABC):
    """A model of one sensor's firmware. One file, one family; the file's docstring is its datasheet.

    Subclasses set the class attributes, build ``self.layout`` in ``__init__`` (keyword-only options with defaults),
    and write :meth:`digitize`, :meth:`stream` and, if the sensor takes commands, :meth:`receive`.
    """

    name: ClassVar[str]
    """Registry name, lower case with underscores."""
    title: ClassVar[str]
    """Vendor and model as people call it."""
    wires: ClassVar[tuple[Wire, ...]]
    """The wires it can be plugged into, the usual one first."""
    senses: ClassVar[Quantity] = "force"
    rate_hz: ClassVar[float] = 100.0
    """Sampling rate unless a command or ``tactemu run --rate`` says otherwise."""
    boot_s: ClassVar[float] = 0.0
    """After power-up or a reset: how long it neither samples nor hears [s]."""
    evidence: ClassVar[tuple[Evidence, ...]]
    sources: ClassVar[tuple[str, ...]]
    """Where each table comes from: repository@commit file, manual page, capture."""
    judge: ClassVar[str] = "none"
    """The unmodified driver (package and version) that has read this device."""
    assumed: ClassVar[tuple[str, ...]] = ()
    """What no source states and we chose."""
    scene: ClassVar[str] = ""
    """Default scene in the scene file's TOML (``docs/scene-files.md``), for a class outside the tree; it is not
    inherited. Empty: one is made from the layout, a ball that presses the middle of each patch."""

    layout: Layout

    def __init__(self):
        self.wire: Wire = self.wires[0]
        self.counts: np.ndarray = np.zeros(0)
        """Latest output of :meth:`digitize`."""
        self.counters: Counter[str] = Counter()
        """What became of the driver's bytes: ``requests``, ``bad_checksum``, ``unknown_command`` ..."""
        self._period_ns = round(1e9 / self.rate_hz)

    # -- what the runner asks -------------------------------------------------------------------------------------

    @property
    def period_ns(self) -> int:
        """Time between samples [ns]; a command may change it."""
        return self._period_ns

    @period_ns.setter
    def period_ns(self, value: int) -> None:
        if value <= 0:
            raise ValueError(f"{self.name}: sampling period must be > 0 ns, got {value}")
        self._period_ns = int(value)

    @property
    def commands(self) -> tuple[Command, ...]:
        """Every documented command, for `tactemu devices NAME` and for the contract test."""
        return ()

    def plug(self, kind: str) -> Wire:
        """Choose the wire of this kind (``serial``, ``can``, ``tcp``).

        Raises:
            ValueError: the sensor has no such connector.
        """
        for wire in self.wires:
            if wire.kind == kind:
                self.wire = wire
                return wire
        has = ", ".join(w.kind for w in self.wires)
        raise ValueError(f"{self.name} cannot be reached over {kind}; it has: {has}")

    def power_on(self, t_ns: int) -> Sequence[Outgoing]:
        """Back to the state after power-up; returns the boot banner, if there is one."""
        return ()

    def opened(self, t_ns: int) -> Sequence[Outgoing]:
        """The driver opened the port (DTR rose, a client connected)."""
        return ()

    def closed(self, t_ns: int) -> None:
        """The driver closed the port."""

    def sample(self, reading: Reading, t_ns: int) -> Sequence[Outgoing]:
        """Convert one reading and return what the sensor sends unasked."""
        self.counts = self.digitize(reading)
        return self.stream(t_ns)

    # -- what a device writes --------------------------------------------------------------------------------------

    @abstractmethod
    def digitize(self, reading: Reading) -> np.ndarray:
        """The ADC: SI values to what a perfect driver would decode, saturation included; taxels in layout order.

        Shape ``(n_taxels,)`` or ``(n_taxels, n_channels)``. The truth log keeps this array beside every frame.
        """

    def stream(self, t_ns: int) -> Sequence[Outgoing]:
        """Frames that leave at every sample; empty for a sensor that only answers."""
        return ()

    def receive(self, data: Any, t_ns: int) -> Sequence[Outgoing]:
        """Bytes in chunks of any size, or one CAN frame, from the driver; returns the firmware's answers.

        Never raises on bad input: it is counted in ``self.counters`` and answered as the firmware would, or not at all.
        """
        self.counters["ignored"] += 1
        return ()
