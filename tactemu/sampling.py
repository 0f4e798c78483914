"""When a device samples, and when its sample leaves: the time domain of imperfections, in integer nanoseconds."""

from __future__ import annotations

from dataclasses import dataclass, replace

from tactemu.random_streams import stream_key


@dataclass(frozen=True, kw_only=True)
class SampleClock:
    """The device's own clock, seen from ours.

    Sample ``k`` (from 1) is due at ``start + k * period``, stretched by the skew of the device's oscillator. Its frames
    leave ``delay_ns`` later plus a uniform jitter in ``[0, jitter_ns]``; they never overtake an earlier sample's.

    Raises:
        ValueError: a period that is not positive, or a negative delay or jitter.
    """

    period_ns: int
    start_ns: int = 0
    skew_ppm: float = 0.0
    """Positive: the device's clock is slow, its samples come late."""
    delay_ns: int = 0
    jitter_ns: int = 0
    seed: int = 0
    name: str = "device"

    def __post_init__(self):
        if self.period_ns <= 0:
            raise ValueError(f"period_ns: expected > 0, got {self.period_ns}")
        if self.delay_ns < 0 or self.jitter_ns < 0:
            raise ValueError(f"delay_ns and jitter_ns: expected >= 0, got {self.delay_ns} and {self.jitter_ns}")

    def due_ns(self, k: int) -> int:
        """Absolute time of sample ``k``: computed from the count, so that no error accumulates."""
        nominal = k * self.period_ns
        return self.start_ns + nominal + round(nominal * self.skew_ppm) // 1_000_000

    def release_ns(self, k: int, due_ns: int) -> int:
        """When the frames of sample ``k`` leave: never before ``delay_ns``, never before those of sample ``k - 1``."""
        if not self.jitter_ns:
            return due_ns + self.delay_ns
        return max(
            self.due_ns(j) + self.delay_ns + self._jitter(j)
            for j in range(max(1, k - self.jitter_ns // self.period_ns - 1), k + 1)
        )

    def _jitter(self, k: int) -> int:
        """Uniform in ``[0, jitter_ns]``, a function of the seed and ``k`` alone."""
        return stream_key(self.seed, f"{self.name}/jitter/{k}") % (self.jitter_ns + 1)

    def restarted(self, start_ns: int, period_ns: int) -> SampleClock:
        """The same oscillator counting anew from ``start_ns`` with another period."""
        return replace(self, start_ns=start_ns, period_ns=period_ns)
