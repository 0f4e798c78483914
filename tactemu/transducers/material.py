"""The memory of a soft skin: creep, hysteresis and wear of each number of a reading by itself.

With the load ``v``, its peak ``P`` since the skin was last free, and ``n`` presses before::

    creep        v + Σ_k c w_k (z_k − v g1),   dz_k/dt = (v − z_k)/τ_k        c per decade of time; g1: after 1 s
    loop         + h P 4 s (1 − s) b,   s = v/P                               b: 0 loading, 1 unloading
    worked in    (1 − a ln(1 + n)) (...)
    baseline     + d L ln(1 + n)                                             L: the last peak

``c`` falls with load as ``(|v|/reference)^-p``. The exponentials follow the logarithm within 0.03 decades from
``first`` to ``last`` and end there: all is bounded. A press begins at ``PRESS_THRESHOLD_SHARE`` of the largest peak
and ends below half of that.
"""

# pyright: reportCallIssue=false, reportArgumentType=false, reportAssignmentType=false, reportOperatorIssue=false
# pyright: reportGeneralTypeIssues=false

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import warp as wp

from tactemu.base.errors import SceneError
from tactemu.base.kernels import warp_kernel
from tactemu.base.units import NonNegative, Positive, SignedShare
from tactemu.plan.clearing import clear_rows
from tactemu.plan.clock import Clock
from tactemu.plan.plan import Stage
from tactemu.plan.scalars import is_finite
from tactemu.transducers.laws import LogMemory
from tactemu.transducers.transducer import SignalType, Transducer, TransducerSite

PRESS_THRESHOLD_SHARE = wp.constant(wp.float64(0.05))
"""Share of the largest peak at which a press begins."""
TURN_SHARE = wp.constant(wp.float64(0.1))
"""Share of the peak over which loading turns into unloading."""
MAX_PRESSES = wp.constant(wp.float64(1000.0))
"""Number of presses after which the skin is not worked in any further."""


@wp.struct
class SoftSkin:
    """The parameters and the memory of a soft skin; arrays are empty for laws that are off."""

    taus: wp.array(dtype=wp.float64)
    weights: wp.array(dtype=wp.float64)
    after_one_s: wp.float64
    per_decade: wp.float64
    exponent: wp.float64
    reference: wp.float64
    width: wp.float64  # of the loop
    softening: wp.float64
    baseline: wp.float64
    before: wp.float64  # presses before time 0
    crept: wp.array4d(dtype=wp.float64)  # (n_envs, n_taxels, channels, taus); the following without the last
    peak: wp.array3d(dtype=wp.float64)
    largest: wp.array3d(dtype=wp.float64)
    branch: wp.array3d(dtype=wp.float64)
    last: wp.array3d(dtype=wp.float64)
    count: wp.array3d(dtype=wp.float64)


@functools.cache
def material_kernel(real, creep: bool, loop: bool, presses: bool):
    """Return the kernel of the laws that are switched on; the others leave no code."""
    f64, readings = wp.float64, wp.array3d(dtype=real)

    @warp_kernel
    def remember_load(first_env: int, clock: Clock, x: readings, skin: SoftSkin, out: readings):
        e, i, c = wp.tid()
        e += first_env
        v = f64(x[e, i, c])
        if not is_finite(v):
            out[e, i, c] = x[e, i, c]
            return
        y = v
        if wp.static(creep):
            share = skin.per_decade
            if skin.exponent != f64(0.0):
                share = share * wp.pow(wp.max(wp.abs(v), f64(0.01) * skin.reference) / skin.reference, -skin.exponent)
            total = f64(0.0)
            for k in range(skin.taus.shape[0]):
                z = skin.crept[e, i, c, k]
                z = z + (v - z) * (f64(1.0) - wp.exp(-clock.dt[0] / skin.taus[k]))
                skin.crept[e, i, c, k] = z
                total += skin.weights[k] * z
            y = y + share * (total - skin.after_one_s * v)
        if wp.static(loop or presses):
            p = skin.peak[e, i, c]
            size = wp.abs(v)
            top = wp.max(skin.largest[e, i, c], size)
            skin.largest[e, i, c] = top
            if size < f64(0.5) * PRESS_THRESHOLD_SHARE * top:
                if wp.abs(p) > PRESS_THRESHOLD_SHARE * top:
                    skin.count[e, i, c] = wp.min(skin.count[e, i, c] + f64(1.0), MAX_PRESSES)
                    skin.last[e, i, c] = p
                    p = f64(0.0)
                    skin.branch[e, i, c] = f64(0.0)
            if size > wp.abs(p) or v * p < f64(0.0):
                p = v
            if wp.static(loop):
                if p != f64(0.0):
                    s = wp.clamp(v / p, f64(0.0), f64(1.0))
                    was = skin.branch[e, i, c]
                    # distance below the peak since the skin was last loaded, as a share of the peak
                    b = wp.clamp((f64(1.0) - s) / TURN_SHARE, f64(0.0), f64(1.0))
                    if s >= f64(1.0):
                        b = f64(0.0)
                    skin.branch[e, i, c] = wp.max(b, wp.where(s < f64(1.0), was, f64(0.0)))
                    y = y + skin.width * p * f64(4.0) * s * (f64(1.0) - s) * skin.branch[e, i, c]
            skin.peak[e, i, c] = p
            if wp.static(presses):
                worked = wp.log(f64(1.0) + wp.min(skin.count[e, i, c] + skin.before, MAX_PRESSES))
                y = y * (f64(1.0) - skin.softening * worked)
                y = y + skin.baseline * skin.last[e, i, c] * wp.log(f64(1.0) + skin.count[e, i, c])
        out[e, i, c] = real(y)

    return remember_load


