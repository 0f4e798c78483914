"""ProximityTaxel: force and torque from the points of a surface within a radius, touching or not.

With ``P_j = R - |x_j - r|`` for the M points ``x_j`` of the tracked bodies within R of the probe at r, the probe's
normal a, ``v_j = v_body(x_j) - v_skin(r)``, ``v_tj`` its part across a, and ``D = density_scalar / M``::

    F = -k D (sum P_j) a + c D sum P_j v_tj            k stiffness, c shear_coupling
    T = r x F + c_w a sum P_j (w_j - w_skin).a / sum P_j        c_w twist_scalar

All of F and T acts on the skin. With ``convention="genesis"`` the normal and twist parts, those with ``k`` and ``c_w``,
are reversed: they act on the body, as in Genesis.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from tactemu.base.units import NonNegative
from tactemu.plan.launches import Launch, in_turn
from tactemu.plan.plan import Stage
from tactemu.sensors.point_cloud import Clusters, cluster
from tactemu.sensors.points.forces import proximity_type
from tactemu.sensors.points.near import near_clusters
from tactemu.sensors.points.proximity_patches import record_patches
from tactemu.sensors.points.proximity_simd import make_strips, record_strips
from tactemu.sensors.points.surface_points import FEWER_POINTS, surface_points
from tactemu.sensors.points.table import upload_clouds
from tactemu.sensors.probes.kinematic_taxel import ForceTorque
from tactemu.sensors.sensor_model import Compiled, SensorModel, Setting, Site


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
        clouds, measured = upload_clouds(clusters, site.context), raw if site.separate else None
        parameters, is_moving = self._parameters(site, clouds, clusters.n_points), self.velocity_reason() is not None
        reason = f"ProximityTaxel sums over {clusters.n_points} points"
        points = partial(Stage, name=f"{site.name}: points", reason=reason, cheaper=FEWER_POINTS)
        if not site.context.device.is_cpu:
            return [points(launch=record_patches(site, clouds, parameters, is_moving, truth, measured))]
        near, find = near_clusters(site, clouds, float(site.probes.radii.max()) if site.radius is None else None)
        launches = self._on_cpu(site, near, parameters, truth, measured)
        skips = "ProximityTaxel skips clusters out of reach"
        return [
            Stage(name=f"{site.name}: near points", reason=skips, launch=find, cheaper=FEWER_POINTS),
            points(launch=in_turn(*launches)),
        ]

    def _parameters(self, site: Site, clouds, n_points: int):
        """Return a :func:`~tactemu.sensors.points.forces.proximity_type`."""
        view, c = site.view, proximity_type(site.context.real)()
        density = self.density_scalar / max(n_points, 1)
        side = 1.0 if site.on_skin else -1.0
        c.normal, c.shear = side * self.stiffness * density, self.shear_coupling * density
        c.twist = side * self.twist_scalar
        c.bodies, c.velocity, c.spin, c.link_spin = clouds.bodies, view.velocity, view.spin, view.link_spin
        c.positions, c.normals = site.positions, site.normals
        if site.gain is not None:
            c.gain = site.gain
        return c

    def _on_cpu(self, site: Site, near, parameters: Any, truth: wp.array, raw: wp.array | None) -> list[Launch]:
        strips, has_gain = make_strips(site, near), site.gain is not None
        record = partial(record_strips, site, strips, parameters, self.velocity_reason() is not None)
        if raw is None or site.radius is None:
            return [record(truth=truth, raw=raw, has_gain=has_gain)]
        return [record(truth=truth), record(radius=site.radius, raw=raw, has_gain=has_gain)]
