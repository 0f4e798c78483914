"""ContactProbe: touch or no touch, with a Schmitt trigger on the depth of each probe.

A probe switches on when depth > ``contact_threshold``; it stays on while depth > ``release_threshold``. Both
inequalities are strict and are evaluated in the kernels' own float type. The truth latches on the true depth, the
measured branch on the depth after imperfections (metres until here), and the delay acts on the bit.
"""

# pyright: reportAssignmentType=false, reportGeneralTypeIssues=false

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from tactemu.base.errors import SceneError
from tactemu.base.kernels import warp_kernel
from tactemu.base.units import Metres
from tactemu.plan.plan import Context, Stage
from tactemu.plan.scalars import is_nan
from tactemu.sensors.probe_layout import Probes
from tactemu.sensors.probes.contact_depth_probe import compile_depth
from tactemu.sensors.probes.query import query_trials
from tactemu.sensors.sensor_model import Compiled, SensorModel, Site


@functools.cache
def schmitt_kernel(real):
    """Return the kernel that latches each channel; the bit (0 or 1) is its own state. NaN stays NaN."""

    @warp_kernel
    def schmitt(
        first_env: int, depth: wp.array3d(dtype=real), enter: real, leave: real, bit_out: wp.array3d(dtype=real)
    ):
        e, i = wp.tid()
        e += first_env
        d = depth[e, i, 0]
        bit = real(0.0)
        if d > enter or (bit_out[e, i, 0] > real(0.0) and d > leave):
            bit = real(1.0)
        if is_nan(d):
            bit = d
        bit_out[e, i, 0] = bit

    return schmitt


def compile_latch(depth: wp.array, enter: float, leave: float, name: str, context: Context):
    """Return the array of bits of ``depth``, and its stage."""
    bits = context.zeros(depth.shape, context.real)
    kernel = schmitt_kernel(context.real)
    launch = context.record(kernel, depth.shape[:2], [depth, enter, leave], [bits])
    return bits, [Stage(name=name, reason="ContactProbe compares depth with its thresholds", launch=launch)]


@dataclass(frozen=True, kw_only=True, eq=False)
class ContactProbe(SensorModel[NDArray[np.bool_]]):
    """The reading is bool, shape ``([n_envs,] layout)``."""

    contact_threshold: Metres = 1e-4
    """Touch begins above this depth [m]."""
    release_threshold: Metres | None = None
    """Touch ends at or below this depth [m]; ``None``: at ``contact_threshold``."""

    level = 0
    unit = "m"
    reading_unit = ""
    layouts = {"touch": slice(0, 1)}
    senses_within_radius = True
    valid = "Wherever depth is right; the threshold decides which taxels touch, since nothing yields."
    source = "A Schmitt trigger. Options and numbers are those of the sensor of this name in Genesis."
    tried = query_trials()

    @property
    def _release(self) -> float:
        return self.contact_threshold if self.release_threshold is None else self.release_threshold

    def validate(self, probes: Probes) -> None:
        if self._release > self.contact_threshold:
            raise SceneError(
                f"ContactProbe: release_threshold must be <= contact_threshold ({self.contact_threshold!r} m), "
                f"got {self.release_threshold!r} m"
            )

    def present(self, values: NDArray[Any]) -> NDArray[np.bool_]:
        return values[..., 0] > 0

    def compile(self, site: Site) -> Compiled:
        depth = compile_depth(site, "ContactProbe compares depth")

        def finish(array: wp.array, branch: str):
            name = f"{site.name}: touch ({branch})"
            return compile_latch(array, self.contact_threshold, self._release, name, site.context)

        return Compiled(truth=depth.truth, raw=depth.raw, stages=depth.stages, finish=finish)
