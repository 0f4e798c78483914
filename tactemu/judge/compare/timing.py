"""Rates and times of answers, judged so that a busy machine changes no verdict: lateness only adds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactemu.judge.compare.findings import Verdicts
from tactemu.judge.compare.frame_classes import FrameClass, decode, matrix
from tactemu.judge.compare.model import Answer

MAX_CLOCK_ERROR = 0.02
"""Largest error of a specimen's clock: an RC oscillator's; a larger one is another rate."""
MIN_RATE_FRAMES = 30
"""Least number of frames whose rate is measured."""
SEARCHED_SHARE = 0.08
"""Largest error of a period that is searched by coherence."""
GRID_STEPS = 5
"""Number of tried periods for each shift by one period over all frames."""
MAX_COHERENT_PERIODS = 3000
"""Largest number of periods over which coherence is searched."""
COHERENT = 0.2
"""Least coherence that shows a period."""
COHERENT_SIGMAS = 6.0
"""The same, in units of the coherence of random times: one over the root of their number."""
MAX_TOGETHER = 0.5
"""Largest share of frames that come at once with the one before; more come in batches of the port's, not in time."""
MAX_SURPLUS = 0.01
"""Largest share by which frames are more than a lower rate gives; half of it is the least by which they are more than
usual for a higher one: frames can be lost, not made."""
MAX_SPREAD = 0.03
"""Largest spread of the rate from window to window of a sensor that is slow, not disturbed."""
MIN_WINDOW_S = 1.0
"""Least length of a window [s]."""
END_SHARE = 0.2
"""Share of the frames at either end, of which the earlier ones count."""
IN_TIME_QUANTILE = 0.25
"""Quantile of the lateness of frames that stands for those in time."""
EARLY_SHARE = 0.3
"""Largest share of a period by which a frame is earlier than the mean; the others are late."""
MIN_ANSWERS = 3
"""Least number of answers whose earliest one counts."""
MIN_TOLERANCE_S = 0.008
"""Least tolerance of the time of an answer [s]: that of a USB bridge's own buffering is added."""