@dataclass(frozen=True, kw_only=True)
class Material(Transducer):
    """A transducer that provides its input quantity, changed by the memory of a soft skin."""

    creep_per_decade: SignedShare = 0.0
    """Growth of the reading of a constant load per decade of time, relative to that after 1 s; negative: it relaxes."""
    creep_exponent: float = 0.0
    """Exponent by which heavy loads creep less: ``(|v|/reference)^-exponent``."""
    reference: Positive = 1.0
    """Load at which ``creep_per_decade`` holds [unit of the reading]."""
    first: Positive = 0.1
    """Time at which the logarithm begins [s]."""
    last: Positive = 1000.0
    """Time at which the logarithm ends [s]."""
    loop: SignedShare = 0.0
    """Widest gap between unloading and loading, as a share of the peak of that press."""
    softening: SignedShare = 0.0
    """Loss of the reading per ln(1 + presses), as a share."""
    baseline: SignedShare = 0.0
    """Offset that a press leaves behind per ln(1 + presses), as a share of its peak."""
    presses_before: NonNegative = 0.0
    """Number of presses before time 0."""

    memories = ("creep_per_decade", "loop")
    takes = ("force", "pressure", "displacement", "depth", "field", "resistance", "capacitance")
    valid = "Presses that come and go. Inside a loop that is not closed the reading is that of the outer one."
    source = "Logarithmic creep of elastomers and of piezoresistive composites; docs/realism.md has the measurements."

    def check(self, where: str) -> None:
        if self.last <= self.first:
            raise SceneError(f"{where}: last must be after first ({self.first:g} s), got {self.last:g} s")

    def gives(self, taken: SignalType) -> SignalType:
        return taken

    def compile(self, site: TransducerSite, x: wp.array, taken: SignalType) -> tuple[wp.array, Sequence[Stage]]:
        creep = self.creep_per_decade != 0
        loop, presses = self.loop != 0, self.softening != 0 or self.baseline != 0
        if not (creep or loop or presses):
            return x, []
        context, shape = site.context, (*x.shape,)
        memory = LogMemory.over(self.first, self.last)
        skin, own = SoftSkin(), ("peak", "largest", "branch", "last", "count")
        skin.crept = context.zeros((*shape, len(memory.taus) if creep else 0), wp.float64)
        for name in own:
            setattr(skin, name, context.zeros(shape if loop or presses else (0, 0, 0), wp.float64))
        out = site.zeros(taken.n_channels)
        skin.taus, skin.weights = site.constant(memory.taus, wp.float64), site.constant(memory.weights, wp.float64)
        skin.after_one_s, skin.per_decade = float(memory.grown(1.0)), self.creep_per_decade
        skin.exponent, skin.reference, skin.width = self.creep_exponent, self.reference, self.loop
        skin.softening, skin.baseline, skin.before = self.softening, self.baseline, self.presses_before
        kernel = material_kernel(context.real, creep, loop, presses)
        launch = context.record(kernel, shape, [context.clock, x, skin], [out])

        def reset(mask: wp.array) -> None:
            for array in (skin.crept, *(getattr(skin, name) for name in own), out):
                clear_rows(array, mask)

        on = [name for name, is_on in (("creep", creep), ("loop", loop), ("presses", presses)) if is_on]
        stage = Stage(name=f"{site.name}: soft skin", reason=", ".join(on), launch=launch, reset=reset)
        return out, [stage]
