"""Inspire RH56DFX: the peak force of a finger that closes at a speed until its force register passes a limit.

A recording is a :class:`Stops`. The law is the motion of a motor against a contact, in units of its angle register::

    G(θ) = s softplus(θ1 − θ, w)                       contact: force [g] at the angle θ
    dθ/dt = −v (1 − (G/stall)²) / (1 + G/(d v))        v = 2.83 speed, at most 2400 per second, less under load
    stop: when r G passes the limit, and latency later; then it gives back up to b, less near the stall

``peak`` is G at the final angle. The contact is fitted to the motion at the slowest speed and to the final angles; the
other parameters are fitted to the peaks. All peaks are means over the trials of a recording.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactemu.fit.estimates import least_squares
from tactemu.fit.sets.aims import Aim, Fold, Recordings, stem, table_of
from tactemu.transducers.laws import softplus

ANGLES = np.arange(705.0, 600.0, -0.05)
"""The angles of the simulated motion, from before contact on."""
ANGLE_PER_S_PER_SPEED = 2.83
"""The motion of the angle register per second and unit of speed."""
MAX_ANGLE_PER_S = 2400.0
"""The maximum motion of the angle register per second."""
NAMES = ("latency_s", "yield_g_s", "stall_g", "register_share", "gives_back")
USUAL = np.log([0.02, 6.0, 1720.0, 0.9, 3.0])
PRIOR_WEIGHTS = 0.3 * np.array([0.5, 0.5, 4.0, 3.0, 1.0])
"""The weight that keeps each parameter near its usual value, because eight peaks do not determine five parameters."""

AIMS = (
    *(
        Aim(f"speed {speed}", f"force-stop peak at speed {speed}, each limit left out", 15.0, "%")
        for speed in (25, 100, 250, 1000)
    ),
    Aim("speed else", "force-stop peak at other speeds", 15.0, "%"),
)


@dataclass(frozen=True)
class Stops:
    """Twenty stops at one speed and limit."""

    speed: float
    limit_g: float
    peak_g: float
    """The peak force, mean over the trials."""
    motion: tuple[np.ndarray, np.ndarray]
    """The angles and forces from before contact to the stop."""
    final: tuple[np.ndarray, np.ndarray]
    """The final angle and the peak force of each trial."""


def read(folder: Path) -> Recordings:
    """Return all recordings of stops, ``speed<N>_limit<N>g``."""
    found: dict[str, Any] = {}
    for path in sorted(folder.glob("*.csv.gz")):
        name = re.search(r"speed(\d+)_limit(\d+)g", stem(path))
        if name:
            found[stem(path)] = stops(table_of(path), float(name[1]), float(name[2]))
    return found


def stops(table: dict[str, np.ndarray], speed: float, limit_g: float) -> Stops:
    """Cut a recording into its trials."""
    stage = next(values for name, values in table.items() if name.startswith("stage"))
    angles, forces, finals, peaks = [], [], [], []
    for trial in np.unique(table["trial"]):
        own = (table["trial"] == trial) & (stage == 0)
        force, angle = table["force_g"][own], table["angle_raw"][own]
        over = np.flatnonzero(force > limit_g)
        until = over[0] + 1 if len(over) else len(force)
        near = angle[:until] < ANGLES[0]
        angles.append(angle[:until][near])
        forces.append(force[:until][near])
        peaks.append(force.max())
        finals.append((angle[-1], force.max()))
    motion = np.concatenate(angles), np.concatenate(forces)
    return Stops(speed, limit_g, float(np.mean(peaks)), motion, tuple(np.array(finals).T))


def contact(parameters: dict[str, Any], angle: np.ndarray) -> np.ndarray:
    """Return the force of the contact [g] at an angle."""
    return parameters["per_angle_g"] * softplus(parameters["touch_angle"] - angle, parameters["bend"])


def peak(parameters: dict[str, Any], speed: np.ndarray, limit_g: np.ndarray) -> np.ndarray:
    """Return the peak force [g] for arrays of speed and limit (registers) of one shape."""
    latency, yields, stall, share, back = (parameters[name] for name in NAMES)
    v = np.minimum(ANGLE_PER_S_PER_SPEED * np.atleast_1d(np.asarray(speed, float)), MAX_ANGLE_PER_S)[:, None]
    limit = np.broadcast_to(np.asarray(limit_g, float), v.shape[:1])[:, None]
    g = contact(parameters, ANGLES)
    free = 1.0 - np.minimum(g / stall, 1.0) ** 2
    moving = v * np.maximum(free, 1e-9) / (1.0 + g / (yields * v))
    t = np.cumsum((ANGLES[0] - ANGLES[1]) / moving, axis=1)
    detected = np.argmax(share * g > limit, axis=1)
    detected = np.where((share * g > limit).any(axis=1), detected, len(g) - 1)
    stop = t[np.arange(len(t)), detected] + latency
    last = np.argmax(g >= 0.995 * stall) if (g >= 0.995 * stall).any() else len(g) - 1
    k = np.minimum((t < stop[:, None]).sum(axis=1), last)
    given = np.minimum(back, 0.3 * latency * v[:, 0]) * (1.0 - g[k] / stall)
    return np.where(k == last, g[k], contact(parameters, ANGLES[k] + np.maximum(given, 0.0)))


def fit(recordings: Recordings) -> dict[str, Any]:
    """Return the parameters of the contact and of the motor."""
    every = list(recordings.values())
    slowest = min(each.speed for each in every)
    moving = [each.motion for each in every if each.speed == slowest]
    angle = np.concatenate([each[0] for each in (*moving, *(one.final for one in every))])
    force = np.concatenate([each[1] for each in (*moving, *(one.final for one in every))])
    sure = np.where(np.arange(len(angle)) < sum(len(each[0]) for each in moving), 0.3, 1.0)

    def named(p: np.ndarray) -> dict[str, float]:
        return {"per_angle_g": float(p[0]), "touch_angle": float(p[1]), "bend": abs(float(p[2])) + 0.1}

    law = least_squares(
        lambda p: sure * (contact(named(p), angle) - force) / (30.0 + 0.1 * np.abs(force)),
        [45.0, 680.0, 5.0],
        loss="soft_l1",
    )
    found = named(law.x)
    names = ("speed", "limit_g", "peak_g")
    speed, limit, measured = (np.array([getattr(each, name) for each in every]) for name in names)

    def apart(p: np.ndarray) -> np.ndarray:
        expected = peak(found | dict(zip(NAMES, np.exp(p))), speed, limit)
        return np.concatenate([np.log(np.maximum(expected, 1.0) / measured), PRIOR_WEIGHTS * (p - USUAL)])

    tries = [least_squares(apart, USUAL + away, diff_step=2e-2) for away in (0.0, [0.4, 0.3, 0.0, -0.2, 0.5])]
    best = min(tries, key=lambda one: one.cost)
    return found | {name: float(value) for name, value in zip(NAMES, np.exp(best.x))}


def errors(parameters: dict[str, Any], recordings: Recordings, known: Recordings | None = None) -> dict[str, Any]:
    """Return the errors of each recording's mean peak [%], by speed."""
    found: dict[str, list] = {}
    for each in recordings.values():
        expected = peak(parameters, np.array([each.speed]), np.array([each.limit_g]))[0]
        key = f"speed {each.speed:g}"
        found.setdefault(key if key in {aim.key for aim in AIMS} else "speed else", []).append(
            100 * (expected / each.peak_g - 1)
        )
    return {key: np.array(values) for key, values in found.items()}


def folds(recordings: Recordings) -> list[Fold]:
    """Return the folds that leave out each limit at all speeds."""
    limits = sorted({each.limit_g for each in recordings.values()})
    return [
        (
            [name for name, each in recordings.items() if each.limit_g != limit],
            [name for name, each in recordings.items() if each.limit_g == limit],
        )
        for limit in limits
    ]
