"""The compliance of a soft object, which contact adds to that of the skin.

The same pressures and tractions load skin and object, the other way round. Contact is about the motion of the skin
relative to the object, so that compliances add; pressure draws both surfaces towards the load, so that of ``nl`` they
are subtracted. With shear modulus ``G`` and Poisson ratio ``nu`` of the object, a half-space, for the wave number ``k``
(names as in :mod:`.compliance`)::

    nn + (1 - nu) / (G k)    ll + (1 - nu) / (G k)    tt + 1 / (G k)    nl - (1 - 2 nu) / (2 G k)

A ball of radius ``R`` is stiffer than a half-space, as there is less of it far from the load. A force at the distance
``s = 2 R sin(t / 2)`` moves its surface by a sum over Legendre's polynomials, from Lur'e's solution for a ball under
``p_n P_n(cos t)``; the half-space has ``c_n = 4 (1 - nu) / (2 n + 1)``::

    1 / (8 pi G R) sum_n (2 n + 1) c_n P_n(cos t)
    c_n = (2 (1 - nu) n^2 + nu n - 1 + 2 nu) / ((n - 1) (n^2 + n + 1 + nu (2 n + 1)))        n = 0 and n > 1
    c_1 = 0.6 (1 - 2 nu) / (1 + nu)

``c_1`` is that of a ball whose weight or inertia balances the force; displacements are relative to its mean one. The
difference to the half-space is added to the kernel of pressure alone.
"""

from __future__ import annotations

import numpy as np

TERMS = 400
"""Number of terms that are summed; what they leave is below 1e-4 of the first ones."""
DISTANCES = 513
"""Number of distances for which they are summed; between them the difference is interpolated."""


def add_object(modes, shear_ratio: float, nu: float):
    """Return the transfer functions of the skin's motion relative to that of a soft half-space.

    Args:
        modes: transfer functions of the skin alone, a :class:`~.compliance.Transfer`.
        shear_ratio: shear modulus of the skin over that of the object; 0: the object is rigid.
        nu: Poisson ratio of the object, 0 to 0.5.
    """
    if not shear_ratio:
        return modes
    normal, pull = shear_ratio * (1 - nu), shear_ratio * (1 - 2 * nu) / 2
    return type(modes)(modes.nn + normal, modes.ll + normal, modes.tt + shear_ratio, modes.nl - pull)


def ball_kernel(shape, pitch, shear_modulus: float, nu: float, radius: float) -> np.ndarray:
    """Return the motion of a ball's surface less that of a half-space, per pressure on a cell [m/Pa].

    Args:
        shape: number of offsets ``(ny, nx)``, from 0.
        pitch: distance of neighbours ``(dy, dx)`` [m].
        shear_modulus: shear modulus of the ball [Pa].
        nu: its Poisson ratio, 0 to 0.5.
        radius: its radius [m]; at its diameter and beyond the value at its far side is taken.
    """
    (ny, nx), (dy, dx) = shape, pitch
    distance = np.hypot(np.arange(ny)[:, None] * dy, np.arange(nx)[None, :] * dx)
    sub = (np.arange(64) - 31.5) / 64  # the load's own cell has the mean distance, of which logarithms are taken
    distance[0, 0] = np.exp(np.mean(np.log(np.hypot(sub[:, None] * dy, sub[None, :] * dx))))
    half = np.minimum(distance / (2 * radius), 1.0)  # sin(t / 2)
    slope, smooth = _series(nu)
    nodes = np.linspace(0, 1, DISTANCES)
    total = np.interp(half, nodes, smooth) - slope * np.log(half * (1 + half))
    return total * dy * dx / (8 * np.pi * shear_modulus * radius)


def _series(nu: float) -> tuple[float, np.ndarray]:
    """Return the factor ``a`` of a logarithm, and a smooth remainder at :data:`DISTANCES` values of ``h = sin(t / 2)``.

    The sum is ``a sum_n P_n / n`` and a remainder that converges; the first is ``-a log(h (1 + h))``.
    """
    n = np.arange(TERMS, dtype=float)
    bottom = (n - 1) * (n * n + n + 1 + nu * (2 * n + 1))
    bottom[1] = 1.0
    c = (2 * (1 - nu) * n * n + nu * n - 1 + 2 * nu) / bottom
    c[1] = 0.6 * (1 - 2 * nu) / (1 + nu)
    terms = (2 * n + 1) * c - 4 * (1 - nu)
    slope = 2 * (1 - 2 * nu) ** 2
    terms[1:] -= slope / n[1:]
    cosine = 1 - 2 * np.linspace(0, 1, DISTANCES) ** 2
    return slope, np.polynomial.legendre.legval(cosine, terms)
