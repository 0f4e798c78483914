"""A transducer from a taxel's force to the field at its magnetometer, for skins of magnetised elastomer.

A force on the skin moves the magnets above a chip, and the field at the chip changes. The model here is the simplest
that has the right channels: per taxel and axis one gain and one offset,

    B = offset + gain * F        B, offset [uT], F [N] and gain [uT/N], all in the taxel's own frame (z = normal)

The model has no cross-talk between axes or chips and does not saturate (the ADC does).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class LinearMagnet:
    """The law ``B = offset + gain * F`` per taxel and axis.

    ``gain`` [uT/N] and ``offset`` [uT] have shape ``(3,)`` or ``(n_taxels, 3)``. With a positive gain along z, a push
    (negative force along the normal) lowers Bz.
    """

    gain: np.ndarray | tuple[float, float, float]
    offset: np.ndarray | tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __call__(self, force: np.ndarray) -> np.ndarray:
        """Return the field [uT] at each chip, shape ``(n_taxels, 3)``, under ``force`` [N] of that shape."""
        return np.asarray(self.offset, float) + np.asarray(self.gain, float) * force
