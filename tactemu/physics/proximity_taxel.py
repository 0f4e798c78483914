"""ProximityTaxel: force and torque from the points of a surface within a radius, touching or not.

With ``P_j = R - |x_j - r|`` for the M points ``x_j`` of the tracked bodies within R of the probe at r, the probe's
normal a, ``v_j = v_body(x_j) - v_skin(r)``, ``v_tj`` its part across a, and ``D = density_scalar / M``::

    F = k D (sum P_j) a + c D sum P_j v_tj             k stiffness, c shear_coupling
    T = r x F - c_w a sum P_j (w_j - w_skin).a / sum P_j        c_w twist_scalar

The normal part is the force on the *body*, the shear part the force on the skin: so the seed has it. ``forces_on_skin``
turns the normal and twist parts round, so that all of F and T acts on the skin.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from tactemu.errors import SceneError
from tactemu.physics.cloud_table import cloud_type, upload_clouds
from tactemu.physics.kinematic_taxel import ForceTorque
from tactemu.physics.near_clusters import near_clusters
from tactemu.physics.plan import Stage, record
from tactemu.physics.point_cloud import Clusters, cluster, spatial_order
from tactemu.physics.probes import Probes
from tactemu.physics.proximity_sums import proximity_function
from tactemu.physics.sensor import Compiled, SensorModel, Site
from tactemu.physics.surface_points import surface_points

_NEIGHBOURS = 32
"""Taxels that run side by side on a GPU: they should be near each other, to look at the same points."""


@functools.cache
def coefficients_type(real):
    """The Warp struct of a ProximityTaxel's numbers."""

    @wp.struct
    class Coefficients:
        normal: real  # of the sum, along the probe's normal
        shear: real  # of the velocity sum
        twist: real

    return Coefficients


@functools.cache
def proximity_kernel(real, moving: bool, separate: bool, has_gain: bool, has_radius: bool):
    """Force and torque of the truth and, if ``separate``, of the measured branch."""
    vec3 = wp.types.vector(3, real)
    transform = wp.types.transformation(real)
    near_points = proximity_function(real)
    coefficients = coefficients_type(real)

    @wp.struct
    class Sums:
        overlap: real
        motion: vec3  # sum P_j v_j
        spin: real  # sum P_j (w_j - w_skin) . a

    @wp.func
    def write(s: Sums, gain: real, c: coefficients, r: vec3, a: vec3, e: int, i: int, out: wp.array3d(dtype=real)):
        force = c.normal * s.overlap * gain * a
        if wp.static(moving):
            force += c.shear * gain * (s.motion - wp.dot(s.motion, a) * a)
        torque = wp.cross(r, force)
        if wp.static(moving):
            if s.overlap > real(0.0):
                torque -= c.twist * s.spin / s.overlap * a
        for k in range(3):
            out[e, i, k] = force[k]
            out[e, i, 3 + k] = torque[k]

    @wp.kernel(module="unique", enable_backward=False)
    def proximity(
        clouds: cloud_type(real),
        near: wp.array2d(dtype=wp.int32),
        near_start: wp.array2d(dtype=wp.int32),
        order: wp.array(dtype=wp.int32),
        pose: wp.array2d(dtype=transform),
        velocity: wp.array2d(dtype=vec3),
        spin: wp.array2d(dtype=vec3),
        link_spin: wp.array(dtype=vec3),
        positions: wp.array(dtype=vec3),
        normals: wp.array(dtype=vec3),
        radii: wp.array(dtype=real),
        c: coefficients,
        gain: wp.array2d(dtype=real),
        radius: wp.array2d(dtype=real),
        # outputs
        truth_out: wp.array3d(dtype=real),
        raw_out: wp.array3d(dtype=real),
    ):
        e, place = wp.tid()
        i = order[place]
        r = positions[i]
        a = normals[i]
        truth = Sums()
        raw = Sums()
        for k in range(clouds.bodies.shape[0]):
            b = clouds.bodies[k]
            first = near_start[e, k]
            last = near_start[e, k + 1]
            overlap, moment = near_points(clouds, k, near[e], first, last, pose[e, b], r, radii[i])
            truth.overlap += overlap
            here = vec3(real(0.0))
            turn = vec3(real(0.0))
            w = real(0.0)
            if wp.static(moving):
                here = velocity[e, b] + wp.cross(spin[e, b], r)
                turn = spin[e, b] + link_spin[e]
                w = wp.dot(spin[e, b], a)
                truth.motion += overlap * here + wp.cross(turn, moment)
                truth.spin += overlap * w
            if wp.static(has_radius):
                overlap, moment = near_points(clouds, k, near[e], first, last, pose[e, b], r, radius[e, i])
                raw.overlap += overlap
                raw.motion += overlap * here + wp.cross(turn, moment)
                raw.spin += overlap * w
        write(truth, real(1.0), c, r, a, e, i, truth_out)
        if wp.static(separate):
            if wp.static(not has_radius):
                raw = truth
            g = real(1.0)
            if wp.static(has_gain):
                g = gain[e, i]
            write(raw, g, c, r, a, e, i, raw_out)

    return proximity


