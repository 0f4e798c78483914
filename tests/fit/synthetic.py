"""Recordings of sensors that do not exist: known laws, noise, gaps, outliers, and a column that is not the sensor's."""

import numpy as np

from tactemu.fit.press import presses_of
from tactemu.transducers.laws import LogMemory


def loads(rng, *, seconds=160.0, rate=50.0, holds=True):
    """``(t, load)``: slow presses of different heights, some held, with jitter."""
    t = np.arange(0.0, seconds, 1.0 / rate)
    load = np.zeros_like(t)
    begin = 8.0
    while begin < seconds - 20:
        peak, ramp = rng.uniform(3.0, 9.0), rng.uniform(1.5, 3.0)
        hold = rng.uniform(4.0, 9.0) if holds else 0.0
        rise = np.clip((t - begin) / ramp, 0, 1)
        fall = np.clip((t - begin - ramp - hold) / ramp, 0, 1)
        load += peak * (rise - fall)
        begin += 2 * ramp + hold + rng.uniform(2.0, 4.0)
    t = t + rng.normal(0, 0.05 / rate, len(t))
    return t - t[0], load


def with_gaps(rng, rows):
    """Which rows are left."""
    keep = np.ones(rows, bool)
    for gap in rng.integers(200, rows - 200, 4):
        keep[gap : gap + rng.integers(10, 60)] = False
    return keep


def spoiled(rng, readings, share=5e-4):
    """With outliers, and a last column of something else."""
    readings = readings.copy()
    out = rng.random(readings.shape) < share
    readings[out] += 50 * readings.std()
    return np.column_stack([readings, 1e-3 * readings.std() * np.arange(len(readings)) % readings.std()])


def material(rng, *, loop=0.12, softening=0.03, baseline=0.015, creep=0.08, noise=0.02, channels=6):
    """A recording of a soft skin: ``(t, load, readings, truth)``."""
    t, load = loads(rng)
    presses = presses_of(load, t)
    worked = np.log1p(presses.count)
    memory = LogMemory.over(0.1, 1000.0)
    kept = np.exp(-np.diff(t, prepend=t[0])[:, None] / memory.taus)
    state, crept = np.zeros(len(memory.taus)), np.zeros(len(t))
    for row in range(len(t)):
        state = load[row] + (state - load[row]) * kept[row]
        crept[row] = memory.weights @ state
    crept -= float(memory.grown(np.array(1.0))) * load
    felt = load * (1 - softening * worked) + loop * presses.loop + baseline * presses.last * worked + creep * crept
    gains = rng.normal(0, 40e-6, channels)
    gains[np.abs(gains) < 1e-5] = 2e-5
    readings = 1e-4 + felt[:, None] * gains + rng.normal(0, noise * 40e-6, (len(t), channels))
    truth = {"loop": loop, "softening": softening, "baseline": baseline, "creep per decade": creep}
    return t, load, spoiled(rng, readings), truth | {"white noise": noise * 40e-6}


def resistance(rng, *, exponent=1.4, at_one=2e4):
    """A piezoresistor: noise of its logarithm."""
    t, load = loads(rng)
    law = at_one * np.maximum(load, 1e-3)[:, None] ** -exponent * np.array([1.0, 3.0, 8.0])
    return t, load, spoiled(rng, law * np.exp(rng.normal(0, 0.05, law.shape)), 0.0), {
        "exponent": exponent, "resistance at 1 N": at_one,
    }  # fmt: skip


def capacitance(rng, *, band=0.6, per_n=0.4e-12, rest=5e-12):
    """Three capacitors with a dead band."""
    t, load = loads(rng)
    law = rest + per_n * np.maximum(load - band, 0.0)[:, None] * np.ones(3)
    return t, load, spoiled(rng, law + rng.normal(0, 0.05e-12, law.shape), 0.0), {
        "dead band": band, "capacitance per N": per_n, "capacitance at rest": rest,
    }  # fmt: skip


def fluid(rng, *, tau=0.45, per_n=900.0):
    """A medium that is late."""
    t, load = loads(rng)
    y, late = np.zeros(len(t)), 0.0
    for row, step in enumerate(np.diff(t, prepend=t[0])):
        late = load[row] + (late - load[row]) * np.exp(-step / tau)
        y[row] = per_n * late
    readings = y[:, None] * np.ones(2) + rng.normal(0, 60.0, (len(t), 2))
    return t, load, spoiled(rng, readings, 0.0), {"tau": tau, "pressure per N": per_n}


MAKERS = {"field": material, "resistance": resistance, "capacitance": capacitance, "pressure": fluid}


def recorded(kind, seed):
    """``(recording, truth)`` of a kind."""
    from pathlib import Path

    from tactemu.fit.recording import Recorded

    rng = np.random.default_rng([seed, *kind.encode()])
    t, load, readings, truth = MAKERS[kind](rng)
    keep = with_gaps(rng, len(t))
    t, load, readings = t[keep] - t[keep][0], load[keep], readings[keep]
    names = (*(f"c{k}" for k in range(readings.shape[1] - 1)), "wrong")
    return Recorded(Path(f"{kind}.npz"), "0" * 64, t, readings, names, kind, "SI", {"force": load}), truth
