"""Capacitive transducers: a gap that closes under pressure (iCub, CySkin).

With the pressure ``p`` on a taxel of area ``A``, a gap ``g0`` and a spacer of modulus ``E``::

    g = g0 (1 − s),  s = p/E / (1 + p/E)             it stiffens as it closes, and never closes fully
    C = stray + ε0 εr A / g
    reading: C − (baseline − C0)                     where the firmware follows a baseline, with a time constant

Below the dead band the gap does not move. A firmware that follows the baseline removes drift, and also a press that
lasts. ``rated_n`` makes the reading a force along the normal: it has this value where the gap is half closed, where
ε0 εr A/g has doubled.
"""

# pyright: reportAssignmentType=false, reportGeneralTypeIssues=false

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.base.units import Length, Newtons, NonNegative, Pascals, Positive, TimeConstant
from tactemu.plan.clearing import clear_rows
from tactemu.plan.clock import Clock
from tactemu.plan.plan import Stage
from tactemu.plan.scalars import is_finite
from tactemu.transducers.pressure import TAKES, output_type, pressure_function, skin_arrays, skin_type
from tactemu.transducers.transducer import CAPACITANCE, SignalType, Transducer, TransducerSite

EPSILON_0 = 8.8541878128e-12
"""Permittivity of the vacuum [F/m]."""


@functools.cache
def gap_type(real):
    """Return the Warp struct of the gaps' parameters and state."""

    @wp.struct
    class Gap:
        modulus: real
        dead_band: real
        per_area: real  # capacitance of the open gap per area
        stray: real
        tau: wp.float64
        rated: real
        baseline: wp.array2d(dtype=wp.float64)  # change of the baseline, in capacitances of the open gap

    return Gap


@functools.cache
def gap_kernel(real, vector: bool, push: bool, follows: bool):
    """Return the kernel that computes capacitances, or with ``push`` the forces that they represent."""
    pressure, skin_struct, gap_struct = pressure_function(real, vector), skin_type(real), gap_type(real)
    readings = wp.array3d(dtype=real)

    @warp_kernel
    def read_gaps(first_env: int, clock: Clock, x: readings, skin: skin_struct, gap: gap_struct, out: readings):
        e, i = wp.tid()
        e += first_env
        p = pressure(x, skin, e, i)
        p = wp.where(p < gap.dead_band, real(0.0), p - gap.dead_band)
        change = p / gap.modulus  # 1/(1 − s) − 1: growth of the capacitance, in capacitances of the open gap
        if wp.static(follows):
            if is_finite(change):
                at = gap.baseline[e, i]
                at = at + (wp.float64(change) - at) * (wp.float64(1.0) - wp.exp(-clock.dt[0] / gap.tau))
                gap.baseline[e, i] = at
                change = change - real(at)
        if wp.static(push):
            n = skin.normals[i]
            for axis in range(out.shape[2]):
                out[e, i, axis] = wp.where(out.shape[2] == 1, gap.rated * change, -gap.rated * change * n[axis])
        else:
            out[e, i, 0] = gap.stray + gap.per_area * skin.areas[i] * (real(1.0) + change)

    return read_gaps


@dataclass(frozen=True, kw_only=True)
class Capacitive(Transducer):
    """A transducer that provides the capacitance of each taxel [F], or with ``rated_n`` a force that follows it."""

    gap: Length = 2e-3
    """Thickness of the unloaded spacer [m]."""
    modulus: Pascals = 1e5
    """Pressure at which the gap is half closed [Pa]."""
    permittivity: Positive = 3.0
    """Relative permittivity of the spacer."""
    stray: NonNegative = 0.0
    """Stray capacitance beside that of the gap [F]."""
    dead_band: NonNegative = 0.0
    """Pressure up to which the gap does not move [Pa]."""
    baseline_tau: TimeConstant | None = None
    """Time constant with which the firmware follows the baseline [s]; ``None``: it does not."""
    rated_n: Newtons | None = None
    """Reading with the gap half closed [N]; [Pa] with a model that provides pressure."""

    takes = TAKES
    valid = "Plates that stay parallel; below the modulus of the spacer."
    source = "The plate capacitor. iCub skin: Maiolino et al., IEEE Sensors 2013."

    def gives(self, taken: SignalType) -> SignalType:
        return output_type(taken, CAPACITANCE, self.rated_n)

    def compile(self, site: TransducerSite, x: wp.array, taken: SignalType) -> tuple[wp.array, Sequence[Stage]]:
        context, real = site.context, site.context.real
        follows, gap = self.baseline_tau is not None, gap_type(real)()
        shape = (context.n_envs, len(site.positions))
        gap.baseline = context.zeros(shape if follows else (0, 0), wp.float64)
        out = site.zeros(self.gives(taken).n_channels)
        gap.modulus, gap.dead_band, gap.stray = self.modulus, self.dead_band, self.stray
        gap.per_area = EPSILON_0 * self.permittivity / self.gap
        gap.tau, gap.rated = self.baseline_tau or 1.0, self.rated_n or 0.0
        kernel = gap_kernel(real, taken.vector, self.rated_n is not None, follows)
        launch = context.record(kernel, shape, [context.clock, x, skin_arrays(site), gap], [out])
        reason = "the gap closes" + (", the firmware follows its baseline" if follows else "")
        reset = functools.partial(clear_rows, gap.baseline) if follows else None
        return out, [Stage(name=f"{site.name}: capacitors", reason=reason, launch=launch, reset=reset)]
