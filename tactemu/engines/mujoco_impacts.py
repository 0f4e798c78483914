"""The time for which two geoms of a MuJoCo model touch in an impact, and the note on steps that are too long for it.

A contact of MuJoCo is a spring and a damper per mass, by ``solref``: with the natural frequency ``w`` [rad/s] and the
damping ratio ``z`` the force of an impact ends after ``(pi - 2 asin z) / (w sqrt(1 - z^2))``, whatever the masses and
the speed. ``w = 1 / (timeconst dampratio)``, or, where ``solref`` is negative, the root of its stiffness.
"""

# MuJoCo's functions come from a compiled module that a checker cannot see into.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from tactemu.engines.mujoco_source import load_mujoco

STEPS_PER_IMPACT = 10
"""Number of steps in an impact from which on its course is resolved."""
MATCH_REASON = "normal forces sum up to those of MuJoCo's contacts"


def impact_s(model: Any, first: int, second: int) -> float:
    """Return the duration of an impact of two geoms [s], or infinity where no contact ends by itself."""
    mujoco = load_mujoco()
    time_constant, ratio = (float(value) for value in _solref(model, first, second))
    if time_constant > 0:
        if not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_REFSAFE:
            time_constant = max(time_constant, 2 * model.opt.timestep)
        frequency = 1 / (time_constant * max(ratio, 1e-9))
    else:
        frequency = math.sqrt(max(-time_constant, 1e-9))
        ratio = -ratio / (2 * frequency)
    if ratio < 1 - 1e-6:
        return (math.pi - 2 * math.asin(max(ratio, 0.0))) / (frequency * math.sqrt(1 - ratio**2))
    if ratio < 1 + 1e-6:
        return 2 / frequency
    return 2 * math.acosh(ratio) / (frequency * math.sqrt(ratio**2 - 1))


def _solref(model: Any, first: int, second: int) -> np.ndarray:
    """Return ``solref`` of a contact of two geoms: the override, else that of the prior geom, else a mean by weight."""
    if model.opt.enableflags & load_mujoco().mjtEnableBit.mjENBL_OVERRIDE:
        return model.opt.o_solref
    one, other = model.geom_solref[first], model.geom_solref[second]
    priorities = model.geom_priority[first], model.geom_priority[second]
    if priorities[0] != priorities[1]:
        return one if priorities[0] > priorities[1] else other
    weights = float(model.geom_solmix[first]), float(model.geom_solmix[second])
    share = weights[0] / sum(weights) if sum(weights) > 0 else 0.5
    if one[0] > 0 and other[0] > 0:
        return share * one + (1 - share) * other
    return np.minimum(one, other)


def match_reason(model: Any, geoms: np.ndarray, may_touch: Callable[[int, int], bool], dt: float) -> str:
    """Return why a skin's forces are matched with MuJoCo's, with a note if steps are too long for an impact.

    Args:
        model: an ``mujoco.MjModel``.
        geoms: a mask of the geoms that move with the skin.
        may_touch: says whether two geoms may touch.
        dt: step of the scene [s].
    """
    pairs = [
        (impact_s(model, int(own), int(other)), int(other))
        for own in np.flatnonzero(geoms)
        for other in np.flatnonzero(~geoms)
        if may_touch(int(own), int(other))
    ]
    if not pairs or STEPS_PER_IMPACT * dt <= min(pairs)[0] * (1 + 1e-9):
        return MATCH_REASON
    shortest, geom = min(pairs)
    return (
        f"{MATCH_REASON}; an impact of geom {model.geom(geom).name or geom!r} lasts {shortest * 1e3:.2g} ms: at steps "
        f"of {dt * 1e3:g} ms its course and its peak are not resolved; "
        f"take dt <= {shortest / STEPS_PER_IMPACT * 1e3:.2g} ms"
    )
