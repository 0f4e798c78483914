"""A client recording: what an unmodified driver sent and when, what came back, and what the driver decoded.

``tests/data/clients/DEVICE-DRIVER.mcap`` holds data alone, nothing of the driver's code: every event of the port in
the order of the loop's turns, every frame that the device sent, and every reading that the driver reported, with the
number of the sample that it equals. :mod:`tests.clients.replay` does the run again in virtual time and compares both.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tactemu.base.frame_text import parse, text
from tactemu.transports.transport import (
    Closed,
    Event,
    LinesChanged,
    Noted,
    Opened,
    Received,
    SerialSetting,
    SettingChanged,
)

FOLDER = Path(__file__).parents[1] / "data" / "clients"
MAX_BYTES = 200_000
"""Size of a recording; a longer one belongs to a shorter run."""
_DTYPES = ("<u1", "<i1", "<u2", "<i2", "<i4", "<f4", "<f8")


@dataclass(frozen=True)
class Row:
    """One reading that the driver reported, in its own units."""

    name: str
    sample: int
    """Number of the sample that it equals."""
    values: np.ndarray


@dataclass
class Recording:
    """One run of one driver, from open to close."""

    about: dict[str, Any]
    """Driver, commit, licence, calls, device, options, scene, seed, maps, counters, what the driver said."""
    events: list[tuple[int, str, Event]] = field(default_factory=list)
    """``(t_ns, wire, event)`` of each port, by the turn of the loop that met it."""
    sent: list[tuple[int, str, str]] = field(default_factory=list)
    """``(t_ns, wire, frame as text)`` of each frame that went to the driver."""
    rows: list[Row] = field(default_factory=list)

    def save(self, path: Path) -> None:
        """Write the recording.

        Raises:
            ValueError: it is larger than :data:`MAX_BYTES`.
        """
        from mcap.writer import CompressionType, Writer

        with path.open("wb") as file:
            writer = Writer(file, chunk_size=1 << 20, compression=CompressionType.LZ4)
            writer.start(library="tactemu client recording")
            writer.add_metadata("about", {"json": json.dumps(self.about)})
            channels: dict[tuple[str, str], int] = {}

            def add(topic: str, t_ns: int, data: bytes, encoding: str) -> None:
                key = topic, encoding
                if key not in channels:
                    channels[key] = writer.register_channel(topic, encoding, 0)
                writer.add_message(channels[key], t_ns, data, t_ns)

            for t_ns, wire, event in self.events:
                add(f"driver/{wire}", t_ns, _packed(event), "event")
            for t_ns, wire, frame in self.sent:
                is_can = "#" in frame
                add(
                    f"device/{wire}",
                    t_ns,
                    frame.encode() if is_can else bytes.fromhex(frame),
                    "can" if is_can else "bytes",
                )
            for row in self.rows:
                values = _smallest(row.values)
                add(f"decoded/{row.name}", row.sample, values.tobytes(), values.dtype.str)
            writer.finish()
        if path.stat().st_size > MAX_BYTES:
            size = path.stat().st_size
            path.unlink()
            raise ValueError(f"{path.name}: {size} bytes, at most {MAX_BYTES}: let the driver read fewer samples")

    @classmethod
    def load(cls, path: Path) -> Recording:
        """Read a recording."""
        from mcap.reader import make_reader

        with path.open("rb") as file:
            reader = make_reader(file)
            about = next(json.loads(each.metadata["json"]) for each in reader.iter_metadata() if each.name == "about")
            found = cls(about)
            for _, channel, message in reader.iter_messages(log_time_order=False):
                kind, _, name = channel.topic.partition("/")
                data, encoding = message.data, channel.message_encoding
                if kind == "driver":
                    found.events.append((message.log_time, name, _event(data)))
                elif kind == "device":
                    frame = (
                        text(parse(data.decode())) if encoding == "can" else data.hex()
                    )  # flags as they are told now
                    found.sent.append((message.log_time, name, frame))
                else:
                    found.rows.append(Row(name, message.log_time, np.frombuffer(data, encoding)))
        return found

    @property
    def compared(self) -> int:
        """How many decoded values equal the truth."""
        return sum(len(row.values) for row in self.rows)


def recordings() -> Iterator[Path]:
    """All that are kept, by name."""
    return iter(sorted(FOLDER.glob("*.mcap")))


def mapped(counts: np.ndarray, how: dict[str, Any]) -> np.ndarray:
    """Return what the driver must report for a sample's counts, shape (n,), as the recording's map states it."""
    points, columns = how.get("points"), how.get("columns")
    values = np.asarray(counts, float)
    values = values.reshape(len(values), -1)
    if points is not None:
        values = values[points]
    if columns is not None:
        values = values[:, columns]
    if how.get("sum"):
        values = values.sum(axis=0)
    if "matrix" in how:
        values = np.asarray(how["matrix"]) @ values.ravel()
    values = values * np.asarray(how.get("scale", 1.0)) + np.asarray(how.get("offset", 0.0))
    return (values.T if how.get("transpose") else values).ravel()


def equals(expected: np.ndarray, values: np.ndarray, how: dict[str, Any]) -> bool:
    """Whether a reading is the one expected, number for number; floats to the map's tolerance."""
    tolerance = how.get("tolerance", 1e-6)
    return expected.shape == values.shape and np.allclose(values, expected, rtol=tolerance, atol=tolerance)


def _smallest(values: np.ndarray) -> np.ndarray:
    for code in _DTYPES:
        with np.errstate(invalid="ignore", over="ignore"):
            packed = values.astype(code)
        if np.array_equal(packed.astype(float), values):
            return packed
    return values


def _packed(event: Event) -> bytes:
    match event:
        case Received(data):
            return (b"b" + data) if isinstance(data, bytes) else b"c" + text(data).encode()
        case Opened():
            return b"o"
        case Closed():
            return b"x"
        case LinesChanged(dtr, rts):
            return b"l" + bytes([dtr, rts])
        case Noted(what):
            return b"n" + what.encode()
        case SettingChanged(setting):
            parts: Sequence[Any] = (setting.baud, setting.bytesize, setting.parity, setting.stopbits)
            return b"s" + json.dumps(parts).encode()


def _event(data: bytes) -> Event:
    rest = data[1:]
    match data[:1]:
        case b"b":
            return Received(rest)
        case b"c":
            return Received(parse(rest.decode()))
        case b"o":
            return Opened()
        case b"x":
            return Closed()
        case b"l":
            return LinesChanged(bool(rest[0]), bool(rest[1]))
        case b"n":
            return Noted(rest.decode())
        case b"s":
            return SettingChanged(SerialSetting(*json.loads(rest)))
    raise ValueError(f"no event: {data!r}")