def coherent_period_s(times_s: np.ndarray, usual_s: float) -> tuple[float, bool]:
    """Return the period near the usual one at which times come at the same phase, and True if it is certain.

    Frames that are missing change nothing, late ones little.
    """
    times = times_s - times_s[0]
    times = times[times <= MAX_COHERENT_PERIODS * usual_s]
    step = 1 / (GRID_STEPS * max(10.0, times[-1] / usual_s))
    periods = usual_s * (1 + np.arange(-SEARCHED_SHARE, SEARCHED_SHARE, step))
    blocks = np.array_split(periods, max(1, len(periods) * len(times) // 2_000_000))
    waves = [np.abs(np.exp(2j * np.pi * times / block[:, None]).mean(axis=1)) for block in blocks]
    coherence = np.concatenate(waves)
    best = int(coherence.argmax())
    is_certain = coherence[best] >= max(COHERENT, COHERENT_SIGMAS / len(times) ** 0.5)
    return _refined_s(times_s, float(periods[best])), bool(is_certain)


def _refined_s(times_s: np.ndarray, period_s: float) -> float:
    """Return a period by the frames at both ends that came in time: a frame can be late, never early."""
    apart = (times_s - times_s[0]) / period_s
    phase = np.angle(np.exp(2j * np.pi * apart).mean()) / (2 * np.pi)
    counts = np.floor(apart - phase + EARLY_SHARE)
    lateness = times_s - counts * period_s
    part = max(2, round(END_SHARE * len(times_s)))
    begin, end = slice(0, part), slice(len(times_s) - part, None)
    periods = counts[end].mean() - counts[begin].mean()
    in_time = [float(np.quantile(lateness[each], IN_TIME_QUANTILE)) for each in (begin, end)]
    return period_s + (in_time[1] - in_time[0]) / periods if periods > 0 else period_s


def window_periods_s(times_s: np.ndarray, usual_s: float) -> np.ndarray:
    """Return the period in each of several windows [s]; empty for too few frames."""
    n = max(MIN_RATE_FRAMES, round(MIN_WINDOW_S / usual_s))
    part = max(2, round(END_SHARE * n))
    periods = []
    for start in range(0, len(times_s) - n + 1, max(1, n // 4)):
        window = times_s[start : start + n] - usual_s * np.arange(n)
        # Both ends have their earliest frame at about the same place.
        periods.append(usual_s + (window[-part:].min() - window[:part].min()) / (n - part))
    return np.array(periods)


def clock_period_s(made: FrameClass, contents: Sequence[bytes]) -> float | None:
    """Return the period by the sensor's own clock in its frames [s], if they have one."""
    clocks = [each for each in made.counters if each.rollover.clock]
    if not clocks or len(contents) < MIN_RATE_FRAMES or made.size is None:
        return None
    clock = clocks[0]
    values = decode(matrix(contents), clock.at, clock.code)
    rises = np.diff(values) % clock.modulus
    ordinary = rises[(rises > 0) & (rises < 1.6 * np.median(rises))]
    return float(ordinary.mean()) / clock.rollover.step if len(ordinary) >= MIN_RATE_FRAMES // 2 else None


def check_rate(
    made: FrameClass, times_ns: Sequence[int], contents: Sequence[bytes], verdicts: Verdicts
) -> float | None:
    """Compare the rate of a class of frames, and return the ratio of its period to the model's.

    A busy machine delays frames, and an emulator on it skips some. So the period counts at which frames come, not their
    number; where they come at no even period, only a rate that is the same in all windows is another rate.
    """
    if not made.rate_hz or len(times_ns) < 3:
        return None
    if len(times_ns) < MIN_RATE_FRAMES:
        verdicts.unjudged.append(f"{made.label}: the rate: {len(times_ns)} frames are too few; listen for longer")
        return None
    times = np.asarray(times_ns, float) * 1e-9
    per_sample = made.rate_hz / (made.sample_hz or made.rate_hz)
    period, is_coherent = coherent_period_s(times, per_sample / made.rate_hz)
    ratio = period * made.rate_hz / per_sample
    own = clock_period_s(made, contents)
    together = float((np.diff(times) < 0.2 / made.rate_hz).mean()) * per_sample - (per_sample - 1)
    is_even = is_coherent and together <= MAX_TOGETHER
    if not is_even:
        windows = window_periods_s(times, 1 / made.rate_hz) * made.rate_hz
        ratio = float(np.median(windows)) if len(windows) else ratio
        if own is not None and abs(own * (made.sample_hz or made.rate_hz) - 1) <= MAX_CLOCK_ERROR:
            ratio = own * (made.sample_hz or made.rate_hz)
        elif ratio > 1 + MAX_CLOCK_ERROR and (not len(windows) or np.ptp(windows) > MAX_SPREAD):
            verdicts.unjudged.append(
                f"{made.label}: the rate: frames come too unevenly; record on a machine with less load, or for longer"
            )
            return None
    if abs(ratio - 1) > MAX_CLOCK_ERROR:
        number = (len(times) - 1) / (times[-1] - times[0]) / made.rate_hz
        if number * ratio > 1 + MAX_SURPLUS if ratio > 1 else number < 1 + MAX_SURPLUS / 2:
            verdicts.unjudged.append(
                f"{made.label}: the rate: the number of frames contradicts their times; record again"
            )
            return None
        text = f"{made.rate_hz / ratio:.4g} a second instead of {made.rate_hz:.4g} ({100 * (1 / ratio - 1):+.1f} %)"
        verdicts.find("rate", made.label, text)
        return None
    verdicts.agrees.append(f"{made.label}: {made.rate_hz / ratio:.4g} a second")
    return float(ratio) if is_even else None


def latest_s(answer: Answer, buffering_s: float) -> float:
    """Return the time after which no answer of the model ends, with the tolerance [s]."""
    least, most = answer.wait_s
    return most + max(MIN_TOLERANCE_S, 0.5 * (most - least)) + buffering_s


def check_latency(answer: Answer, waits_s: Sequence[float], buffering_s: float, verdicts: Verdicts) -> None:
    """Compare the time from a request to the end of its answer: the earliest one counts."""
    if len(waits_s) < MIN_ANSWERS or answer.made is None or answer.command.reply is None:
        return  # what follows a request without a documented answer may be a frame of a stream
    least, most = answer.wait_s
    earliest, latest = min(waits_s), latest_s(answer, buffering_s)
    where = f"answer to `{answer.command.name}`"
    if earliest > latest:
        text = f"after {1e3 * earliest:.1f} ms at best, in the model after {1e3 * most:.1f} ms at most"
        verdicts.find("latency", where, text)
    elif earliest < least - (latest - most):
        text = f"after {1e3 * earliest:.1f} ms, in the model after {1e3 * least:.1f} ms at least"
        verdicts.find("latency", where, text)
