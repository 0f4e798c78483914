"""Proxy between a real sensor and its driver: it passes bytes, injects faults, and writes truth and a recording.

The driver's side is a normal wire (:class:`~tactemu.wire.wire.Wire`) without pacing, which the real line provides.
Data from the sensor are cut into frames if the device's model sends frames of one length with a constant head, and
decoded if it has a table of them; otherwise they pass unchanged, and the proxy reports them as undecoded.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from firmware_protocols import Can, Connector, Device, Sent, Serial, WireFrame, calls
from firmware_protocols.check.readings import reading_of
from firmware_protocols.declared import frames_of
from firmware_protocols.tables import Frame as FrameTable
from tactemu import transports
from tactemu.base.clock import RealClock
from tactemu.base.errors import TransportError, reason_of
from tactemu.base.loop import Loop
from tactemu.emulator.replay import DEFAULT_BAUD
from tactemu.transports.transport import LinesChanged, Received, SettingChanged, Transport
from tactemu.truth import Passage, Truth
from tactemu.truth.recorder import Recorder
from tactemu.wire.wire import ReceivedData, Wire

MAX_READ_BYTES = 4096
"""Maximum number of bytes in one read of the real port."""
SETTINGS_NS = 20_000_000
"""Time after which the driver's settings are read again: a pseudo terminal does not tell that they were changed."""
MAX_PARTIAL_WAIT_NS = 20_000_000
"""Maximum time for which an incomplete frame waits for its end while faults are on; then it passes as it is."""
_PROBE_FORCES_N = (0.0, 0.3, 1.0, 2.5)
"""Forces on a model by which the constant head of its frames is found [N]."""


# -- the device's tables -----------------------------------------------------------------------------------------------


@dataclass
class Framing:
    """The framing of a device's stream: the head and the size of its frames, and the table that decodes them."""

    head: bytes = b""
    size: int = 0
    """Size of a frame [byte]; 0: frames cannot be recognised."""
    table: FrameTable | None = None

    @property
    def about(self) -> str:
        """The framing as text."""
        if not self.size:
            return "undecoded: this device has no frames of one length and head; bytes pass as they come"
        cut = f"frames of {self.size} bytes that begin with {self.head.hex()}"
        return f"{cut}, {'decoded' if self.table else 'undecoded: no table of one frame'}"

    def counts(self, frame: bytes) -> np.ndarray | None:
        """Return the numbers of the longest field of a frame, or None for a wrong checksum or without a table."""
        values = self.table.unpack(frame) if self.table is not None else None
        if values is None:
            return None
        arrays = [np.asarray(value) for value in values.values() if not isinstance(value, bytes | str)]
        return max(arrays, key=lambda array: array.size).ravel() if arrays else None


def framing_of(device: Device) -> Framing:
    """Return the framing of a device, from the frames that its model streams under several forces."""
    frames = []
    for k, push in enumerate(_PROBE_FORCES_N):
        for stream in device.periods:
            calls.measure(device, reading_of(device, push, stream), 10_000_000 * (k + 1))
            for out in device.stream(10_000_000 * (k + 1), stream):
                frame = out.frame if isinstance(out, Sent) else out
                if isinstance(frame, bytes):
                    frames.append(frame)
    if len(frames) < 2 or len({len(frame) for frame in frames}) != 1:
        return Framing()
    same = next((k for k, column in enumerate(zip(*frames)) if len(set(column)) > 1), 0)
    if same < 2:
        return Framing()
    table = next((each for each in frames_of(device) if _decodes(each, frames)), None)
    return Framing(frames[0][: min(same, 4)], len(frames[0]), table)


def _decodes(table: FrameTable, frames: Sequence[bytes]) -> bool:
    try:
        return all(table.unpack(frame) is not None for frame in frames)
    except (ValueError, TypeError, KeyError):  # not bound to a size
        return False


