"""Captures of every serial and CAN device from its own model, with the truth beside them, to judge `tactemu infer`.

The device runs on the check host's clock. Its skin is pressed slowly on every taxel, with shear and noise; temperature,
acceleration and turns move. A device that is asked gets the requests of its client recording, at their times, and then
those of its longest session again and again. The truth of each frame is the frame table that packed it: ``Frame.pack``
is replaced for the length of a capture. :mod:`benchmarks.infer_truths` states the bytes that no table writes.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from firmware_protocols import Frame, registry
from firmware_protocols.check.host import Host, Subject
from tactemu.transports.transport import LinesChanged, Opened, Received
from tests.clients.recording import Recording, recordings

FOLDER = Path("/tmp/infer-corpus")
MAX_FRAMES = 15_000
"""The largest number of frames in a capture; one that is longer ends early."""
BOOT_NS = 3_000_000_000
PACKS_KEPT = 300
NOT_A_WIRE = {
    "ati_net_ft": "UDP",
    "ati_wireless_ft": "UDP",
    "onrobot_hex": "UDP",
    "unitree_dex3": "DDS",
    "xela_server": "WebSocket",
}
"""Devices whose transport gives each message its borders and its meaning."""
NO_TAXELS = {"feetech_sts3215": "a motor"}

Span = tuple[int, int, str, str, str]
"""Offset, size, kind (const, sum, length, field, opaque), type code and name of some bytes of a frame."""


@dataclass
class Sent:
    """One message of a capture."""

    t_ns: int
    direction: str
    """``tx`` from the device, ``rx`` to it."""
    id: int | None
    data: bytes
    layout: int = -1


@dataclass
class Truth:
    """A capture and what its bytes are."""

    name: str
    is_can: bool
    log: list[Sent] = field(default_factory=list)
    layouts: list[tuple[Span, ...]] = field(default_factory=list)
    recording: str = ""


class Packs:
    """The frames that tables have packed most recently, and from them the layout of a message."""

    def __init__(self) -> None:
        self.recent: list[tuple[Frame, bytes]] = []
        self.layouts: dict[tuple[Span, ...], int] = {}

    @contextmanager
    def noted(self) -> Iterator[None]:
        """Note what every table packs within this context."""
        pack, pack_many = Frame.pack, Frame.pack_many

        def noting_pack(table: Frame, **values: Any) -> bytes:
            data = pack(table, **values)
            self.recent.append((table, data))
            return data

        def noting_pack_many(table: Frame, n: int, **values: Any) -> list[bytes]:
            frames = pack_many(table, n, **values)
            self.recent.extend((table, data) for data in frames)
            return frames

        Frame.pack, Frame.pack_many = noting_pack, noting_pack_many  # type: ignore[method-assign]
        try:
            yield
        finally:
            Frame.pack, Frame.pack_many = pack, pack_many  # type: ignore[method-assign]

    def layout_of(self, data: bytes) -> int:
        """Return the number of the layout of a message that was just sent."""
        del self.recent[:-PACKS_KEPT]
        layout = tuple(_inside(data, 0, self.recent, 0, "?"))
        return self.layouts.setdefault(layout, len(self.layouts))


def _placed(table: Frame, data: bytes, at: int, packs: list, depth: int) -> list[Span]:
    out: list[Span] = []
    left = len(data) - sum(each.size or 0 for each in table.fields if not each.is_open)
    position = 0
    for each in table.fields:
        size = left if each.is_open else each.size or 0
        place = at + position
        if each.kind == "const":
            out.append((place, size, "const", "", each.name))
        elif each.kind == "sum":
            out.append((place, size, "sum", each.text, each.name))
        elif each.kind == "number":
            width, kind = each.dtype.itemsize, "length" if each.formula else "field"
            code = each.dtype.str.lstrip("|") if width > 1 else each.dtype.str[1:]
            out += [(place + k, width, kind, code, each.name) for k in range(0, size, width)]
        else:
            out += _inside(data[position : position + size], place, packs, depth + 1, each.name)
        position += size
    return out


def _inside(data: bytes, at: int, packs: list, depth: int, name: str) -> list[Span]:
    if depth < 4 and len(data) > 1:
        fitting = [pack for pack in packs if 1 < len(pack[1]) <= len(data) and pack[1] in data and any(pack[1])]
        best = max(fitting, key=lambda pack: len(pack[1]), default=None)
        if best is not None and 2 * len(best[1]) >= min(len(data), 8):
            start, rest = data.index(best[1]), [pack for pack in packs if pack is not best]
            end = start + len(best[1])
            return [
                *(_inside(data[:start], at, rest, depth + 1, name) if start else []),
                *_placed(best[0], best[1], at + start, rest, depth + 1),
                *(_inside(data[end:], at + end, rest, depth + 1, name) if end < len(data) else []),
            ]
    return [(at, len(data), "opaque", "", name)] if data else []


@dataclass
class Skin:
    """Slow presses on every taxel, one group after another, with shear and noise."""

    n: int
    normals: np.ndarray
    seconds: float
    seed: int = 1
    peak_n: float = 5.0
    noise_n: float = 0.02
    press_s: float = 1.0
    rest_s: float = 1.0
    """Time without a touch at the beginning."""

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)
        self.presses = max(2, round((self.seconds - self.rest_s) / (self.press_s * 0.5)))
        self.peaks = self.peak_n * self.rng.uniform(0.2, 1.0, self.presses)
        self.reach = max(0.7, 1.5 * self.n / self.presses)

    def forces(self, t: float) -> np.ndarray:
        """Return the force on each taxel [N], shape (n, 3)."""
        taxels, push = np.arange(self.n), np.zeros(self.n)
        since = t - self.rest_s
        for k in range(max(0, int(since / self.press_s / 0.5) - 2), int(max(since, 0) / self.press_s / 0.5) + 1):
            phase = (since - k * 0.5 * self.press_s) / self.press_s
            if 0 <= phase < 1 and since >= 0:
                centre = self.n * ((k + 0.5) * 2 / self.presses % 1.0)
                near = np.exp(-(((taxels - centre) / self.reach) ** 2))
                push += self.peaks[k % self.presses] * np.sin(np.pi * phase) ** 2 * near
        if since > 0:
            push += 0.05 * self.peak_n * (1 - np.cos(2 * np.pi * 0.2 * since + 0 * taxels))
        push = np.maximum(push + self.noise_n * self.rng.standard_normal(self.n), 0)
        shear = [np.sin(1.3 * t + taxels), np.cos(0.9 * t + taxels), np.zeros(self.n)]
        forces = -push[:, None] * self.normals + 0.3 * push[:, None] * np.stack(shear, axis=-1)
        return forces + self.noise_n * self.rng.standard_normal((self.n, 3))


def _others(device: Any, stream: str, t: float, rng: np.random.Generator) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for sense in device.senses_of(stream):
        if sense.quantity == "temperature":
            values[sense.key] = 25 + 3 * np.sin(0.5 * t) + 0.02 * rng.standard_normal()
        elif sense.quantity == "acceleration":
            moved = np.array([0.5 * np.sin(4 * t), 0.7 * np.cos(3 * t), 9.8])
            values[sense.key] = moved + 0.05 * rng.standard_normal(3)
        elif sense.quantity == "angular_velocity":
            turned = np.array([0.5 * np.sin(4 * t), 0.7 * np.cos(3 * t), 0.2 * np.sin(t)])
            values[sense.key] = turned + 0.01 * rng.standard_normal(3)
    return values


class Run:
    """A device that is asked and pressed in virtual time."""

    def __init__(self, name: str, seconds: float, skin: dict[str, Any]):
        best = _asking_recording(name)
        self.truth, self.packs = Truth(name, False, recording=best[1] if best else ""), Packs()
        recording = best[0] if best else None
        self.options = dict((recording.about.get("options") if recording else None) or {})
        self.device = Subject(name, registry.device_class(name), self.options).build()
        self.port = _port_of(recording, self.device)
        self.truth.is_can = type(self.device.connector(self.port)).__name__ == "Can"
        self.events = _without_stop(recording) if recording else []
        self.seconds = seconds
        normals = np.broadcast_to(self.device.layout.normals, (len(self.device.layout), 3))
        self.skin = Skin(len(self.device.layout), normals, seconds, **skin)

    def go(self) -> Truth:
        """Run, and return the capture."""
        with self.packs.noted():
            self.host = Host(self.device)
            self._note(self.host.modem(True, True, self.port))
            self._wait(BOOT_NS)
            self.start_ns = self.host.t_ns
            end_ns = self.start_ns + round(1e9 * self.seconds)
            for due_ns, event in self._timetable(end_ns):
                self._until(due_ns)
                self._deliver(event)
                if len(self.truth.log) > MAX_FRAMES:
                    break
            else:
                self._until(end_ns)
        self.truth.layouts = list(self.packs.layouts)
        return self.truth

    def _timetable(self, end_ns: int) -> Iterator[tuple[int, Any]]:
        begin = self.events[0][0] if self.events else 0
        last = self.start_ns
        for t, event in self.events:
            last = self.start_ns + t - begin
            if last > end_ns:
                return
            yield last, event
        again = _steady(self.events)
        if len(again) < 10:
            return
        length = again[-1][0] - again[0][0] + 20_000_000
        while last < end_ns:
            for t, event in again:
                yield last + 20_000_000 + t - again[0][0], event
            last += length

    def _deliver(self, event: Any) -> None:
        if isinstance(event, Received):
            self._note([event.data], "rx")
            self._note(self.host.send(event.data, self.port))
        elif isinstance(event, Opened):
            self._note(self.host.modem(True, True, self.port))
        elif isinstance(event, LinesChanged):
            self._note(self.host.modem(event.dtr, event.rts, self.port))

    def _until(self, end_ns: int) -> None:
        """Convert each stream when it is due, and let the device wake."""
        while self.host.t_ns < end_ns and len(self.truth.log) <= MAX_FRAMES:
            periods = {name: period for name, period in self.device.periods.items() if period}
            now = self.host.t_ns - self.start_ns
            due = {name: self.start_ns + (now // period + 1) * period for name, period in periods.items()}
            next_ns = min([*due.values(), end_ns])
            self._wait(next_ns - self.host.t_ns)
            for name in [name for name, t in due.items() if t == next_ns]:
                self.host.measure(name, **self._values(name))
                self._note(self.host.streamed(name))

    def _values(self, stream: str) -> dict[str, Any]:
        t = (self.host.t_ns - self.start_ns) / 1e9
        self.host.pushes = self.skin.forces(t)
        return _others(self.device, stream, t, self.skin.rng)

    def _wait(self, span_ns: int) -> None:
        self._note(self.host.wait(max(span_ns, 0)))

    def _note(self, frames: list[Any], direction: str = "tx") -> None:
        for frame in frames:
            data = bytes(frame.data) if self.truth.is_can else frame
            if not isinstance(data, bytes):
                continue
            layout = self.packs.layout_of(data) if direction == "tx" else -1
            identifier = frame.arbitration_id if self.truth.is_can else None
            self.truth.log.append(Sent(self.host.t_ns, direction, identifier, data, layout))


def _asking_recording(name: str) -> tuple[Recording, str] | None:
    """Return the device's client recording with the most requests, on its one wire."""
    found = []
    for path in recordings():
        if path.stem.startswith(name + "-"):
            recording = Recording.load(path)
            asked = sum(isinstance(event, Received) for _, _, event in recording.events)
            is_wire = not any(wire.endswith(("/tcp", "/http", "/rdt")) for _, wire, _ in recording.sent)
            found.append((is_wire, asked, path.stem, recording))
    best = max(found, default=None, key=lambda each: each[:2])
    return None if best is None else (best[3], best[2])


