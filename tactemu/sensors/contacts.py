"""The contact flags of the bodies that a sensor senses: a stage that exists once a user asks for them."""

# pyright: reportIndexIssue=false, reportAssignmentType=false, reportGeneralTypeIssues=false

import functools
from collections.abc import Callable, Sequence

import numpy as np
import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.geometry.shapes.distance import shape_functions
from tactemu.geometry.shapes.rays import ray_function
from tactemu.plan.clearing import clear_rows
from tactemu.plan.clock import Clock
from tactemu.plan.plan import Stage
from tactemu.plan.scalars import is_nan, natural
from tactemu.sensors.probes.strips import ray_reach
from tactemu.sensors.sensed import sensed_type
from tactemu.sensors.sensor_model import Site, TouchPoints


def probe_points(site: Site) -> TouchPoints:
    """Return the probes of a model that measures depth at them."""
    probes = site.probes
    radii = probes.radii if site.model.senses_within_radius else np.zeros(probes.n)
    return TouchPoints(
        positions=probes.positions,
        normals=probes.normals,
        radii=np.where(probes.active, radii, -1.0),
        reach=ray_reach(site).numpy() if site.along_normal else None,
    )


@functools.cache
def _contact_kernel(real, kinds: frozenset, along_normal: bool):
    vec3 = wp.types.vector(3, real)
    functions = shape_functions(real, kinds)
    distance_in_link, reaches, enters = functions.distance_in_link, functions.reaches, ray_function(real, kinds)

    @warp_kernel
    def find_contacts(
        first_env: int,
        clock: Clock,
        sensed: sensed_type(real),
        positions: wp.array(dtype=vec3),
        normals: wp.array(dtype=vec3),
        radii: wp.array(dtype=real),
        reach: wp.array(dtype=real),
        contacts_out: wp.array2d(dtype=wp.uint8),
    ):
        e, t = wp.tid()
        e = natural(e + first_env)
        b = natural(sensed.targets[natural(t)])
        x = sensed.pose[e, b]
        touches = bool(False)
        if clock.step[0] > clock.began_step[e]:
            touches = is_nan(wp.transform_get_translation(x)[0])
            i = int(0)
            while i < positions.shape[0] and not touches:
                r = positions[i]
                radius = radii[i]
                if radius >= real(0.0):
                    if wp.static(along_normal):
                        touches = not (enters(sensed.shapes, b, x, r, normals[i], reach[i], radius) >= radius)
                    elif reaches(sensed.shapes, b, x, r, radius):
                        d, _n = distance_in_link(sensed.shapes, b, x, r)
                        touches = not (d >= radius)
                i += 1
        contacts_out[e, b] = wp.where(touches, wp.uint8(1), wp.uint8(0))

    return find_contacts


def contact_flags(site: Site, n_bodies: int, points: Callable[[], Sequence[TouchPoints]]) -> tuple[wp.array, Stage]:
    """Return the flags of all bodies, uint8 ``(n_envs, n_bodies)``, and the stage that fills them.

    A flag is 1 where a sensed body is nearer to one of the points than its radius, and where the body's pose is not
    finite; it is 0 before an environment's first step.
    """
    context = site.context
    found = points() or [probe_points(site)]
    positions, normals, radii = (
        np.concatenate([getattr(each, name) for each in found]) for name in ("positions", "normals", "radii")
    )
    reach = np.concatenate([np.zeros(0) if each.reach is None else each.reach for each in found])
    flags = wp.zeros((context.n_envs, n_bodies), dtype=wp.uint8, device=context.device)
    vectors = [wp.array(values, dtype=site.vec3, device=context.device) for values in (positions, normals)]
    scalars = [wp.array(values, dtype=context.real, device=context.device) for values in (radii, reach)]
    kernel = _contact_kernel(context.real, site.table.kinds, bool(reach.size))
    inputs = [context.clock, site.sensed, *vectors, *scalars]
    launch = context.record(kernel, (context.n_envs, len(site.target_bodies)), inputs, [flags])
    stage = Stage(
        name=f"{site.name}: contacts",
        reason="contacts of bodies were asked for",
        launch=launch,
        reset=functools.partial(clear_rows, flags),
    )
    return flags, stage
