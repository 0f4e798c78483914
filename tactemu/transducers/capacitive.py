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

from tactemu.base.units import Length, Newtons, NonNegative, Pascals, Positive, TimeConstant
from tactemu.plan.clearing import clear_rows
from tactemu.plan.plan import Stage
from tactemu.plan.scalars import is_finite
from tactemu.transducers.pressure import TAKES, output_type, pressure_function, skin_arrays
from tactemu.transducers.transducer import CAPACITANCE, SignalType, Transducer, TransducerSite

EPSILON_0 = 8.8541878128e-12
"""Permittivity of the vacuum [F/m]."""


@functools.cache
def gap_kernel(real, vector: bool, push: bool, follows: bool):
    """Return the kernel that computes capacitances, or with ``push`` the forces that they represent."""
    vec3 = wp.types.vector(3, real)
    pressure = pressure_function(real, vector)

    @wp.kernel(module="unique", enable_backward=False)
    def read_gaps(
        first_env: int,
        x: wp.array3d(dtype=real),
        normals: wp.array(dtype=vec3),
        areas: wp.array(dtype=real),
        dt: wp.array(dtype=wp.float64),
        modulus: real,
        dead_band: real,
        per_area: real,
        stray: real,
        tau: wp.float64,
        rated: real,
        # state: change of the baseline, in capacitances of the open gap
        baseline: wp.array2d(dtype=wp.float64),
        out: wp.array3d(dtype=real),
    ):
        e, i = wp.tid()
        e += first_env
        p = pressure(x, normals, areas, e, i)
        p = wp.where(p < dead_band, real(0.0), p - dead_band)
        change = p / modulus  # 1/(1 − s) − 1: growth of the capacitance, in capacitances of the open gap
        if wp.static(follows):
            if is_finite(change):
                at = baseline[e, i]
                at = at + (wp.float64(change) - at) * (wp.float64(1.0) - wp.exp(-dt[0] / tau))
                baseline[e, i] = at
                change = change - real(at)
        if wp.static(push):
            n = normals[i]
            for axis in range(out.shape[2]):
                out[e, i, axis] = wp.where(out.shape[2] == 1, rated * change, -rated * change * n[axis])
        else:
            out[e, i, 0] = stray + per_area * areas[i] * (real(1.0) + change)

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
        normals, areas = skin_arrays(site)
        follows = self.baseline_tau is not None
        shape = (context.n_envs, len(site.positions))
        baseline = context.zeros(shape if follows else (0, 0), wp.float64)
        kind = self.gives(taken)
        out = site.zeros(kind.n_channels)
        inputs = [
            x, normals, areas, context.dt, self.modulus, self.dead_band, EPSILON_0 * self.permittivity / self.gap,
            self.stray, self.baseline_tau or 1.0, self.rated_n or 0.0, baseline,
        ]  # fmt: skip
        kernel = gap_kernel(real, taken.vector, self.rated_n is not None, follows)
        launch = context.record(kernel, shape, inputs, [out])
        reason = "the gap closes" + (", the firmware follows its baseline" if follows else "")
        reset = functools.partial(clear_rows, baseline) if follows else None
        return out, [Stage(name=f"{site.name}: capacitors", reason=reason, launch=launch, reset=reset)]
