"""Dilation of an elastomer: the weights of a marker's motion when its neighbours are pressed, in float64 on the host.

A taxel at offset ``o`` (in the tangent plane of the target, length ``rho``) from a taxel pressed by ``h`` moves by
``h w(rho) o`` in the plane. Three weights exist, and a blend of the first with one of the others:

=========  ====================================  ===========================================================
name       w(rho)                                used for
=========  ====================================  ===========================================================
Gaussian   exp(-lambda_d rho^2)                  ``compressibility`` 1: the bulge stays local
global     1 / (rho^2 + eps^2)                   ``compressibility`` 0: volume is kept, the motion reaches far
layer      inverse transform of S(|k| H) / |k|   like global, with ``elastomer_thickness`` H > 0
=========  ====================================  ===========================================================

``S(q) = 2 q^2 / (sinh 2q - 2q)`` is the surface response of an incompressible layer bonded to a rigid back, indented by
a given shape. The normal motion is always ``h^n exp(-lambda_d rho^2)``.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import warp as wp


class DilationArrays(NamedTuple):
    """The arrays of a dilation on the device."""

    depth: wp.array
    """Depth of each taxel [m], shape ``(n_envs, n_taxels)``; 0 where not pressed."""
    power: wp.array
    """``depth ** normal_exponent``, same shape."""
    is_sensing: wp.array
    """False for fillers, bool, shape ``(n_taxels,)``."""
    motion: wp.array
    """The output: motion of the markers, link frame, vec3, shape ``(n_envs, n_taxels)``."""


@dataclass(frozen=True, kw_only=True)
class DilationOptions:
    """The options that decide the shape of the weights. Units are SI."""

    lambda_d: float = 700.0
    """Fall-off of the Gaussian [1/m^2]."""
    compressibility: float = 1.0
    """1: Gaussian, 0: global, between: a mixture of both, each divided by its peak of ``rho w``."""
    elastomer_thickness: float = 0.0
    """Thickness H of the layer [m]; 0: unknown, the global weight with the taxel spacing for ``eps``."""
    area_weighted: bool = False
    """Weight each taxel by its area, so that sums do not depend on the pitch."""

    @property
    def uses_layer(self) -> bool:
        """Is the layer weight used?"""
        return self.compressibility < 1.0 and self.elastomer_thickness > 0.0


def layer_response(q: np.ndarray) -> np.ndarray:
    """Return ``S(q) = 2 q^2 / (sinh 2q - 2q)`` for any ``q > 0``, without overflow or loss of digits.

    Below 0.35 the denominator is its series; above, numerator and denominator are multiplied by ``2 exp(-2q)``.
    """
    q = np.asarray(q, dtype=np.float64)
    small = q < 0.35
    x2 = np.square(2.0 * np.where(small, q, 0.0))
    series = 1.0 + x2 / 20.0 * (1.0 + x2 / 42.0 * (1.0 + x2 / 72.0 * (1.0 + x2 / 110.0 * (1.0 + x2 / 156.0))))
    p = np.where(small, 1.0, np.minimum(q, 400.0))  # S(400) is 0 in float64
    decay = np.exp(-2.0 * p)
    large = 4.0 * p * p * decay / (1.0 - decay * decay - 4.0 * p * decay)
    return np.where(small, 1.5 / (np.where(small & (q > 0), q, np.inf) * series), large)


def spectral_layer(shape: tuple[int, int], spacing: tuple[float, float], thickness: float) -> np.ndarray:
    """Return the layer weight times the offset on a periodic box, planes (u, v), shape ``(2, *shape)``, offset 0 at
    index 0.

    ``q`` is limited to [1e-3, 30] as in Genesis, which keeps the result finite for a vanishing thickness.
    """
    (ny, nx), (du, dv) = shape, spacing
    ky, kx = np.meshgrid(2 * np.pi * np.fft.fftfreq(ny, dv), 2 * np.pi * np.fft.rfftfreq(nx, du), indexing="ij")
    k = np.hypot(kx, ky)
    gain = np.where(k > 0, layer_response(np.clip(k * thickness, 1e-3, 30.0)), 0.0) / np.where(k > 0, k, 1.0)
    return np.stack([np.fft.irfft2(-1j * kx * gain, s=shape), np.fft.irfft2(-1j * ky * gain, s=shape)])


def _bessel_j1(x: np.ndarray) -> np.ndarray:
    """Return the Bessel function J1 from its integral over a period; the trapezoid rule converges faster than any
    power."""
    points = int(np.max(np.abs(x), initial=0.0)) + 40
    angle = np.pi * (np.arange(points) + 0.5) / points
    return np.cos(angle - x[..., None] * np.sin(angle)).mean(axis=-1)


_NEAR = 14.0
"""Distance in thicknesses beyond which the layer's weight equals its far field."""


