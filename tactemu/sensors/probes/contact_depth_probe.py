"""ContactDepthProbe: the depth of each probe in the body that it touches [m]."""

import functools
from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import NDArray

from tactemu.plan.plan import Stage
from tactemu.sensors.probes.query import CHEAPER_QUERY, probes_struct, query_trials, touch_type
from tactemu.sensors.probes.strips import record_strips
from tactemu.sensors.sensor_model import Compiled, SensorModel, Site


@functools.cache
def depth_formula(real):
    """Return the formula of depth times gain, 0 without contact."""
    probes_type, touch_struct = probes_struct(real), touch_type(real)

    @wp.func
    def measure(unused: int, probes: probes_type, touch: touch_struct, e: int, i: int, out: wp.array3d(dtype=real)):
        out[e, i, 0] = wp.where(touch.depth < real(0.0), real(0.0), touch.depth) * touch.gain

    return measure


_DEPTH_SIMD = """
    constexpr int CHANNELS = 1;
    auto measure = [&](const Touch& touch, int, Vector* out) {
        out[0] = (touch.depth < 0 ? Vector{} : touch.depth) * touch.gain;
    };
"""


def compile_depth(site: Site, why: str) -> Compiled:
    """Return the depth stage of a sensor that starts from depth."""
    truth = site.zeros(1)
    raw = site.zeros(1) if site.separate else truth
    launch = record_strips(site, depth_formula(site.context.real), wp.int32, 0, truth, raw, simd=_DEPTH_SIMD)
    stage = Stage(name=f"{site.name}: contact depth", reason=why, launch=launch, cheaper=CHEAPER_QUERY)
    return Compiled(truth=truth, raw=raw, stages=[stage])


@dataclass(frozen=True, kw_only=True, eq=False)
class ContactDepthProbe(SensorModel[NDArray[np.floating]]):
    """The reading is depth [m], shape ``([n_envs,] layout)``."""

    level = 1
    unit = "m"
    layouts = {"depth": slice(0, 1)}
    senses_within_radius = True
    valid = (
        "Exact as a distance, at any depth with the ray query; it computes no equilibrium, so that nothing moves "
        "beside a contact."
    )
    source = "Geometry. Options and numbers are those of the sensor of this name in Genesis (genesis-world 1.4.5)."
    tried = query_trials()

    def compile(self, site: Site) -> Compiled:
        return compile_depth(site, "ContactDepthProbe reads depth")
