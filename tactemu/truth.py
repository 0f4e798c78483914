"""The truth log: for every sample and frame, what was felt, what was read, what was sent and what was injected.

One JSON object a line (``docs/truth-log.md``). ``t_ns`` is emulation time in integer nanoseconds, ``device`` the name
of the skin in the scene, ``kind`` one of:

======== ====================================================================================================
sample   ``ideal`` and ``measured`` readings [SI, by ``senses``], ``counts`` = what a perfect driver decodes
tx       ``data``: a frame as it left for the driver, faults included (hex; CAN in candump notation)
rx       ``data``: what arrived from the driver, faults included
drop     ``data``, ``why``: a frame that never left (``line full``, ``nobody listens``, ``fault`` ...)
inject   ``what`` was done, with ``detail``: a fault of values, time or bytes
event    ``what``: ``opened``, ``closed``, ``baud 9600`` ...
======== ====================================================================================================
"""

from __future__ import annotations

import json
from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from firmware_protocols import Frame


@dataclass(frozen=True, kw_only=True, slots=True)
class Sample:
    """One sample of one device. Arrays in layout order."""

    t_ns: int
    device: str
    ideal: np.ndarray
    measured: np.ndarray
    counts: np.ndarray


class Truth:
    """What really happened, kept in memory (the latest ``keep`` entries) and, if asked, written to a file.

    ``injected`` counts every fault by name, so that a test can write
    ``assert driver.bad_frames == truth.injected["flip"]``.

    Raises:
        OSError: the file cannot be written.
    """

    def __init__(self, path: str | Path | None = None, *, keep: int = 100_000):
        self.injected: Counter[str] = Counter()
        self.samples: deque[Sample] = deque(maxlen=keep)
        self.latest: dict[str, Sample] = {}
        """The last sample of each device."""
        self.frames: deque[tuple[int, str, Frame]] = deque(maxlen=keep)
        """``(t_ns, device, frame)`` of every frame that left for the driver."""
        self.counts: Counter[str] = Counter()
        """Entries by kind."""
        self._file: IO[str] | None = open(path, "w", encoding="utf-8") if path else None

    def sample(self, t_ns: int, device: str, ideal: np.ndarray, measured: np.ndarray, counts: np.ndarray) -> None:
        """Keep one sample; the arrays are copied, so that the caller may reuse them."""
        self.counts["sample"] += 1
        entry = Sample(
            t_ns=t_ns, device=device, ideal=ideal.copy(), measured=measured.copy(), counts=np.array(counts, copy=True)
        )
        self.samples.append(entry)
        self.latest[device] = entry
        if self._file:
            self._write(t_ns, device, "sample", ideal=ideal, measured=measured, counts=counts)

    def wrote(self, t_ns: int, device: str, frame: Frame) -> None:
        """A frame left for the driver."""
        self.counts["tx"] += 1
        self.frames.append((t_ns, device, frame))
        if self._file:
            self._write(t_ns, device, "tx", data=text(frame))

    def received(self, t_ns: int, device: str, frame: Frame) -> None:
        """Something arrived from the driver."""
        self.counts["rx"] += 1
        if self._file:
            self._write(t_ns, device, "rx", data=text(frame))

    def dropped(self, t_ns: int, device: str, frame: Frame, why: str) -> None:
        """A frame never left."""
        self.counts["drop"] += 1
        if self._file:
            self._write(t_ns, device, "drop", data=text(frame), why=why)

    def inject(self, t_ns: int, device: str, what: str, detail: str = "") -> None:
        """A fault was injected."""
        self.injected[what] += 1
        self.counts["inject"] += 1
        if self._file:
            self._write(t_ns, device, "inject", what=what, detail=detail)

    def event(self, t_ns: int, device: str, what: str) -> None:
        """The port was opened or closed, the baud rate changed ..."""
        self.counts["event"] += 1
        if self._file:
            self._write(t_ns, device, "event", what=what)

    def close(self) -> None:
        """Flush and close the file."""
        if self._file:
            self._file.close()
            self._file = None

    def _write(self, t_ns: int, device: str, kind: str, **entry: Any) -> None:
        assert self._file is not None
        row = {"t_ns": t_ns, "device": device, "kind": kind, **entry}
        self._file.write(json.dumps(row, default=_plain, separators=(",", ":")) + "\n")


def text(frame: Frame) -> str:
    """A frame as the log writes it: hex for bytes, candump notation for CAN."""
    return frame.hex() if isinstance(frame, bytes | bytearray) else str(frame)


def read(path: str | Path) -> Iterator[dict[str, Any]]:
    """The entries of a truth log, one dict a line.

    Raises:
        ValueError: a line is no JSON object; names the line.
    """
    with open(path, encoding="utf-8") as lines:
        for number, line in enumerate(lines, 1):
            try:
                yield json.loads(line)
            except json.JSONDecodeError as error:
                raise ValueError(f"{path}:{number}: not a line of a truth log: {error}") from None


def _plain(value: Any) -> Any:
    """Arrays as lists. Float32 goes through its shortest decimal, so that reading it back gives the same bits."""
    if isinstance(value, np.ndarray):
        if value.dtype == np.float32:
            return [float(str(x)) for x in value.ravel()] if value.ndim == 1 else [_plain(row) for row in value]
        return value.tolist()
    return value.item()
