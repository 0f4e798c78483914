"""Piezoresistive transducers: a resistance that falls with pressure, in a divider, in rows and columns.

FlexiTac and Weiss use them. With the pressure ``p`` on a taxel, the warming ``T − T0``, and a fixed resistor ``Rf`` of
the divider::

    u = (p / half)^n exp(a (T − T0))          R = Rf / u, at most r_open
    V = u / (1 + u)                           as a share of the supply
    ghosts: V + g (mean of its row)(mean of its column) / (mean of all)
    reading = gain (1 + b (T − T0)) V + zero (T − T0), 0 below the threshold

Gain and zero each have a drift term. ``rated_n`` makes the reading a force along the normal that has this value where V
is 1, for devices whose counts are forces; otherwise the reading is the resistance in the divider [Ohm].
"""

# pyright: reportAssignmentType=false, reportGeneralTypeIssues=false

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import warp as wp

from firmware_protocols.bounds import Bounds
from tactemu.base.errors import SceneError
from tactemu.base.kernels import warp_kernel
from tactemu.base.options import number
from tactemu.base.units import Celsius, Newtons, NonNegative, PerKelvin, Positive, Share
from tactemu.plan.plan import Stage
from tactemu.plan.scalars import is_finite
from tactemu.transducers.pressure import TAKES, output_type, pressure_function, skin_arrays, skin_type
from tactemu.transducers.transducer import RESISTANCE, SignalType, Transducer, TransducerSite


@functools.cache
def divider_type(real):
    """Return the Warp struct of the dividers' parameters and outputs."""

    @wp.struct
    class Divider:
        half: real
        exponent: real
        rows: wp.int32
        cols: wp.int32
        ghost: real
        gain: real
        zero: real
        threshold: real
        rated: real
        fixed: real
        opened: real  # resistance of an unloaded taxel
        share: wp.array2d(dtype=real)  # output of each divider, as a share of the supply

    return Divider


@functools.cache
def share_kernel(real, vector: bool):
    """Return the kernel that computes the output of each divider, as a share of the supply."""
    pressure = pressure_function(real, vector)

    @warp_kernel
    def shares_of_supply(first_env: int, x: wp.array3d(dtype=real), skin: skin_type(real), divider: divider_type(real)):
        e, i = wp.tid()
        e += first_env
        p = pressure(x, skin, e, i)
        u = wp.pow(p / divider.half, divider.exponent)
        if p == real(0.0):
            u = real(0.0)
        divider.share[e, i] = wp.where(u > real(1.0e30), real(1.0), u / (real(1.0) + u))

    return shares_of_supply


@functools.cache
def readout_kernel(real, push: bool, ghosts: bool):
    """Return the kernel that computes readings from the dividers' outputs: resistances, or with ``push`` forces."""

    @warp_kernel
    def read_divider(first_env: int, skin: skin_type(real), divider: divider_type(real), out: wp.array3d(dtype=real)):
        e, i = wp.tid()
        e += first_env
        v = divider.share[e, i]
        if wp.static(ghosts):
            row = i // divider.cols
            col = i - row * divider.cols
            of_row = real(0.0)
            of_col = real(0.0)
            of_all = real(0.0)
            for c in range(divider.cols):
                of_row += divider.share[e, row * divider.cols + c]
            for other in range(divider.rows):
                of_col += divider.share[e, other * divider.cols + col]
            for k in range(divider.rows * divider.cols):
                of_all += divider.share[e, k]
            if of_all > real(0.0):
                v = v + divider.ghost * of_row * of_col / of_all
        v = divider.gain * v + divider.zero
        if v < divider.threshold:
            v = real(0.0)
        if wp.static(push):
            n = skin.normals[i]
            for axis in range(out.shape[2]):
                out[e, i, axis] = wp.where(out.shape[2] == 1, divider.rated * v, -divider.rated * v * n[axis])
        else:
            r = divider.opened
            if v >= real(1.0):
                r = real(0.0)
            elif v > real(0.0):
                r = wp.min(divider.fixed * (real(1.0) - v) / v, divider.opened)
            out[e, i, 0] = wp.where(is_finite(v), r, v)

    return read_divider


