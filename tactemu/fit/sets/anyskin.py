"""AnySkin on a LEAP hand: magnetometers with nothing touching, at rest and while fingers move.

A recording is an :class:`Untouched`. At rest the field of a channel is white noise and a bounded random walk::

    std = sqrt(white² + slow²)       correlation after k rows = slow²/(white² + slow²) exp(−k/τ)

While fingers move, a skin's baseline follows pose and neighbours; std and correlation describe how much.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactemu.fit.sets.aims import Aim, Constant, Recordings

AIMS: tuple[Aim, ...] = ()
CONSTANTS = (
    Constant("std still", "noise std, mean over channels, skins at rest", "µT"),
    Constant("correlation still", "lag-1 correlation, mean over channels, skins at rest"),
    Constant("std moving", "noise std, fingers that move with nothing touching", "µT"),
    Constant("correlation moving", "lag-1 correlation, fingers that move with nothing touching"),
)


@dataclass(frozen=True)
class Untouched:
    """The noise of a recording without touch, by axis."""

    condition: str
    """``still``: two skins at rest; ``moving``: four, of which two move; ``else``: two that move, not evaluated."""
    white: np.ndarray
    """White noise: std of the difference / √2 [µT], x, y and z."""
    std: np.ndarray
    """Std of the field [µT], x, y and z."""
    correlation: float
    """The correlation after one row, mean over the channels."""
    later: float
    """The correlation after twenty rows."""


def read(folder: Path) -> Recordings:
    """Return the recordings without touch."""
    return {path.stem: untouched(np.load(path)) for path in sorted(folder.glob("*.npz"))}


def untouched(archive: Any) -> Untouched:
    """Return the noise of a recording."""
    field = archive["b_minus_baseline"].astype(float)
    x = field - field.mean(axis=0)

    def after(k: int) -> float:
        return float(((x[k:] * x[:-k]).mean(axis=0) / x.var(axis=0)).mean())

    white = (np.diff(field, axis=0).std(axis=0) / np.sqrt(2)).reshape(-1, 3).mean(axis=0)
    std = x.std(axis=0).reshape(-1, 3).mean(axis=0)
    condition = "moving" if field.shape[1] > 30 else "still" if after(1) < 0.6 else "else"
    return Untouched(condition, white, std, after(1), after(20))


def fit(recordings: Recordings) -> dict[str, Any]:
    """Return the noise of each condition."""
    found = {}
    for condition in ("still", "moving"):
        several = [each for each in recordings.values() if each.condition == condition]
        if several:
            std = np.mean([each.std for each in several], axis=0)
            correlation = float(np.mean([each.correlation for each in several]))
            later = float(np.mean([each.later for each in several]))
            tau = 19.0 / np.log(correlation / later) if 0 < later < correlation else 1e3
            found[condition] = {
                "std_ut": std.tolist(),
                "correlation": correlation,
                "slow_tau_rows": float(tau),
                "white_ut": (std * np.sqrt(1 - correlation)).tolist(),
                "slow_ut": (std * np.sqrt(correlation)).tolist(),
            }
    return found


def constants(recordings: Recordings) -> dict[str, list[float]]:
    """Return the noise and the correlation of each recording of a condition."""
    found: dict[str, list[float]] = {}
    for each in recordings.values():
        found.setdefault(f"std {each.condition}", []).append(float(each.std.mean()))
        found.setdefault(f"correlation {each.condition}", []).append(each.correlation)
    return found
