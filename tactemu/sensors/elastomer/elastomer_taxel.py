"""ElastomerTaxel: the motion of markers on a soft skin, by dilation around a press and by shear of objects that stick
to it.

Neighbours of a pressed taxel are pushed aside and bulge along the normal; points of an object that stick to the skin
drag the markers along. For marker i at ``r_i`` with normal ``n_i``, pressed taxels j of depth ``h_j``, ``o`` the vector
from j to i in the tangent plane of i, and points k that stuck at ``a_k`` and are now ``b_k`` deep at ``y_k``::

    u_i        = dilate_scale * dilation_i + shear_scale * shear_i                                      [m]
    dilation_i = sum_j h_j w(|o|) o + n_i sum_j h_j**normal_exponent exp(-lambda_d |o|^2)
    shear_i    = sum_k exp(-lambda_s |P_i (r_i - y_k)|^2) P_i b_k (y_k - a_k)       P_i: onto the tangent plane
    w(rho)     = exp(-lambda_d rho^2)        compressibility 1: the push stays local
                 1 / (rho^2 + eps^2)         compressibility 0: the push reaches far; eps is the spacing of the taxels
                 the response of a layer of elastomer_thickness on a rigid back instead, if you give one

The sums run over taxels and points, so that they grow with their number. ``area_weighted`` multiplies each term by the
area that it stands for, and uses the layer's unbounded form in every layout: results then do not depend on the pitch.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import warp as wp
from numpy.typing import NDArray

from firmware_protocols.bounds import Bounds
from tactemu.base.errors import SceneError
from tactemu.base.units import Metres, NonNegative, Positive, Share
from tactemu.plan.plan import Stage
from tactemu.sensors.elastomer.anchors import shear_anchors
from tactemu.sensors.elastomer.dilation_direct import direct_dilation, free_areas
from tactemu.sensors.elastomer.dilation_grid import grid_dilation
from tactemu.sensors.elastomer.dilation_kernels import DilationArrays, DilationOptions
from tactemu.sensors.elastomer.shear import Drag, direct_shear_motion, grid_shear_motion, tabulated_shear_motion
from tactemu.sensors.point_cloud import cluster
from tactemu.sensors.points.surface_points import FEWER_POINTS, surface_points
from tactemu.sensors.probe_layout import Probes
from tactemu.sensors.probes.taxel_depth import taxel_depth
from tactemu.sensors.sensor_model import Compiled, SensorModel, Setting, Site

log = logging.getLogger(__name__)
FallOff = Annotated[float, Bounds(unit="1/m^2", low=0, high=1e24)]


@dataclass(frozen=True, kw_only=True, eq=False)
class ElastomerTaxel(SensorModel[NDArray[np.floating]]):
    """The reading is the motion of each marker [m], link frame, shape ``([n_envs,] layout, 3)``.

    ``radius`` only marks fillers (0): depth is that of the marker itself.
    """

    lambda_d: FallOff = 700.0
    """Fall-off of the dilation [1/m^2]; 0: none."""
    lambda_s: FallOff = 300.0
    """Fall-off of the shear [1/m^2]; 0: none."""
    dilate_scale: NonNegative = 1.0
    """Factor on the dilation; 0 switches it off."""
    shear_scale: NonNegative = 1.0
    """Factor on the shear; 0 switches it off."""
    normal_exponent: Positive = 2.0
    """Exponent of the depth in the normal motion; > 0."""
    compressibility: Share = 1.0
    """1: Gaussian dilation, 0: far-reaching, between: a blend of the two, each divided by its peak."""
    elastomer_thickness: NonNegative = 0.0
    """Thickness of a layer bonded to a rigid back [m]; 0: unknown, the taxel spacing is used instead."""
    contact_threshold: Metres = 1e-5
    """Depth at which a point starts to stick [m]."""
    release_threshold: Metres = -1e-4
    """Depth at which it releases [m]; negative: outside the skin."""
    n_sample_points: int | Sequence[int] = 500
    """Points on all tracked bodies together, split evenly, or one number per tracked body."""
    points: Sequence | np.ndarray | None = None
    """The points themselves in the frame of the tracked body [m], ``(M, 3)``; a list of such arrays for several."""
    area_weighted: bool = False
    """Weight taxels and points by the area that they stand for [m^2]: results do not depend on their number."""
    taxel_area: float | Sequence[float] | None = None
    """Area of each taxel of a free layout [m^2]; ``None``: estimated from the spacing. For ``area_weighted``."""
    point_area: float | None = None
    """Surface that each of the ``points`` stands for [m^2]; needed with ``points`` and ``area_weighted``."""

    level = 3
    work = 5
    channels = ("displacement",)
    unit = "m"
    gain_inside = False
    layouts = {"displacement": slice(0, 3)}
    strengths = ("dilate_scale", "shear_scale")
    examples = {"": {"radius": 0.002, "shear_scale": 0.0}, " with shear": {"n_sample_points": 500}}
    valid = (
        "Motion of markers along the skin, once scales and fall-offs are fitted; the motion along the normal is a "
        "bulge for display, not the skin's surface (90 % off). Points that stick never slip."
    )
    source = "A model of optical skins. Options and numbers are those of the sensor of this name in Genesis."
    tried = [Setting(f"{count} points", {"n_sample_points": count}) for count in (500, 2000)]

    def validate(self, probes: Probes) -> None:
        where = "ElastomerTaxel"
        if self.release_threshold > self.contact_threshold:
            raise SceneError(
                f"{where}: release_threshold must be <= contact_threshold ({self.contact_threshold!r} m), "
                f"got {self.release_threshold!r} m"
            )

    def compile(self, site: Site) -> Compiled:
        """Compile the stages depth, dilation, anchors and shear, those that are switched on."""
        context = site.context
        motion = context.zeros((context.n_envs, site.probes.n), site.vec3)
        stages: list[Stage] = []
        if site.probes.n and site.target_bodies:
            parts = _Parts(self, site, motion)
            if self.dilate_scale > 0:
                stages += parts.dilation()
            if self.shear_scale > 0:
                stages += parts.shear(add=self.dilate_scale > 0)
        reading = motion.view(context.real)
        return Compiled(truth=reading, raw=reading, stages=stages)


class _Parts:
    """The stages of one ElastomerTaxel."""

    def __init__(self, model: ElastomerTaxel, site: Site, motion: wp.array):
        self.model, self.site, self.motion = model, site, motion
        probes = site.probes
        self.is_sensing = wp.array(probes.active, dtype=wp.bool, device=site.context.device)
        self.grid = probes.grid
        if probes.is_grid and self.grid is None and min(probes.layout) > 1:
            log.warning(
                "%s: the taxels form no flat, even grid with one normal; each is summed separately, which is slower",
                site.name,
            )

    def dilation(self) -> list[Stage]:
        site, model = self.site, self.model
        options = DilationOptions(
            lambda_d=model.lambda_d,
            compressibility=model.compressibility,
            elastomer_thickness=model.elastomer_thickness,
            area_weighted=model.area_weighted,
        )
        depth, find = taxel_depth(site, model.normal_exponent)
        arrays = DilationArrays(depth.depth, depth.power, self.is_sensing, self.motion)
        shared = {"scale": model.dilate_scale, "arrays": arrays}
        if self.grid is not None:
            spread = grid_dilation(site.context, self.grid, options, box=depth.box, **shared)
            how = "two separable passes over the contact"
        else:
            spread = direct_dilation(
                site.context,
                options,
                host_positions=site.probes.positions,
                areas=self._areas(),
                positions=site.positions,
                normals=site.normals,
                **shared,
            )
            how = "direct sums over the taxels in contact"
        return [
            Stage(name=f"{site.name}: depth", reason="dilate_scale > 0", launch=find),
            Stage(name=f"{site.name}: dilation", reason=f"dilate_scale > 0; {how}", launch=spread),
        ]

    def _areas(self) -> np.ndarray:
        model, probes = self.model, self.site.probes
        if not model.area_weighted:
            return np.ones(probes.n)
        if model.taxel_area is None:
            return free_areas(probes.positions, probes.normals)
        areas = np.asarray(model.taxel_area, dtype=np.float64).reshape(-1)
        if areas.size not in (1, probes.n) or not (np.isfinite(areas).all() and (areas > 0).all()):
            raise SceneError(f"{self.site.name}: taxel_area must be one area > 0 m^2 or {probes.n}, got {areas.size}")
        return np.broadcast_to(areas, (probes.n,))

    def shear(self, add: bool) -> list[Stage]:
        site, model = self.site, self.model
        if site.link.shape is None:
            raise SceneError(
                f"{site.name}: shear needs the shape of the skin's own link to find the points that stick, but "
                f"{site.link.name!r} "
                f"has none; give it one, or set shear_scale=0"
            )
        clouds = cluster(surface_points(site, model.n_sample_points, model.points, model.point_area))
        if model.area_weighted and not np.isfinite(clouds.areas).all():
            raise SceneError(f"{site.name}: area_weighted=True with points= needs point_area= [m^2]; give it")
        anchors, follow, reset = shear_anchors(
            site.context,
            site.own_table,
            site.view,
            clouds,
            contact_threshold=model.contact_threshold,
            release_margin=-model.release_threshold,
            area_weighted=model.area_weighted,
        )
        drag = self._drag(anchors, add)
        reason = f"shear_scale > 0; {clouds.n_points} points"
        return [
            Stage(name=f"{site.name}: anchors", reason=reason, launch=follow, reset=reset, cheaper=FEWER_POINTS),
            Stage(name=f"{site.name}: shear", reason="shear_scale > 0", launch=drag, cheaper=FEWER_POINTS),
        ]

    def _drag(self, anchors, add: bool) -> Callable[[], None]:
        site, model = self.site, self.model
        drag = Drag(
            context=site.context,
            anchors=anchors,
            is_sensing=self.is_sensing,
            scale=model.shear_scale,
            lambda_s=model.lambda_s,
            motion=self.motion,
            add=add,
        )
        if self.grid is None or not self.grid.is_exact:
            return direct_shear_motion(drag, site.positions, site.normals)
        by_grid = tabulated_shear_motion if site.context.device.is_cpu else grid_shear_motion
        return by_grid(drag, self.grid)
