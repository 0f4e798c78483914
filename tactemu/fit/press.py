"""Estimates from presses of known force: gains, curve, loop, creep, wear, lag; and columns that do not follow it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactemu.fit.estimates import Findings, linear, nonlinear, ratio
from tactemu.fit.recording import Recorded
from tactemu.transducers.laws import LogMemory

MIN_PRESSES = 3
"""Minimum number of presses for estimates."""
MAX_GAPS = 12
"""Maximum number of gaps, the longest, after which the material's memory is fitted anew."""
PRESSED = 0.05
"""Share of the highest load above which a press begins, as in :mod:`tactemu.transducers.material`."""


@dataclass(frozen=True)
class Presses:
    """The presses of a load (or of another drive) over time."""

    load: np.ndarray
    count: np.ndarray
    """The number of presses that have ended, at each row."""
    last: np.ndarray
    """The peak of the last press that has ended [N]."""
    loop: np.ndarray
    """``P 4 s (1 − s)`` while the load falls, else 0 [N]."""
    holds: list[tuple[int, int]]
    """The first row and the row after the last of each time of constant load."""


def presses_of(load: np.ndarray, t: np.ndarray) -> Presses:
    """Cut a load into presses, by the rules of the material's stage."""
    top = np.maximum.accumulate(load)
    pressed, begun = np.zeros(len(load), bool), False
    above, below = load > PRESSED * top, load < 0.5 * PRESSED * top
    for row in np.flatnonzero(np.diff(above.astype(int), prepend=0) | np.diff(below.astype(int), prepend=0)):
        now = bool(above[row]) or (begun and not below[row])
        if now != begun:
            pressed[row:] = now
            begun = now
    edges = np.flatnonzero(np.diff(np.concatenate([[False], pressed, [False]]).astype(int))).reshape(-1, 2)
    count, last, loop = np.zeros(len(load)), np.zeros(len(load)), np.zeros(len(load))
    for first, end in edges:
        highest = first + int(np.argmax(load[first:end]))
        peak = load[highest]
        share = np.clip(load[highest:end] / peak, 0.0, 1.0)
        branch = np.maximum.accumulate(np.clip((1.0 - share) / 0.1, 0.0, 1.0))
        loop[highest:end] = peak * 4.0 * share * (1.0 - share) * branch
        if end < len(load):
            count[end:] += 1
            last[end:] = peak
    return Presses(load, count, last, loop, _holds(load, t, edges))


def _holds(load: np.ndarray, t: np.ndarray, edges: np.ndarray) -> list[tuple[int, int]]:
    found = []
    for first, end in edges:
        high = load[first:end]
        steady = np.abs(high - np.median(high)) < 0.03 * high.max()
        rows = first + np.flatnonzero(steady)
        if len(rows) > 20 and t[rows[-1]] - t[rows[0]] > 3.0 and len(rows) > 0.7 * (rows[-1] - rows[0]):
            found.append((int(rows[0]), int(rows[-1]) + 1))
    return found


def find_presses(recorded: Recorded, found: Findings) -> np.ndarray:
    """Add all estimates from a known load, and return the gain of each channel; NaN if it does not follow the load."""
    none = np.full(recorded.readings.shape[1], np.nan)
    load = recorded.load
    if load is None:
        found.unknown.append(
            "gains, curve, loop, creep: they need the force: record presses with a scale or a load cell"
        )
        return none
    if recorded.t is None:
        found.unknown.append("loop and creep: they need times; give --rate")
    t = recorded.t if recorded.t is not None else np.arange(len(load), dtype=float)
    presses = presses_of(load, t)
    n_presses = int(presses.count[-1]) + int(load[-1] > PRESSED * load.max())
    if n_presses < MIN_PRESSES or np.ptp(load) == 0:
        found.unknown.append(
            f"gains and laws: {n_presses} presses, {MIN_PRESSES} are needed; ten determine wear as well"
        )
        return none
    gains = find_gains(recorded, presses, found)
    own = np.isfinite(gains)
    if not own.any():
        found.unknown.append("laws: no column follows the load; are the columns the right ones?")
        return gains
    if recorded.kind == "resistance":
        find_resistance(recorded, load, own, found)
    elif recorded.kind == "capacitance":
        find_capacitance(recorded, load, own, found)
    elif recorded.kind == "pressure":
        find_lag(recorded, load, t, own, found)
    else:
        signal = recorded.readings[:, own] @ gains[own] / (gains[own] ** 2).sum()
        drive, degree = drive_of(recorded, load)
        of_drive = presses if degree == 1 else presses_of(drive, t)
        find_material(signal, of_drive, t, found, degree=degree, timed=recorded.t is not None)
    return gains