class Cutter:
    """A cutter of a stream into frames and the bytes between them."""

    def __init__(self, framing: Framing):
        self.framing = framing
        self.partial = b""

    def cut(self, data: bytes) -> list[bytes]:
        """Return complete frames and the bytes between them, in order; an incomplete one stays in :attr:`partial`."""
        head, size = self.framing.head, self.framing.size
        if not size:
            return [data] if data else []
        data, found = self.partial + data, []
        while data:
            at = data.find(head)
            if at < 0:
                keep = next((n for n in range(min(len(head) - 1, len(data)), 0, -1) if head.startswith(data[-n:])), 0)
                if len(data) > keep:
                    found.append(data[: len(data) - keep])
                data = data[len(data) - keep :]
                break
            if at:
                found.append(data[:at])
                data = data[at:]
            if len(data) < size:
                break
            found.append(data[:size])
            data = data[size:]
        self.partial = data
        return found

    def flush_partial(self) -> list[bytes]:
        """Return the incomplete frame, if there is one, and clear it."""
        partial, self.partial = self.partial, b""
        return [partial] if partial else []


# -- the real port -----------------------------------------------------------------------------------------------------


class RealPort(Protocol):
    """The interface of the sensor's port."""

    def filenos(self) -> list[int]: ...  # noqa: D102

    def read(self) -> list[WireFrame]: ...  # noqa: D102

    def write(self, data: WireFrame) -> None: ...  # noqa: D102

    def follow(self, event: SettingChanged | LinesChanged) -> None: ...  # noqa: D102

    def close(self) -> None: ...  # noqa: D102


class RealSerial:
    """A serial port or URL of pyserial."""

    def __init__(self, name: str, baud: int):
        import serial

        try:
            self.port = serial.serial_for_url(name, baudrate=baud, timeout=0, write_timeout=0.2)
        except (OSError, ValueError) as error:
            raise TransportError(
                f"cannot open {name}: {reason_of(error)}; check the name and your permission to read it"
            ) from None
        self.name = name

    def filenos(self) -> list[int]:
        """Return the file descriptor for ``select``, if there is one."""
        try:
            return [self.port.fileno()]
        except (OSError, AttributeError):
            return []

    def read(self) -> list[WireFrame]:
        """Return the data that have arrived."""
        try:
            data = self.port.read(MAX_READ_BYTES)
        except OSError as error:
            raise TransportError(f"lost the sensor's port {self.name}: {error}") from None
        return [data] if data else []

    def write(self, data: WireFrame) -> None:
        """Send data of the driver to the sensor."""
        assert isinstance(data, bytes)
        try:
            self.port.write(data)
        except OSError as error:
            raise TransportError(f"lost the sensor's port {self.name}: {error}") from None

    def follow(self, event: SettingChanged | LinesChanged) -> None:
        """Set the driver's settings and modem lines on the port, except those that it does not support."""
        with contextlib.suppress(OSError, ValueError):
            if isinstance(event, LinesChanged):
                self.port.dtr, self.port.rts = event.dtr, event.rts
                return
            for name, value in (
                ("baudrate", event.setting.baud), ("bytesize", event.setting.bytesize),
                ("parity", event.setting.parity), ("stopbits", event.setting.stopbits),
            ):  # fmt: skip
                if value is not None:
                    setattr(self.port, name, value)

    def close(self) -> None:
        """Close the port."""
        self.port.close()


class RealBus:
    """A CAN bus, ``can:INTERFACE:CHANNEL``."""

    def __init__(self, name: str):
        self.port: Transport = transports.create(name)
        self.port.open()

    def filenos(self) -> list[int]:
        """Return the file descriptors for ``select``, if there are any."""
        return self.port.filenos()

    def read(self) -> list[WireFrame]:
        """Return the data that have arrived."""
        return [event.data for event in self.port.poll() if isinstance(event, Received)]

    def write(self, data: WireFrame) -> None:
        """Send data of the driver to the sensor."""
        self.port.write(data)

    def follow(self, event: SettingChanged | LinesChanged) -> None:
        """Do nothing: a bus has no such settings."""

    def close(self) -> None:
        """Close the port."""
        self.port.close()


# -- the proxy ---------------------------------------------------------------------------------------------------------