def _steady(events: list[tuple[int, Any]]) -> list[tuple[int, Any]]:
    """Return the requests of the second half of the longest time that the port was open."""
    stretches: list[list[tuple[int, Any]]] = [[]]
    for t, event in events:
        if isinstance(event, Received):
            stretches[-1].append((t, event))
        elif isinstance(event, Opened):
            stretches.append([])
    longest = max(stretches, key=len)
    if len(longest) < 10:  # a driver that opens the port for each request
        longest = [each for stretch in stretches for each in stretch]
    return longest[len(longest) // 2 :]


def _without_stop(recording: Recording) -> list[tuple[int, Any]]:
    """Return the events of a recording; of one that streams without those at its end, which stop it."""
    events = [(t, event) for t, _, event in recording.events]
    asked = sum(isinstance(event, Received) for _, event in events)
    if not recording.sent or len(recording.sent) < 3 * asked:
        return events
    first, last = recording.sent[0][0], recording.sent[-1][0]
    return [(t, event) for t, event in events if t < last - 0.15 * (last - first)]


def _port_of(recording: Recording | None, device: Any) -> str:
    wires = {wire for _, wire, _ in recording.sent} if recording else set()
    named = [wire.partition("/")[2] for wire in wires if "/" in wire]
    return named[0] if named else device.ports[0].name


def make(name: str, folder: Path = FOLDER, *, seconds: float = 20.0, **skin: Any) -> Truth:
    """Return the capture of a device, kept in ``folder``."""
    path = folder / f"{name}.pkl"
    if path.exists():
        return pickle.loads(path.read_bytes())
    folder.mkdir(parents=True, exist_ok=True)
    truth = Run(name, seconds, skin).go()
    path.write_bytes(pickle.dumps(truth))
    return truth


def wire_devices() -> list[str]:
    """Return the devices that infer is judged by."""
    return [name for name in registry.DEVICES if name not in NOT_A_WIRE and name not in NO_TAXELS]


def make_all(say: Callable[[str], None], folder: Path = FOLDER, **options: Any) -> None:
    """Make what is missing of the corpus."""
    for name in wire_devices():
        truth = make(name, folder, **options)
        sent = [each for each in truth.log if each.direction == "tx"]
        say(f"{name}: {len(sent)} frames, {len(truth.log) - len(sent)} requests, {len(truth.layouts)} layouts")