@dataclass(frozen=True, kw_only=True)
class Piezoresistive(Transducer):
    """A transducer that provides the resistance of each taxel [Ohm], or with ``rated_n`` a share of this force."""

    half: Positive = 5e4
    """Pressure at which the taxel's resistance is that of the divider [Pa]."""
    exponent: Positive = 1.5
    """Exponent n of resistance over pressure: R ∝ p^-n."""
    fixed: Positive = 1e4
    """Resistor of the divider [Ohm]."""
    r_open: Positive = 1e8
    """Resistance of an unloaded taxel [Ohm]."""
    rated_n: Newtons | None = None
    """Reading at full supply [N]; [Pa] with a model that provides pressure."""
    ghosts: Share = 0.0
    """Strength of the ghost at the fourth corner of three that are pressed; the layout must be a grid."""
    threshold: Share = 0.0
    """Share of the supply below which the reading is 0."""
    gain: NonNegative = 1.0
    """Gain of the read-out."""
    temperature: Celsius = 25.0
    """Temperature of the skin [degC]."""
    temperature_reference: Celsius = 25.0
    """Temperature at which the parameters hold [degC]."""
    half_per_k: PerKelvin = 0.0
    """Growth of u with warmth [1/K]."""
    gain_per_k: PerKelvin = 0.0
    """Growth of the gain with warmth [1/K]."""
    zero_per_k: PerKelvin = 0.0
    """Growth of the zero with warmth, as a share of the supply [1/K]."""

    takes = TAKES
    valid = "One resistor for each taxel. Ghosts come from three pressed corners of a rectangle, to first order."
    source = "Percolating composites: R ∝ p^-n. Velostat: n 1.57; Weiss DSA: 2 (docs/realism.md)."

    def check(self, where: str) -> None:
        warmed = self.half_per_k * (self.temperature - self.temperature_reference) / self.exponent
        number(where, "half_per_k times the warming over exponent", warmed, Annotated[float, Bounds(low=-50, high=50)])

    def gives(self, taken: SignalType) -> SignalType:
        return output_type(taken, RESISTANCE, self.rated_n)

    def compile(self, site: TransducerSite, x: wp.array, taken: SignalType) -> tuple[wp.array, Sequence[Stage]]:
        context, real = site.context, site.context.real
        if self.ghosts and len(site.layout) != 2:
            raise SceneError(f"sensor {site.name!r}: ghosts need taxels in rows and columns, got {site.layout}")
        skin, divider = skin_arrays(site), divider_type(real)()
        divider.share = wp.zeros((context.n_envs, len(site.positions)), dtype=real, device=context.device)
        warm = self.temperature - self.temperature_reference
        divider.half = self.half * 2.718281828459045 ** (-self.half_per_k * warm / self.exponent)
        divider.exponent, divider.ghost, divider.threshold = self.exponent, self.ghosts, self.threshold
        divider.rows, divider.cols = site.layout if len(site.layout) == 2 else (1, len(site.positions))
        divider.gain, divider.zero = self.gain * (1.0 + self.gain_per_k * warm), self.zero_per_k * warm
        divider.rated, divider.fixed, divider.opened = self.rated_n or 0.0, self.fixed, self.r_open
        kind, shape = self.gives(taken), divider.share.shape
        divide = context.record(share_kernel(real, taken.vector), shape, [x, skin, divider], [])
        out = site.zeros(kind.n_channels)
        kernel = readout_kernel(real, self.rated_n is not None, bool(self.ghosts))
        launch = context.record(kernel, shape, [skin, divider], [out])
        return out, [
            Stage(name=f"{site.name}: resistors", reason="resistance falls with pressure", launch=divide),
            Stage(name=f"{site.name}: divider", reason=kind.quantity, launch=launch),
        ]