def drive_of(recorded: Recorded, load: np.ndarray) -> tuple[np.ndarray, int]:
    """Return the drive of a reading and the degree of its polynomial: the depth of a probe if known, because a robot
    reports it without delay, else the force."""
    place = recorded.truth.get("depth", recorded.truth.get("z"))
    if place is None or np.ptp(place) == 0:
        return load, 1
    way = 1.0 if np.corrcoef(place, load)[0, 1] > 0 else -1.0
    return way * (place - (place.min() if way > 0 else place.max())) / np.ptp(place), 3


def bases_of(presses: Presses, degree: int) -> np.ndarray:
    """Return the bases of a reading without creep: a constant, powers of the drive, loop, wear, remaining baseline."""
    worked = np.log1p(presses.count)
    powers = [presses.load**k for k in range(degree + 1)]
    return np.column_stack([*powers, presses.loop, -presses.load * worked, presses.last * worked])


def find_gains(recorded: Recorded, presses: Presses, found: Findings) -> np.ndarray:
    """Return the gain of each channel per newton; NaN for channels that do not follow the load."""
    load = presses.load
    bases = np.column_stack([np.ones(len(load)), load])
    x = recorded.readings
    gains, shares = np.zeros(x.shape[1]), np.zeros(x.shape[1])
    rank = np.argsort(np.argsort(load))
    for k in range(x.shape[1]):
        if x[:, k].std() > 0:
            order = np.argsort(np.argsort(x[:, k]))
            shares[k] = np.corrcoef(rank, order)[0, 1] ** 2
            gains[k] = linear(bases, x[:, k])[0][1]
    good = shares > 0.2
    if good.any():
        for name in np.array(recorded.names)[~good]:
            found.notes.append(f"{name} does not follow the load: left out (dead, another axis, or another column)")
    strength = np.linalg.norm(gains[good])
    found.notes.append(f"{int(good.sum())} of {len(gains)} channels follow the load, {strength:.4g} per N together")
    return np.where(good, gains, np.nan)


def find_material(
    signal: np.ndarray, presses: Presses, t: np.ndarray, found: Findings, *, degree: int, timed: bool
) -> None:
    """Add loop, wear, remaining baseline, and creep if load was held, from one linear fit of their bases.

    They are shares of the polynomial part of the reading at the highest drive; if the drive is the force, of the load.
    """
    load = presses.load
    all_bases = bases_of(presses, degree)
    names, kept = [], list(range(degree + 1))
    if np.abs(presses.loop).max() > 0.2 * load.max() and (presses.loop > 0).mean() > 0.05:
        names.append("loop")
        kept.append(degree + 1)
    if presses.count[-1] >= MIN_PRESSES:
        names += ["softening", "baseline"]
        kept += [degree + 2, degree + 3]
    bases = [*all_bases[:, kept].T]
    if timed and presses.holds:
        names.append("creep per decade")
        bases += [_creep_basis(load, t), *_after_gaps(t)]
    law, covariance, _ = linear(np.column_stack(bases), signal)
    top = np.zeros(len(law))
    top[1 : degree + 1] = load.max() ** np.arange(degree)  # the reading at the highest drive, per drive
    for k, name in enumerate(names, degree + 1):  # bases after the last name have no parameter
        both = np.stack([np.eye(len(law))[k], top])
        pair = both @ covariance @ both.T
        value, error = ratio(law[k], float(top @ law), pair)
        found.add(name, value, error, "", "of the load" if degree == 1 else "of the reading at the deepest")
    if "creep per decade" not in names:
        found.unknown.append("creep: record holds of ten seconds and more, with times")
    if "loop" not in names:
        found.unknown.append("loop: record presses that come and go slowly, with many rows on the way")


def _after_gaps(t: np.ndarray) -> list[np.ndarray]:
    """Return a decay for each term of the memory after each long gap, because its state there is unknown."""
    steps = np.diff(t)
    usual = np.median(steps)
    gaps = np.flatnonzero(steps > 3 * usual)
    taus = [tau for tau in LogMemory.over(0.1, 1000.0).taus if tau > 3 * usual]
    longest = gaps[np.argsort(steps[gaps])[::-1][:MAX_GAPS]]
    after = [np.where(t >= t[gap + 1], t - t[gap + 1], np.inf) for gap in longest]
    return [np.exp(-since / tau) for since in after for tau in taus]