@dataclass
class Proxy(Loop):
    """A loop that passes data between a sensor and its driver.

    Args:
        device: the model whose tables cut and decode frames; ``None``: nothing is decoded.
        real: the sensor's port.
        port: the driver's port, as for ``tactemu run --port``.
        faults: to inject between them.
    """

    device: Device | None
    real: RealPort
    port: str
    faults: Iterable[str] = ()
    seed: int = 0
    truth: Truth = field(default_factory=Truth)
    recorder: Recorder | None = None
    name: str = "sensor"

    def __post_init__(self):
        is_can = isinstance(self.real, RealBus)
        self.framing = Framing() if self.device is None or is_can else framing_of(self.device)
        connector: Connector = Can() if is_can else Serial(baud=DEFAULT_BAUD, usb=True)  # the real line has the speed
        self.wire = Wire(
            transports.create(self.port), connector, pacing=False, faults=self.faults, seed=self.seed, truth=self.truth
        )
        self.wire.name = self.name
        self.cutter = Cutter(self.framing)
        self._holds_back = bool(self.wire.faults)
        """True if incomplete frames wait for their ends, because a fault needs complete ones."""
        super().__init__(RealClock(), [self.wire, self.real])
        self.samples = 0
        self.passed = {"to driver": 0, "from driver": 0}
        """Number of bytes, or of frames on a bus, by direction."""
        self._began_ns = 0

    def run(self, seconds: float | None = None, opened: Callable[[str], object] = lambda address: None) -> None:
        """Pass data until :meth:`stop` or for some seconds; call ``opened`` with the address of the driver's port.

        Raises:
            TransportError: the driver's port cannot be created, or the sensor's port is lost.
        """
        self.wire.open()
        self._calls.open()
        try:
            self.clock.start()
            self.truth.begin(self.clock.origin_ns)
            if self.recorder is not None:
                self.recorder.start(self.clock.origin_ns)
            opened(self.wire.transport.address)
            super().run(seconds)
        finally:
            self._calls.close()
            self.wire.close()
            self.truth.close()

    def step(self, end_ns: int | None = None) -> None:
        """Pass on the data that have arrived on both sides, then wait for more, or until data that a fault holds back
        are due."""
        now = self.now_ns = self.clock.now_ns()
        for event in self.wire.receive(now):
            if isinstance(event, ReceivedData):
                self.passed["from driver"] += _size(event.data)
                self.real.write(event.data)
                self._record(now, event.data, "rx")
            elif isinstance(event, SettingChanged | LinesChanged):
                self.real.follow(event)
        for data in self.real.read():
            self._pass(data, now)
        if self._holds_back and self.cutter.partial and now - self._began_ns >= MAX_PARTIAL_WAIT_NS:
            self._send(self.cutter.flush_partial(), now)
        self.wire.flush(self.clock.now_ns())
        self._calls.run(now)
        partial_ns = self._began_ns + MAX_PARTIAL_WAIT_NS if self._holds_back and self.cutter.partial else None
        settings_ns = None if isinstance(self.real, RealBus) else now + SETTINGS_NS
        self._wait([self.wire.next_due_ns(), partial_ns, settings_ns, end_ns])

    def _pass(self, data: WireFrame, now: int) -> None:
        self.passed["to driver"] += _size(data)
        self._record(now, data, "tx")
        if not isinstance(data, bytes):
            self._send([data], now)
            return
        self._began_ns = now
        pieces = self.cutter.cut(data)
        if not self._holds_back:
            self._decode(pieces, now)
            self.wire.send([data], now, self.name)
            return
        numbers = self._decode(pieces, now)
        for piece, number in zip(pieces, numbers):
            self._send([piece], now, number)

    def _decode(self, pieces: Sequence[bytes], now: int) -> list[int | None]:
        numbers: list[int | None] = []
        for piece in pieces:
            counts = self.framing.counts(piece) if len(piece) == self.framing.size else None
            if counts is None:
                numbers.append(None)
                continue
            numbers.append(self.truth.sample(now, self.name, counts, counts, counts, number=self.samples))
            self.samples += 1
        return numbers

    def _send(self, frames: Sequence[Any], now: int, sample: int | None = None) -> None:
        if frames:
            self.wire.send(frames, now, self.name, sample=sample)

    def _record(self, now: int, data: WireFrame, kind: Any) -> None:
        if self.recorder is not None:
            self.recorder.add(Passage(now, "", kind, data))


def _size(data: WireFrame) -> int:
    return len(data) if isinstance(data, bytes) else 1
