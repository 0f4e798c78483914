"""The response of an elastic layer's surface to loads: its transfer functions, and the kernels sampled from them.

The layer has thickness ``h``, shear modulus ``G`` and Poisson ratio ``nu``; it is bonded to a rigid base and has no
edges. A load that varies as ``exp(i k.x)`` moves its surface by ``compliance * load``. With ``q = |k| h`` and ``K = 3 -
4 nu`` the compliances follow from the Papkovich-Neuber solution of the layer (Johnson, *Contact Mechanics*, 5.8; the
tests compare them with 50-digit arithmetic and finite elements):

====  ===========================================  ==================================================================
name  moves                                        ``G k compliance``, with ``D = K cosh 2q + 2 q^2 + (1 + K^2) / 2``
====  ===========================================  ==================================================================
nn    normal (into the skin) by pressure           ``(1 - nu) (K sinh 2q - 2q) / D``
ll    tangential, along k, by traction along k     ``(1 - nu) (K sinh 2q + 2q) / D``
tt    tangential, across k, by traction across k   ``tanh q``
nl    tangential, along k, by pressure (times i)   ``((1 - 2 nu) K (cosh 2q - 1) - 2 q^2) / (2 D)``
====  ===========================================  ==================================================================

They are evaluated with ``exp(-2q)`` factored out, so that no thickness and no wave number overflows, and with a series
where ``sinh 2q`` and ``2q`` would cancel. ``h = inf`` is the half-space.

Sampled on a grid, a load is taken as band-limited: the kernel at offset ``x`` is the Fourier integral of the compliance
over the band ``|kx| <= pi/dx, |ky| <= pi/dy``. The integral is a quadrature, not a sum over a periodic box: the layer
has no images of the load, whatever its thickness.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tactemu.sensors.layer.soft_object import add_object, ball_kernel

SERIES_BELOW = 0.35
"""Value of q below which differences that cancel are computed from their Taylor series."""


class Transfer(NamedTuple):
    """The products ``G k compliance`` of the four modes, dimensionless, finite for every q from 0 to infinity."""

    nn: np.ndarray
    ll: np.ndarray
    tt: np.ndarray
    nl: np.ndarray


def transfer(q, nu: float, dtype=np.float64) -> Transfer:
    """Return the scaled transfer functions.

    Args:
        q: wave number times thickness, any shape, 0 to infinity.
        nu: Poisson ratio, 0 to 0.5.
        dtype: float type to compute in; float32 keeps 6 digits everywhere.
    """
    one, two, four = dtype(1), dtype(2), dtype(4)
    q, nu = np.asarray(q, dtype), dtype(nu)
    stiff = dtype(3) - four * nu
    q = np.minimum(q, dtype(1e4))  # all functions have reached their limits; inf * exp(-inf) is avoided
    decay = np.exp(-two * q)
    decay2 = decay * decay
    bottom = stiff * (one + decay2) + (four * q * q + one + stiff * stiff) * decay

    small = q < dtype(SERIES_BELOW)
    x = np.where(small, two * q, one)
    sinh_less_x = _sinh_minus_argument(x, dtype)
    near = two * decay * (stiff * sinh_less_x + two * (one - two * nu) * x)
    nn = np.where(small, near, stiff * (one - decay2) - four * q * decay)
    ll = -stiff * np.expm1(-four * q) + four * q * decay
    cosh_less_1 = np.where(small, four * decay * np.sinh(np.where(small, q, one)) ** 2, (one - decay) ** 2)
    nl = (one - two * nu) * stiff * cosh_less_1 - four * q * q * decay
    return Transfer((one - nu) * nn / bottom, (one - nu) * ll / bottom, np.tanh(q), nl / (two * bottom))


def _sinh_minus_argument(x: np.ndarray, dtype) -> np.ndarray:
    """Return ``sinh x - x`` by five terms of its series, exact to rounding for x < 0.7."""
    y = x * x
    total = np.ones_like(x)
    for divisor in (110, 72, 42, 20):
        total = dtype(1) + y / dtype(divisor) * total
    return x * y / dtype(6) * total


class Kernels(NamedTuple):
    """The displacements of a cell per pressure on the cell ``(j, i)`` cells away [m/Pa], each of shape ``(ny, nx)``.

    Only offsets >= 0 are kept: ``nn``, ``xx`` and ``yy`` are even in both offsets, ``xy`` is odd in both, ``nx`` (the
    x displacement by pressure) is odd in x and even in y, ``ny`` the other way round.
    """

    nn: np.ndarray
    xx: np.ndarray
    yy: np.ndarray
    xy: np.ndarray
    nx: np.ndarray
    ny: np.ndarray


def sample_kernels(
    shape, pitch, shear_modulus, nu, thickness, object_ratio=0.0, object_nu=0.5, object_radius=np.inf
) -> Kernels:
    """Return the six kernels of a layer on a grid.

    Args:
        shape: number of offsets ``(ny, nx)``, from 0.
        pitch: distance of neighbours ``(dy, dx)`` [m].
        shear_modulus: shear modulus [Pa].
        nu: Poisson ratio, 0 to 0.5.
        thickness: thickness [m], > 0; ``inf`` for a half-space.
        object_ratio: shear modulus over that of the object that presses; 0: a rigid one.
        object_nu: Poisson ratio of the object, 0 to 0.5.
        object_radius: radius of the object [m], a ball; ``inf`` for a half-space.
    """
    (ny, nx), (dy, dx) = shape, pitch
    (ay, wy), (ax, wx) = _band_nodes(ny), _band_nodes(nx)
    ky, kx = (ay / dy)[:, None], (ax / dx)[None, :]
    k = np.hypot(kx, ky)
    modes = add_object(transfer(k * thickness, nu), object_ratio, object_nu)
    weight = wy[:, None] * wx[None, :] / (np.pi**2 * dy * dx * shear_modulus * k)  # d2k / (2 pi)^2, four quadrants
    weight = weight * (dy * dx)  # a pressure acts on a cell
    ex, ey = kx / k, ky / k
    cos_y, sin_y = np.cos(np.outer(np.arange(ny), ay)), np.sin(np.outer(np.arange(ny), ay))
    cos_x, sin_x = np.cos(np.outer(ax, np.arange(nx))), np.sin(np.outer(ax, np.arange(nx)))
    ll, tt, nl = modes.ll * weight, modes.tt * weight, modes.nl * weight
    nn = cos_y @ (modes.nn * weight) @ cos_x
    if object_ratio and np.isfinite(object_radius):
        nn += ball_kernel(shape, pitch, shear_modulus / object_ratio, object_nu, object_radius)
    return Kernels(
        nn=nn,
        xx=cos_y @ (ll * ex**2 + tt * ey**2) @ cos_x,
        yy=cos_y @ (ll * ey**2 + tt * ex**2) @ cos_x,
        xy=-sin_y @ ((ll - tt) * ex * ey) @ sin_x,
        nx=-cos_y @ (nl * ex) @ sin_x,
        ny=-sin_y @ (nl * ey) @ cos_x,
    )


def _band_nodes(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the Gauss nodes and weights over (0, pi) for cosines up to ``count`` periods and a singularity 1/k at 0.

    Uniform panels follow the oscillation; the first one is halved towards 0 until the remainder is below 1e-9.
    """
    panels = max(count // 2, 4)
    width = np.pi / panels
    edges = np.concatenate([[0.0], width * 0.5 ** np.arange(30, 0, -1), width * np.arange(1, panels + 1)])
    x, w = np.polynomial.legendre.leggauss(8)
    half = np.diff(edges)[:, None] / 2
    return (edges[:-1, None] + half * (1 + x)).ravel(), (half * w).ravel()


def spectrum(kernel: np.ndarray, shape: tuple[int, int], odd: tuple[bool, bool]) -> np.ndarray:
    """Return the factors that convolve with a kernel in the space of the Hartley transform of length ``shape``.

    Args:
        kernel: values at offsets >= 0, at least half of ``shape`` of them along each axis.
        shape: lengths ``(n_rows, n_columns)`` of the transform, even. Offsets up to half of them are not wrapped.
        odd: True where the kernel changes sign with the offset, along rows and along columns.
    """
    index, sign = zip(*(_wrapped_offsets(n, is_odd) for n, is_odd in zip(shape, odd)))
    wrapped = kernel[np.ix_(*index)] * sign[0][:, None] * sign[1][None, :]
    factors = np.fft.fft2(wrapped)
    if odd == (False, False):
        return factors.real
    return -factors.real if odd == (True, True) else -factors.imag


def _wrapped_offsets(n: int, odd: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the offset >= 0 at each place of a circular kernel of length ``n``, and its sign."""
    place = np.arange(n)
    sign = np.where(place <= n // 2, 1.0, -1.0)
    if not odd:
        return np.minimum(place, n - place), np.ones(n)
    sign[n // 2] = 0.0  # the offset n/2 is its own opposite
    return np.minimum(place, n - place), sign
