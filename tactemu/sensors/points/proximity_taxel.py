"""ProximityTaxel: force and torque from the points of a surface within a radius, touching or not.

With ``P_j = R - |x_j - r|`` for the M points ``x_j`` of the tracked bodies within R of the probe at r, the probe's
normal a, ``v_j = v_body(x_j) - v_skin(r)``, ``v_tj`` its part across a, and ``D = density_scalar / M``::

    F = -k D (sum P_j) a + c D sum P_j v_tj            k stiffness, c shear_coupling
    T = r x F + c_w a sum P_j (w_j - w_skin).a / sum P_j        c_w twist_scalar

All of F and T acts on the skin. With ``convention="genesis"`` the normal and twist parts, those with ``k`` and ``c_w``,
are reversed: they act on the body, as in Genesis.
"""

# pyright: reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false, reportAssignmentType=false
# pyright: reportGeneralTypeIssues=false

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from tactemu.base.units import NonNegative
from tactemu.plan.launches import in_turn
from tactemu.plan.plan import Stage
from tactemu.sensors.point_cloud import Clusters, cluster
from tactemu.sensors.points.near import near_clusters
from tactemu.sensors.points.proximity_sums import ProximitySums
from tactemu.sensors.points.surface_points import FEWER_POINTS, surface_points
from tactemu.sensors.points.table import upload_clouds
from tactemu.sensors.probes.kinematic_taxel import ForceTorque, force_torque_writer
from tactemu.sensors.sensor_model import Compiled, SensorModel, Setting, Site


@functools.cache
def proximity_type(real):
    """Return the Warp struct of a ProximityTaxel's parameters, and of what its forces are computed from."""
    vec3 = wp.types.vector(3, real)

    @wp.struct
    class Proximity:
        normal: real  # factor of the sum, along the probe's normal
        shear: real  # factor of the velocity sum
        twist: real
        bodies: wp.array(dtype=wp.int32)  # of the clouds
        sums: wp.array3d(dtype=wp.types.vector(4, real))  # (n_envs, n_clouds, n_taxels)
        place: wp.array(dtype=wp.int32)  # index of each taxel in the sums
        velocity: wp.array2d(dtype=vec3)
        spin: wp.array2d(dtype=vec3)
        link_spin: wp.array(dtype=vec3)
        positions: wp.array(dtype=vec3)
        normals: wp.array(dtype=vec3)
        gain: wp.array2d(dtype=real)

    return Proximity


@functools.cache
def proximity_kernel(real, moving: bool, has_gain: bool):
    """Return the kernel of force and torque from the sums over points
    (:mod:`tactemu.sensors.points.proximity_sums`)."""
    vec3, proximity_struct, write = wp.types.vector(3, real), proximity_type(real), force_torque_writer(real)

    @wp.kernel(module="unique", enable_backward=False)
    def proximity(first_env: int, c: proximity_struct, out: wp.array3d(dtype=real)):
        e, i = wp.tid()
        e += first_env
        r = c.positions[i]
        a = c.normals[i]
        total = real(0.0)
        motion = vec3(real(0.0))  # sum P_j v_j
        twist = real(0.0)  # sum P_j (w_j - w_skin) . a
        for k in range(c.bodies.shape[0]):
            s = c.sums[e, k, c.place[i]]
            total += s[3]
            if wp.static(moving):
                b = c.bodies[k]
                w = c.spin[e, b]
                moment = vec3(s[0], s[1], s[2])
                motion += s[3] * (c.velocity[e, b] + wp.cross(w, r)) + wp.cross(w + c.link_spin[e], moment)
                twist += s[3] * wp.dot(w, a)
        g = real(1.0)
        if wp.static(has_gain):
            g = c.gain[e, i]
        force = -c.normal * g * total * a
        if wp.static(moving):
            force += c.shear * g * (motion - wp.dot(motion, a) * a)
        torque = wp.cross(r, force)
        if wp.static(moving):
            if total > real(0.0):
                torque += c.twist * twist / total * a
        write(out, e, i, force, torque)

    return proximity


