"""Fluid and barometric transducers: a medium that transmits pressure with a lag.

::

    dy/dt = (x − y)/τ               lag of the medium; exact for a pressure that is constant within a step

Silicone around the medium relaxes: put :class:`~tactemu.transducers.material.Material` before it. With ``shared`` all
taxels have one medium, as in a finger filled with liquid: each reads the mean pressure.
"""

# pyright: reportAssignmentType=false, reportGeneralTypeIssues=false

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.base.units import TimeConstant
from tactemu.plan.clearing import clear_rows
from tactemu.plan.clock import Clock
from tactemu.plan.plan import Stage
from tactemu.plan.scalars import is_finite
from tactemu.transducers.pressure import TAKES, pressure_function, skin_arrays, skin_type
from tactemu.transducers.transducer import PRESSURE, SignalType, Transducer, TransducerSite


@functools.cache
def medium_kernel(real, vector: bool, shared: bool):
    """Return the kernel that computes the pressure of the medium, which lags behind that on the taxels."""
    pressure, readings = pressure_function(real, vector), wp.array3d(dtype=real)

    @warp_kernel
    def pass_on(
        first_env: int,
        clock: Clock,
        x: readings,
        skin: skin_type(real),
        tau: wp.float64,
        late: wp.array2d(dtype=wp.float64),  # state
        out: readings,
    ):
        e, i = wp.tid()
        e += first_env
        p = wp.float64(0.0)
        if wp.static(shared):
            area = wp.float64(0.0)
            for k in range(x.shape[1]):
                p += wp.float64(pressure(x, skin, e, k) * skin.areas[k])
                area += wp.float64(skin.areas[k])
            p = p / area
        else:
            p = wp.float64(pressure(x, skin, e, i))
        if is_finite(p):
            y = late[e, i]
            y = y + (p - y) * (wp.float64(1.0) - wp.exp(-clock.dt[0] / tau))
            late[e, i] = y
            p = y
        out[e, i, 0] = real(p)

    return pass_on


@dataclass(frozen=True, kw_only=True)
class Fluid(Transducer):
    """A transducer that provides the pressure of a medium at each taxel [Pa]."""

    tau: TimeConstant = 0.3
    """Time constant of the medium [s]: air 0.01, oil in a channel of 1.5 mm 0.25."""
    shared: bool = False
    """All taxels share one medium."""

    takes = TAKES
    valid = "Slower than sound in the medium. The time constant differs from medium to medium: measure it for yours."
    source = "A Newtonian flow through a narrow channel into a compliant chamber. docs/realism.md has the measurements."

    def gives(self, taken: SignalType) -> SignalType:
        return PRESSURE

    def compile(self, site: TransducerSite, x: wp.array, taken: SignalType) -> tuple[wp.array, Sequence[Stage]]:
        context = site.context
        shape = (context.n_envs, len(site.positions))
        late, out = context.zeros(shape, wp.float64), site.zeros(1)
        inputs = [context.clock, x, skin_arrays(site), self.tau, late]
        kernel = medium_kernel(context.real, taken.vector, self.shared)
        launch = context.record(kernel, shape, inputs, [out])
        reset = functools.partial(clear_rows, late)
        return out, [Stage(name=f"{site.name}: medium", reason=f"{self.tau:g} s late", launch=launch, reset=reset)]
