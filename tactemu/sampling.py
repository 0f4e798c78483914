"""When a device samples, and when its sample leaves: the time domain of imperfections, in integer nanoseconds."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count

from tactemu.random_streams import stream_key

_MASK = 2**64 - 1


@dataclass(frozen=True, kw_only=True)
class SampleClock:
    """The device's own clock, seen from ours.

    Sample ``k`` (from 1) is due when the device's oscillator has counted ``startup + k * period`` since ``start``. An
    oscillator that is slow by ``skew_ppm``, and slower each second by ``drift_ppm_per_s``, takes longer for it than
    ours: a count of n seconds lasts ``n + 1e-6 (skew n + drift n^2 / 2)``. Times follow from the count, so that no
    error accumulates. Frames of a sample leave ``delay_ns`` after it was due, plus a jitter that is uniform in
    ``[0, jitter_ns]``; unless ``reorder`` is set they never overtake those of an earlier sample.

    Raises:
        ValueError: a period that is not positive; a negative delay, jitter or start-up time; a clock that stands still.
    """

    period_ns: int
    start_ns: int = 0
    """When the device was powered up."""
    startup_ns: int = 0
    """How long it takes to boot: its first sample comes a period later."""
    skew_ppm: float = 0.0
    """Positive: the device's clock is slow, its samples come late."""
    drift_ppm_per_s: float = 0.0
    """Growth of the skew, by the device's own seconds (a board that warms up)."""
    delay_ns: int = 0
    jitter_ns: int = 0
    reorder: bool = False
    """Frames may overtake those of earlier samples."""
    hangs: tuple[tuple[int, int], ...] = ()
    """Times (from, until) in which the device does nothing: samples due then are not taken."""
    seed: int = 0
    name: str = "device"

    def __post_init__(self):
        if self.period_ns <= 0:
            raise ValueError(f"period_ns: expected > 0, got {self.period_ns}")
        for option in ("delay_ns", "jitter_ns", "startup_ns"):
            if getattr(self, option) < 0:
                raise ValueError(f"{option}: expected >= 0, got {getattr(self, option)}")
        if not -1e5 <= self.skew_ppm <= 1e6:
            raise ValueError(f"skew_ppm: expected within -1e5 and 1e6, got {self.skew_ppm}")
        if not abs(self.drift_ppm_per_s) <= 1e3:
            raise ValueError(f"drift_ppm_per_s: expected within +-1000, got {self.drift_ppm_per_s}")
        if any(end < begin for begin, end in self.hangs):
            raise ValueError(f"hangs: expected (from, until) with from <= until, got {self.hangs}")

    # -- the oscillator ----------------------------------------------------------------------------------------------

    def due_ns(self, k: int) -> int:
        """Absolute time of sample ``k``."""
        counted = self.startup_ns + k * self.period_ns
        return self.start_ns + counted + self._late(counted)

    def local_ns(self, t_ns: int) -> int:
        """What the device's clock, started with ours, shows at our time ``t_ns``: for its time stamps."""
        since = t_ns - self.start_ns
        if since <= 0 or not (self.skew_ppm or self.drift_ppm_per_s):
            return t_ns
        counted = since
        for _ in range(20):  # Newton's method; two or three rounds at the skew of any real oscillator
            wrong = counted + self._late(counted) - since
            if abs(wrong) <= 1:
                break
            rate = 1.0 + 1e-6 * (self.skew_ppm + self.drift_ppm_per_s * counted * 1e-9)
            counted -= round(wrong / max(rate, 0.5))
        return self.start_ns + counted

    def _late(self, counted: int) -> int:
        """How much longer than the count itself a count [ns] lasts."""
        ppm = self.skew_ppm + 0.5 * self.drift_ppm_per_s * (counted * 1e-9)
        # Never faster than nine tenths of its time, however long it drifts.
        return round(counted * max(ppm, -1e5)) // 1_000_000 if ppm else 0

    # -- what leaves -------------------------------------------------------------------------------------------------

    def release_ns(self, k: int, due_ns: int) -> int:
        """When the frames of sample ``k`` leave: never before ``delay_ns`` has passed."""
        release = due_ns + self.delay_ns + self._jitter(k)
        if self.reorder or not self.jitter_ns:
            return release
        for j in count(k - 1, -1):
            due = self.due_ns(j)
            if j < 1 or due + self.jitter_ns <= due_ns:
                return release
            release = max(release, due + self.delay_ns + self._jitter(j))
        return release

    @cached_property
    def _key(self) -> int:
        return stream_key(self.seed, f"{self.name}/jitter")

    def _jitter(self, k: int) -> int:
        """Uniform in ``[0, jitter_ns]``, a function of the seed, the name and ``k`` alone (SplitMix64 of a counter)."""
        if not self.jitter_ns:
            return 0
        z = (((self._key << 32) ^ k) * 0x9E3779B97F4A7C15) & _MASK
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & _MASK
        return ((z ^ (z >> 31)) * (self.jitter_ns + 1)) >> 64

    # -- what happens to it ------------------------------------------------------------------------------------------

    def awake(self, t_ns: int) -> bool:
        """Has the device booted by ``t_ns``, and does it not hang?"""
        return self.hung_until(t_ns) == t_ns

    def hung_until(self, t_ns: int) -> int:
        """When the device works again that boots or hangs at ``t_ns``; ``t_ns`` itself if it works."""
        ready = max(t_ns, self.start_ns + self.startup_ns + self._late(self.startup_ns))
        for begin, end in sorted(self.hangs):
            if begin <= ready < end:
                ready = end
        return ready

    def next_taken(self, k: int) -> int:
        """Number of the first sample from ``k`` on that no hang swallows."""
        while (ready := self.hung_until(self.due_ns(k))) > self.due_ns(k):
            counted = self.local_ns(ready) - self.start_ns - self.startup_ns
            k = max(k + 1, counted // self.period_ns)
            while self.due_ns(k) < ready:
                k += 1
        return k

    def hanging(self, from_ns: int, until_ns: int) -> SampleClock:
        """The same clock with one more time in which the device does nothing."""
        return replace(self, hangs=(*self.hangs, (from_ns, until_ns)))

    def restarted(self, start_ns: int, period_ns: int) -> SampleClock:
        """The same oscillator, as far as it has drifted, counting anew from ``start_ns`` with another period."""
        return replace(self, start_ns=start_ns, startup_ns=0, period_ns=period_ns, skew_ppm=self._skew(start_ns))

    def rebooted(self, at_ns: int) -> SampleClock:
        """After a reset of the device at ``at_ns``: it boots, then counts its samples from 1 again."""
        return replace(self, start_ns=at_ns, skew_ppm=self._skew(at_ns))

    def _skew(self, t_ns: int) -> float:
        return self.skew_ppm + self.drift_ppm_per_s * max(0, t_ns - self.start_ns) * 1e-9