@dataclass(frozen=True, kw_only=True, eq=False)
class ProximityTaxel(SensorModel[ForceTorque]):
    """The reading is a :class:`ForceTorque`: force [N], and torque about the link's origin [N m].

    ``sense`` names the bodies whose points it senses (default: all others).
    """

    stiffness: NonNegative = 100.0
    """Force per summed overlap [N/m], before ``density_scalar``."""
    density_scalar: NonNegative = 100.0
    """Number of points to which ``stiffness`` applies: sums are multiplied by ``density_scalar / M``."""
    shear_coupling: NonNegative = 0.0
    """Force per summed overlap and velocity [N s/m^2], before ``density_scalar``."""
    twist_scalar: NonNegative = 1.0
    """Torque per spin about the normal [N m s/rad]."""
    n_sample_points: int | Sequence[int] = 500
    """Points on all tracked bodies together, split evenly, or one number per tracked body."""
    points: Sequence | np.ndarray | None = None
    """The points themselves in the frame of the tracked body [m], ``(M, 3)``; a list of such arrays for several."""

    level = 2
    work = 10
    channels = ("force", "torque")
    unit = "N"
    layouts = {"force": slice(0, 3)}
    has_genesis_signs = True
    more_fields = {"torque": slice(3, 6)}
    reading_unit = "N, N m"
    strengths = ("stiffness", "shear_coupling", "twist_scalar")
    examples = {", 500 points": {"radius": 0.004, "n_sample_points": 500}}
    valid = (
        "Bodies that are near, before they touch. As a force sensor it is slower and less accurate than springs: the "
        "sum over points depends on their random places."
    )
    source = "Sums over points. Options and numbers are those of the sensor of this name in Genesis."
    tried = [Setting(f"{count} points", {"n_sample_points": count}) for count in (500, 5000)]

    def velocity_reason(self) -> str | None:
        terms = {"shear": self.shear_coupling, "twist": self.twist_scalar}
        wanted = [name for name, value in terms.items() if value != 0.0]
        return "ProximityTaxel " + ", ".join(wanted) if wanted else None

    def present(self, values: NDArray[Any]) -> ForceTorque:
        return ForceTorque(values[..., :3], values[..., 3:])

    def compile(self, site: Site) -> Compiled:
        truth = site.zeros()
        raw = site.zeros() if site.separate else truth
        clusters = cluster(surface_points(site, self.n_sample_points, self.points))
        stages = self._stages(site, clusters, truth, raw) if site.probes.n and clusters.n_points else []
        return Compiled(truth=truth, raw=raw, stages=stages)

    def _stages(self, site: Site, clusters: Clusters, truth: wp.array, raw: wp.array) -> list[Stage]:
        clouds = upload_clouds(clusters, site.context)
        near, find = near_clusters(site, clouds, float(site.probes.radii.max()) if site.radius is None else None)
        sums = ProximitySums(site, near)
        nominal, add_up = sums.record(site.radii.reshape((1, -1)))
        launches = [add_up, self._forces(site, clouds, sums, nominal, None, clusters.n_points, truth)]
        if site.separate:
            measured = nominal
            if site.radius is not None:
                measured, add_up = sums.record(site.radius)
                launches.append(add_up)
            launches.append(self._forces(site, clouds, sums, measured, site.gain, clusters.n_points, raw))

        reason = f"ProximityTaxel sums over {clusters.n_points} points"
        skips = "ProximityTaxel skips clusters out of reach"
        return [
            Stage(name=f"{site.name}: near points", reason=skips, launch=find, cheaper=FEWER_POINTS),
            Stage(name=f"{site.name}: points", reason=reason, launch=in_turn(*launches), cheaper=FEWER_POINTS),
        ]

    def _forces(self, site: Site, clouds, sums: ProximitySums, values, gain, n_points: int, out) -> Callable[[], None]:
        context, view, c = site.context, site.view, proximity_type(site.context.real)()
        density = self.density_scalar / max(n_points, 1)
        side = 1.0 if site.on_skin else -1.0
        c.normal, c.shear = side * self.stiffness * density, self.shear_coupling * density
        c.twist = side * self.twist_scalar
        c.bodies, c.sums, c.place = clouds.bodies, values, sums.place
        c.velocity, c.spin, c.link_spin = view.velocity, view.spin, view.link_spin
        c.positions, c.normals = site.positions, site.normals
        if gain is not None:
            c.gain = gain
        kernel = proximity_kernel(context.real, self.velocity_reason() is not None, gain is not None)
        return context.record(kernel, out.shape[:2], [c], [out])
