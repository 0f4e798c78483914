"""The field of dipoles, in closed form."""

import numpy as np

from tactemu.transducers.laws import MU0_OVER_4PI


def dipole_field(chips: np.ndarray, magnets: np.ndarray, moments: np.ndarray) -> np.ndarray:
    """Return the field [T] at ``chips`` (n, 3) [m] of dipoles at ``magnets`` (m, 3) [m], ``moments`` (m, 3) [A m²]::

        B = µ0/4π Σ (3 (m·r) r / |r|⁵ − m / |r|³)

    The result has shape ``(n, 3)`` and is valid from about a magnet's own size away.
    """
    arm = np.asarray(chips, float)[:, None] - np.asarray(magnets, float)[None]
    square = np.einsum("nmk,nmk->nm", arm, arm)
    along = np.einsum("nmk,mk->nm", arm, moments)
    near = square**-1.5
    return MU0_OVER_4PI * (3 * (along * near / square)[..., None] * arm - near[..., None] * moments).sum(axis=1)