def _creep_basis(load: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return the response of the material's memory to the load, per unit of creep; exact for constant loads."""
    memory = LogMemory.over(0.1, 1000.0)
    total = np.zeros(len(load))
    steps = np.diff(t, prepend=t[0])
    gap = steps > 3 * np.median(steps)
    drive = np.where(gap, 0.5 * (load + np.roll(load, 1)), load).tolist()  # the mean over a gap
    for tau, weight in zip(memory.taus, memory.weights):
        kept = np.exp(-steps / tau)
        z, out = 0.0, np.empty(len(load))
        for row, (v, k) in enumerate(zip(drive, kept.tolist())):
            z = v + (z - v) * k
            out[row] = z
        total += weight * out
    return total - float(memory.grown(np.array(1.0))) * load


def find_resistance(recorded: Recorded, load: np.ndarray, own: np.ndarray, found: Findings) -> None:
    """Fit ``R = R1 F^-n`` by logarithms to the channel that falls most."""
    x = recorded.readings[:, own]
    k = int(np.argmin(np.median(x[load > 0.5 * load.max()], axis=0)))
    pressed = (load > PRESSED * load.max()) & (x[:, k] > 0)
    bases = np.column_stack([np.ones(int(pressed.sum())), np.log(load[pressed])])
    law, covariance, _ = linear(bases, np.log(x[pressed, k]))
    found.add("exponent", -law[1], np.sqrt(covariance[1, 1]), "", "R ∝ force^-n")
    at = np.exp(law[0])
    found.add("resistance at 1 N", at, at * np.sqrt(covariance[0, 0]), "Ohm")


def find_capacitance(recorded: Recorded, load: np.ndarray, own: np.ndarray, found: Findings) -> None:
    """Fit ``C = C0 + k max(0, F − F0)``, growth per newton and the dead band, to all channels that follow the load."""
    y = recorded.readings[:, own].mean(axis=1)
    scale = y.std()
    begin = [0.05 * load.max(), np.min(y) / scale, np.ptp(y) / scale / load.max()]

    def apart(p: np.ndarray) -> np.ndarray:
        return p[1] + p[2] * np.maximum(load - p[0], 0.0) - y / scale

    law, errors = nonlinear(apart, begin, ([0.0, -np.inf, -np.inf], [load.max(), np.inf, np.inf]))
    found.add("dead band", law[0], errors[0], "N", "force up to which nothing moves")
    found.add("capacitance per N", law[2] * scale, errors[2] * scale, "F/N", "mean over the channels")
    found.add("capacitance at rest", law[1] * scale, errors[1] * scale, "F", "mean over the channels")


def find_lag(recorded: Recorded, load: np.ndarray, t: np.ndarray, own: np.ndarray, found: Findings) -> None:
    """Fit ``dy/dt = (k F − y)/τ``, the medium's lag, to the mean of all channels that follow the load."""
    if recorded.t is None:
        found.unknown.append("lag of the medium: it needs times; give --rate")
        return
    from scipy.signal import lfilter

    step = float(np.median(np.diff(t)))
    even = np.arange(0.0, t[-1], step)
    force, y = np.interp(even, t, load), np.interp(even, t, recorded.readings[:, own].mean(axis=1))
    scale = max(y.std(), 1e-30)

    use = np.ones(len(even), bool)

    def apart(p: np.ndarray) -> np.ndarray:
        kept = np.exp(-step / np.exp(p[0]))
        return (p[1] + p[2] * lfilter([1.0 - kept], [1.0, -kept], force) - y / scale)[use]

    ends = ([np.log(0.1 * step), -np.inf, -np.inf], [np.log(t[-1]), np.inf, np.inf])
    law, errors = nonlinear(apart, [np.log(5 * step), y[0] / scale, np.ptp(y) / scale / load.max()], ends)
    for gap in np.flatnonzero(np.diff(t) > 3 * step):  # the load in a gap is unknown, and affects the readings after it
        use &= (even < t[gap]) | (even > t[gap + 1] + 6 * np.exp(law[0]))
    law, errors = nonlinear(apart, law, ends)
    tau = float(np.exp(law[0]))
    found.add("tau", tau, tau * errors[0], "s", "lag of the medium")
    found.add("pressure per N", law[2] * scale, errors[2] * scale, "Pa/N", "mean over the channels")