@dataclass(kw_only=True, eq=False)
class ProximityTaxel(SensorModel):
    """Reads :class:`ForceTorque`. ``track_link_idx`` names the bodies whose points it senses (default: all others)."""

    stiffness: float = 100.0
    """Force per summed overlap [N/m], before ``density_scalar``."""
    density_scalar: float = 100.0
    """Number of points for which ``stiffness`` is meant: sums are multiplied by ``density_scalar / M``."""
    shear_coupling: float = 0.0
    """Force per summed overlap and velocity [N s/m^2], before ``density_scalar``."""
    twist_scalar: float = 1.0
    """Torque per spin about the normal [N m s/rad]."""
    n_sample_points: int | Sequence[int] = 500
    """Points on all tracked bodies together, split evenly, or one number per tracked body."""
    use_visual_mesh: bool = True
    """Accepted as the seed's option: a body here has one surface, which both values sample."""
    points: Sequence | np.ndarray | None = None
    """The points themselves in the frame of the tracked body [m], ``(M, 3)``; a list of such arrays for several."""
    forces_on_skin: bool = False
    """Turn the normal and twist parts so that they too act on the skin."""

    channels = ("force", "torque")
    layouts = {"force": slice(0, 3)}

    def velocity_reason(self) -> str | None:
        terms = {"shear": self.shear_coupling, "twist": self.twist_scalar}
        wanted = [name for name, value in terms.items() if value != 0.0]
        return "ProximityTaxel " + ", ".join(wanted) if wanted else None

    def validate(self, probes: Probes) -> None:
        for name in ("stiffness", "density_scalar", "shear_coupling", "twist_scalar"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise SceneError(f"ProximityTaxel: {name} must be finite and >= 0, got {value!r}")

    def present(self, values: np.ndarray) -> ForceTorque:
        return ForceTorque(values[..., :3], values[..., 3:])

    def compile(self, site: Site) -> Compiled:
        truth = site.zeros()
        raw = site.zeros() if site.separate else truth
        clusters = cluster(surface_points(site, self.n_sample_points, self.points))
        stages = self._stages(site, clusters, truth, raw) if site.probes.n and clusters.n_points else []
        return Compiled(truth=truth, raw=raw, stages=stages)

    def _stages(self, site: Site, clusters: Clusters, truth: wp.array, raw: wp.array) -> list[Stage]:
        context, view, probes = site.context, site.view, site.probes
        moving = self.velocity_reason() is not None
        has_gain, has_radius = site.gain is not None, site.radius is not None
        clouds = upload_clouds(clusters, context)
        near, find = near_clusters(site, clouds, None if has_radius else float(probes.radii.max()))
        order = wp.array(spatial_order(probes.positions, _NEIGHBOURS), dtype=wp.int32, device=context.device)
        inputs = [clouds, near.clusters, near.start, order, view.pose, view.velocity, view.spin, view.link_spin]
        inputs += [site.positions, site.normals, site.radii, self._coefficients(context.real, clusters.n_points)]
        inputs += [site.gain, site.radius]
        kernel = proximity_kernel(context.real, moving, site.separate, has_gain, has_radius)
        add_up = record(kernel, truth.shape[:2], inputs, [truth, raw], context.device)
        reason = f"ProximityTaxel sums over {clusters.n_points} points"
        return [
            Stage(name=f"{site.name}: near points", reason="ProximityTaxel skips what is out of reach", launch=find),
            Stage(name=f"{site.name}: points", reason=reason, launch=add_up),
        ]

    def _coefficients(self, real, n_points: int):
        density = self.density_scalar / max(n_points, 1)
        side = -1.0 if self.forces_on_skin else 1.0
        c = coefficients_type(real)()
        c.normal, c.shear = side * self.stiffness * density, self.shear_coupling * density
        c.twist = side * self.twist_scalar
        return c
