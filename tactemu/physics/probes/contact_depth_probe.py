"""ContactDepthProbe: how deep each probe is in what it touches [m]."""

# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false
# pyright: reportAssignmentType=false, reportOperatorIssue=false, reportGeneralTypeIssues=false

import functools
from dataclasses import dataclass

import warp as wp

from tactemu.physics.probes.query import (
    CHEAPER_QUERY,
    contact_function,
    noise_function,
    probe_arrays,
    probes_struct,
    query_trials,
    strip_function,
    strips,
    turned,
)
from tactemu.physics.sensor import Compiled, SensorModel, Site, Trial
from tactemu.physics.shapes.shape import table_type
from tactemu.plan.plan import Stage, record


@functools.cache
def depth_kernel(
    real, kinds: frozenset, along_normal: bool, in_strips: bool, separate: bool, has_gain: bool, has_radius: bool
):
    """Depth of the truth and, if ``separate``, of the measured branch with its own radii and gains."""
    transform = wp.types.transformation(real)
    shapes_type = table_type(real)
    probes_type = probes_struct(real)
    nearest = contact_function(real, kinds, along_normal)
    touches, noise = strip_function(real, kinds), noise_function(real, has_radius)

    @wp.func
    def depth(radius: real, distance: real):
        d = radius - distance
        return wp.where(d < real(0.0), real(0.0), d)  # not max(), which would turn NaN into 0

    @wp.kernel(module="unique", enable_backward=False)
    def contact_depth(
        shapes: shapes_type,
        pose: wp.array2d(dtype=transform),
        targets: wp.array(dtype=wp.int32),
        probes: probes_type,
        gain: wp.array2d(dtype=real),
        radius: wp.array2d(dtype=real),
        truth_out: wp.array3d(dtype=real),
        raw_out: wp.array3d(dtype=real),
    ):
        e, strip = wp.tid()
        if wp.static(turned(kinds, in_strips)):
            strip, e = wp.tid()
        first = strip * probes.strip
        last = wp.min(first + probes.strip, probes.radii.shape[0])
        if wp.static(in_strips):
            if not touches(shapes, pose, targets, probes, e, strip, noise(probes, radius, e, strip)):
                for i in range(first, last):
                    truth_out[e, i, 0] = real(0.0)
                    if wp.static(separate):
                        raw_out[e, i, 0] = real(0.0)
                return
        for i in range(first, last):
            r_true = probes.radii[i]
            if r_true > real(0.0):
                r_measured = r_true
                if wp.static(has_radius):
                    r_measured = radius[e, i]
                distance, _n, _b = nearest(shapes, pose, targets, probes, e, i, wp.max(r_true, r_measured))
                truth_out[e, i, 0] = depth(r_true, distance)
                if wp.static(separate):
                    d = depth(r_measured, distance)
                    if wp.static(has_gain):
                        d *= gain[e, i]
                    raw_out[e, i, 0] = d

    return contact_depth


def compile_depth(site: Site, why: str) -> Compiled:
    """The depth stage of a sensor that starts from depth."""
    context = site.context
    truth = site.zeros(1)
    raw = site.zeros(1) if site.separate else truth
    none = wp.zeros((0, 0), dtype=context.real, device=context.device)
    has_gain, has_radius = site.gain is not None, site.radius is not None
    how = (site.along_normal, context.device.is_cpu, site.separate, has_gain, has_radius)
    kernel = depth_kernel(context.real, site.table.kinds, *how)
    inputs = [
        site.table.struct,
        site.view.pose,
        site.targets,
        probe_arrays(site),
        site.gain if has_gain else none,
        site.radius if has_radius else none,
    ]
    launch = record(kernel, strips(site), inputs, [truth, raw], context.device)
    stage = Stage(name=f"{site.name}: contact depth", reason=why, launch=launch, cheaper=CHEAPER_QUERY)
    return Compiled(truth=truth, raw=raw, stages=[stage])


@dataclass(kw_only=True, eq=False)
class ContactDepthProbe(SensorModel):
    """Reads depth [m], shape ``([n_envs,] layout)``."""

    level = 1
    unit = "m"
    layouts = {"depth": slice(0, 1)}
    feels_at_radius = True
    valid = (
        "Exact as a distance, at any depth with the ray query; it knows no equilibrium, so that beside a contact "
        "nothing moves."
    )
    source = "Geometry. Option names and numbers are those of the sensor of this name in Genesis (genesis-world 1.4.5)."

    @classmethod
    def trials(cls, quantity: str) -> list[Trial]:
        return query_trials()

    def compile(self, site: Site) -> Compiled:
        return compile_depth(site, "ContactDepthProbe reads depth")