@functools.cache
def _near_field() -> np.polynomial.Chebyshev:
    """Return the difference of the layer's weight from its far field, by distance in thicknesses up to ``_NEAR``."""
    node, weight = np.polynomial.legendre.leggauss(200)
    x, weight = 11.0 * (node + 1.0), 11.0 * weight
    remainder = weight * (x * layer_response(x) - 1.5 * np.exp(-x * x))
    return np.polynomial.Chebyshev.interpolate(
        lambda r: _bessel_j1(r[:, None] * x) @ remainder, 80, domain=[0.0, _NEAR]
    )


def radial_layer(rho: np.ndarray, thickness: float) -> np.ndarray:
    """Return the layer weight in an unbounded plane, times ``rho``, per area of the pressed taxel [1/m^2].

    It is ``1/(2 pi H^2) int x S(x) J1(x rho/H) dx``. The part ``1.5 exp(-x^2)`` of ``x S(x)``, which makes the far
    field ``3/(4 pi H rho)``, is integrated in closed form; the remainder falls off exponentially with ``rho``.
    """
    r = np.asarray(rho, dtype=np.float64) / thickness
    safe = np.where(r > 0, r, 1.0)
    far = np.where(r > 0, -1.5 * np.expm1(-0.25 * r * r) / safe, 0.0)
    near = np.where(r < _NEAR, _near_field()(np.minimum(r, _NEAR)), 0.0)
    return (far + near) / (2.0 * np.pi * thickness * thickness)


@dataclass(frozen=True)
class RadialWeight:
    """The weight ``w(rho)`` of one sensor where it has a closed form or a radial table: used by the direct sums."""

    gaussian: float
    """Factor of ``exp(-lambda_d rho^2)``."""
    far: float
    """Factor of ``1 / (rho^2 + eps^2)``."""
    eps: float
    """Length in the global weight [m]."""
    table: np.ndarray | None = None
    """Values of ``w`` at ``rho = i * table_step``, used instead of the global weight (layer, area-weighted)."""
    table_step: float = 1.0


def gaussian_peak(lambda_d: float) -> float:
    """Return the largest ``rho exp(-lambda_d rho^2)``; infinite for ``lambda_d`` 0, where a blend keeps only its global
    part."""
    return math.exp(-0.5) / math.sqrt(2.0 * lambda_d) if lambda_d > 0 else math.inf


def blend(compressibility: float, local_peak: float, far_peak: float) -> tuple[float, float]:
    """Return the factors (Gaussian, global): 1 and 0 at the ends, each divided by its peak between them."""
    if compressibility >= 1.0:
        return 1.0, 0.0
    if compressibility <= 0.0:
        return 0.0, 1.0
    return compressibility / local_peak, (1.0 - compressibility) / far_peak


def _radial_table(thickness: float, reach: float) -> tuple[np.ndarray, float]:
    """Return ``w`` of the unbounded layer from 0 to ``reach``, and its step, fine enough that linear interpolation
    keeps 1e-6 of the peak."""
    step = max(min(thickness / 400.0, reach / 64.0), reach / 200_000.0)
    rho = step * np.arange(int(reach / step) + 3)
    weight = np.zeros_like(rho)
    weight[1:] = np.concatenate(
        [radial_layer(part, thickness) for part in np.array_split(rho[1:], len(rho) // 512 + 1)]
    )
    weight[1:] /= rho[1:]
    weight[0] = weight[1]
    return weight, step


def radial_weight(options: DilationOptions, eps: float, reach: float) -> RadialWeight:
    """Return the weight for taxels in any layout.

    Args:
        eps: taxel spacing [m], the length of the global weight when the thickness is 0.
        reach: largest distance between two taxels [m].
    """
    eps = options.elastomer_thickness if options.elastomer_thickness > 0 else eps
    table, step = None, 1.0
    far_peak = 1.0 / (2.0 * eps)
    if options.area_weighted and options.uses_layer:
        table, step = _radial_table(options.elastomer_thickness, reach)
        far_peak = float(np.max(table * step * np.arange(len(table))))
    gaussian, far = blend(options.compressibility, gaussian_peak(options.lambda_d), far_peak)
    return RadialWeight(gaussian, far, eps, table, step)
