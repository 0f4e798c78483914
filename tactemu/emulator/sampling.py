"""The sample times of a device and the times at which its samples leave, in integer nanoseconds."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count

from tactemu.base.random_streams import stream_key, uniform_64


@dataclass(frozen=True, kw_only=True)
class SampleClock:
    """The device's own clock, in emulation time.

    Sample ``k`` (from 1) is due when the device's oscillator has counted ``k * period`` since ``start``. An
    oscillator that is slow by ``skew_ppm``, and slower each second by ``drift_ppm_per_s``, takes longer for it: a
    count of n seconds lasts ``n + 1e-6 (skew n + drift n^2 / 2)``. Times follow from the count, so that no error
    accumulates. Frames of a sample leave ``delay_ns`` after it was due, plus a jitter that is uniform in
    ``[0, jitter_ns]``; unless ``reorder`` is set they never overtake those of an earlier sample. Firmware whose loop
    is too slow at times skips samples: a share ``missed`` is never taken, and the periods have a second mode at twice
    the first.

    Raises:
        ValueError: a period that is not positive; a negative delay or jitter; a clock that stands still or misses all.
    """

    period_ns: int
    start_ns: int = 0
    """Time from which samples are counted."""
    shown_ns: int | None = None
    """Time of the device's clock at ``start_ns``; ``None``: the same."""
    skew_ppm: float = 0.0
    """Positive: the device's clock is slow, its samples come late."""
    drift_ppm_per_s: float = 0.0
    """Growth of the skew, by the device's own seconds (a board that warms up)."""
    delay_ns: int = 0
    jitter_ns: int = 0
    reorder: bool = False
    """Frames may overtake those of earlier samples."""
    missed: float = 0.0
    """Share of samples that are never taken."""
    restarts: int = 0
    """Number of times that counting was restarted; each restart has its own jitter."""
    seed: int = 0
    name: str = "device"

    def __post_init__(self):
        if self.period_ns <= 0:
            raise ValueError(f"period_ns: expected > 0, got {self.period_ns}")
        for option in ("delay_ns", "jitter_ns"):
            if getattr(self, option) < 0:
                raise ValueError(f"{option}: expected >= 0, got {getattr(self, option)}")
        if not -1e5 <= self.skew_ppm <= 1e6:
            raise ValueError(f"skew_ppm: expected within -1e5 and 1e6, got {self.skew_ppm}")
        if not abs(self.drift_ppm_per_s) <= 1e3:
            raise ValueError(f"drift_ppm_per_s: expected within +-1000, got {self.drift_ppm_per_s}")
        if not 0 <= self.missed <= 0.9:
            raise ValueError(f"missed: expected within 0 and 0.9, got {self.missed}")

    # -- the oscillator ----------------------------------------------------------------------------------------------

    def due_ns(self, k: int) -> int:
        """Return the time of sample ``k``."""
        counted = k * self.period_ns
        return self.start_ns + counted + self._lateness_ns(counted)

    def stamp_ns(self, k: int) -> int:
        """Return the time of the device's clock at sample ``k``: exactly a period after the sample before."""
        return self._shown_at_start + k * self.period_ns

    def local_ns(self, t_ns: int) -> int:
        """Return the time of the device's clock at emulation time ``t_ns``."""
        since = t_ns - self.start_ns
        shown = self._shown_at_start
        if since <= 0 or not (self.skew_ppm or self.drift_ppm_per_s):
            return shown + since
        counted = since
        for _ in range(20):  # Newton's method; two or three rounds at the skew of any real oscillator
            wrong = counted + self._lateness_ns(counted) - since
            if abs(wrong) <= 1:
                break
            rate = 1.0 + 1e-6 * (self.skew_ppm + self.drift_ppm_per_s * counted * 1e-9)
            counted -= round(wrong / max(rate, 0.5))
        return shown + counted

    def world_ns(self, shown_ns: int) -> int:
        """Return the emulation time at which the device's clock shows ``shown_ns``."""
        counted = shown_ns - self._shown_at_start
        return self.start_ns + counted + (self._lateness_ns(counted) if counted > 0 else 0)

    @cached_property
    def _shown_at_start(self) -> int:
        return self.start_ns if self.shown_ns is None else self.shown_ns

    def _lateness_ns(self, counted: int) -> int:
        """Return the extra duration of a count [ns] due to skew and drift."""
        ppm = self.skew_ppm + 0.5 * self.drift_ppm_per_s * (counted * 1e-9)
        # However long the oscillator drifts, a count lasts at least nine tenths of its nominal time.
        return round(counted * max(ppm, -1e5)) // 1_000_000 if ppm else 0

    def first_taken(self, k: int) -> int:
        """Return the number of the first sample from ``k`` on that is not missed."""
        while self.missed and uniform_64(self._missed_key, k) < self.missed * 2**64:
            k += 1
        return k

    @cached_property
    def _missed_key(self) -> int:
        return stream_key(self.seed, f"{self.name}/missed/{self.restarts}")

    # -- what leaves -------------------------------------------------------------------------------------------------

    def release_ns(self, k: int, due_ns: int) -> int:
        """Return the time at which the frames of sample ``k`` leave, ``delay_ns`` after ``due_ns`` at the earliest."""
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
    def _jitter_key(self) -> int:
        return stream_key(self.seed, f"{self.name}/jitter/{self.restarts}")

    def _jitter(self, k: int) -> int:
        """Return the jitter of sample ``k``, uniform in ``[0, jitter_ns]``: it depends on seed, name and ``k``."""
        return (uniform_64(self._jitter_key, k) * (self.jitter_ns + 1)) >> 64 if self.jitter_ns else 0

    def restarted(self, start_ns: int, period_ns: int) -> SampleClock:
        """Return the same oscillator with its present skew, which counts from ``start_ns`` with another period."""
        seconds = max(0, start_ns - self.start_ns) * 1e-9
        return replace(
            self,
            start_ns=start_ns,
            restarts=self.restarts + 1,
            shown_ns=self.local_ns(start_ns),
            period_ns=period_ns,
            skew_ppm=self.skew_ppm + self.drift_ppm_per_s * seconds,
        )
