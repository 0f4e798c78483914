"""The statistics of a running emulator: one :class:`ChannelStatistics` per device."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from html import escape
from typing import Any

import numpy as np

COUNTER_WORDS = {"unheard": "frames without a reader"}
"""Words for counters whose names do not explain themselves."""


def counter_words(name: str) -> str:
    """Return the words that stand for a counter of a device or a wire on the screen."""
    return COUNTER_WORDS.get(name) or name.replace("_", " ")


class Lateness:
    """The lateness of deadlines [ns]: exact count and maximum, percentiles over the latest ``keep`` values."""

    def __init__(self, keep: int = 65536):
        self._values = np.zeros(keep, np.int64)
        self.count = 0
        self.max_ns = 0

    def __getstate__(self) -> dict[str, Any]:
        """Return the values so far, without the unused part of the array."""
        kept = self._values[: min(self.count, len(self._values))]
        return {"values": kept, "count": self.count, "max_ns": self.max_ns}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the values into an array of the default size."""
        self.__init__()
        kept = state["values"]
        self._values[: len(kept)] = kept
        self.count, self.max_ns = state["count"], state["max_ns"]

    def add(self, late_ns: int) -> None:
        """Note one deadline met ``late_ns`` after its time."""
        self._values[self.count % len(self._values)] = late_ns
        self.count += 1
        self.max_ns = max(self.max_ns, late_ns)

    def copy(self) -> Lateness:
        """Return a copy of the present values."""
        twin = Lateness(0)
        kept = min(self.count, len(self._values))
        twin._values = self._values[: max(kept, 1)].copy()
        twin.count, twin.max_ns = self.count, self.max_ns
        return twin

    def percentile_ns(self, q: float) -> float:
        """Return the q-th percentile [ns]; 0 before the first deadline."""
        kept = self._values[: min(self.count, len(self._values))]
        if not len(kept):
            return 0.0
        # np.percentile computes the same, and imports NumPy's masked arrays on its first call.
        at = (len(kept) - 1) * q / 100
        below, above = int(at), min(int(at) + 1, len(kept) - 1)
        ordered = np.partition(kept, (below, above))
        return float(ordered[below] + (ordered[above] - ordered[below]) * (at - below))


@dataclass
class StreamStatistics:
    """Samples of one stream."""

    first_ns: int
    last_ns: int = 0
    samples: int = 0

    def add(self, due_ns: int) -> None:
        """Count a sample that was due at ``due_ns``."""
        self.samples, self.last_ns = self.samples + 1, due_ns

    @property
    def rate_hz(self) -> float:
        """Mean rate since the first sample."""
        elapsed = self.last_ns - self.first_ns
        return (self.samples - 1) * 1e9 / elapsed if elapsed > 0 else 0.0


@dataclass
class ChannelStatistics:
    """Counters of one device since the start."""

    samples: int = 0
    missed: int = 0
    """Samples that were late by a whole period or more, and so were skipped."""
    stretched: int = 0
    """Samples for which the simulation took longer steps than the scene's, because the machine is too slow."""
    silent: int = 0
    """Samples that a booting or hanging device did not take."""
    streams: dict[str, StreamStatistics] = field(default_factory=dict)
    """The statistics of each stream, by name, in the order of their first samples."""
    lateness: Lateness = field(default_factory=Lateness)

    def add_sample(self, stream: str, due_ns: int, late_ns: int) -> None:
        """Count a sample of a stream that was taken ``late_ns`` after ``due_ns``."""
        self.samples += 1
        self.lateness.add(max(0, late_ns))
        if stream not in self.streams:
            self.streams[stream] = StreamStatistics(due_ns)
        self.streams[stream].add(due_ns)

    def copy(self) -> ChannelStatistics:
        """Return a copy of the present counters."""
        streams = {name: replace(each) for name, each in self.streams.items()}
        return replace(self, streams=streams, lateness=self.lateness.copy())

    @property
    def last_ns(self) -> int:
        """The time at which the latest sample was due."""
        return max((each.last_ns for each in self.streams.values()), default=0)

    @property
    def rate_hz(self) -> float:
        """Mean rate of samples since the first, of the first stream."""
        return next((each.rate_hz for each in self.streams.values()), 0.0)

    def as_dict(self) -> dict[str, float]:
        """Return the counters as plain numbers, times in microseconds, for logs and ``--json``."""
        return {
            "samples": self.samples,
            "missed": self.missed,
            "stretched": self.stretched,
            "silent": self.silent,
            "rate_hz": round(self.rate_hz, 3),
            **{f"rate_hz_{name}": round(each.rate_hz, 3) for name, each in self.streams.items() if name},
            "lateness_p50_us": round(self.lateness.percentile_ns(50) / 1e3, 1),
            "lateness_p99_us": round(self.lateness.percentile_ns(99) / 1e3, 1),
            "lateness_max_us": round(self.lateness.max_ns / 1e3, 1),
        }

    def _repr_html_(self) -> str:
        """Return an HTML table for notebooks."""
        rows = "".join(f"<tr><td>{escape(name)}</td><td>{value:g}</td></tr>" for name, value in self.as_dict().items())
        return f"<table>{rows}</table>"
