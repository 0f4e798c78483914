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
from tactemu.base.options import number
from tactemu.base.units import Celsius, Newtons, NonNegative, PerKelvin, Positive, Share
from tactemu.plan.plan import Stage
from tactemu.plan.scalars import is_finite
from tactemu.transducers.pressure import TAKES, output_type, pressure_function, skin_arrays
from tactemu.transducers.transducer import RESISTANCE, SignalType, Transducer, TransducerSite


@functools.cache
def share_kernel(real, vector: bool):
    """Return the kernel that computes the output of each divider, as a share of the supply."""
    vec3 = wp.types.vector(3, real)
    pressure = pressure_function(real, vector)

    @wp.kernel(module="unique", enable_backward=False)
    def shares_of_supply(
        first_env: int,
        x: wp.array3d(dtype=real),
        normals: wp.array(dtype=vec3),
        areas: wp.array(dtype=real),
        half: real,
        exponent: real,
        # outputs
        share: wp.array2d(dtype=real),
    ):
        e, i = wp.tid()
        e += first_env
        p = pressure(x, normals, areas, e, i)
        u = wp.pow(p / half, exponent)
        if p == real(0.0):
            u = real(0.0)
        share[e, i] = wp.where(u > real(1.0e30), real(1.0), u / (real(1.0) + u))

    return shares_of_supply


@functools.cache
def readout_kernel(real, push: bool, ghosts: bool):
    """Return the kernel that computes readings from the dividers' outputs: resistances, or with ``push`` forces."""
    vec3 = wp.types.vector(3, real)

    @wp.kernel(module="unique", enable_backward=False)
    def read_divider(
        first_env: int,
        share: wp.array2d(dtype=real),
        normals: wp.array(dtype=vec3),
        rows: int,
        cols: int,
        ghost: real,
        gain: real,
        zero: real,
        threshold: real,
        rated: real,
        fixed: real,
        opened: real,
        # outputs
        out: wp.array3d(dtype=real),
    ):
        e, i = wp.tid()
        e += first_env
        v = share[e, i]
        if wp.static(ghosts):
            row = i // cols
            col = i - row * cols
            of_row = real(0.0)
            of_col = real(0.0)
            of_all = real(0.0)
            for c in range(cols):
                of_row += share[e, row * cols + c]
            for other in range(rows):
                of_col += share[e, other * cols + col]
            for k in range(rows * cols):
                of_all += share[e, k]
            if of_all > real(0.0):
                v = v + ghost * of_row * of_col / of_all
        v = gain * v + zero
        if v < threshold:
            v = real(0.0)
        if wp.static(push):
            n = normals[i]
            for axis in range(out.shape[2]):
                out[e, i, axis] = wp.where(out.shape[2] == 1, rated * v, -rated * v * n[axis])
        else:
            r = opened
            if v >= real(1.0):
                r = real(0.0)
            elif v > real(0.0):
                r = wp.min(fixed * (real(1.0) - v) / v, opened)
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
        rows, cols = site.layout if len(site.layout) == 2 else (1, len(site.positions))
        normals, areas = skin_arrays(site)
        share = wp.zeros((context.n_envs, len(site.positions)), dtype=real, device=context.device)
        warm = self.temperature - self.temperature_reference
        half = self.half * 2.718281828459045 ** (-self.half_per_k * warm / self.exponent)
        inputs = [x, normals, areas, half, self.exponent]
        divide = context.record(share_kernel(real, taken.vector), share.shape, inputs, [share])
        kind = self.gives(taken)
        out = site.zeros(kind.n_channels)
        inputs = [
            share, normals, rows, cols, self.ghosts, self.gain * (1.0 + self.gain_per_k * warm),
            self.zero_per_k * warm, self.threshold, self.rated_n or 0.0, self.fixed, self.r_open,
        ]  # fmt: skip
        kernel = readout_kernel(real, self.rated_n is not None, bool(self.ghosts))
        launch = context.record(kernel, share.shape, inputs, [out])
        return out, [
            Stage(name=f"{site.name}: resistors", reason="resistance falls with pressure", launch=divide),
            Stage(name=f"{site.name}: divider", reason=kind.quantity, launch=launch),
        ]
