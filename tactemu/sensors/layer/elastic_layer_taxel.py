"""ElasticLayerTaxel: the skin as an elastic layer on a rigid base, pressed, dragged and read on a grid of taxels.

With the layer's compliances ``C`` (along the normal) and ``A`` (along the skin), the overlap ``o`` of object and
undeformed skin, the pressures ``p``, the tractions ``q``, the place ``a`` where the skin was held, the slide ``s`` of
the object since, and the displacement ``v`` of the skin along its surface by pressure alone::

    p >= 0,  C p >= o,  p (C p - o) = 0                no pull, no penetration, no pressure across a gap
    q of least  q.A q / 2 - q.(a + s - v)  with |q| <= friction * p                        stick, and slip

With a ``kinetic_friction`` the coefficient of a cell falls linearly to it over ``slip_distance`` of slip.

Objects are rigid, or soft (``object_young_modulus``): their compliance then adds to ``C`` and ``A``, and the
displacement of the surface remains that of the skin alone (docs/contact.md).

With ``relaxation`` the modulus falls after a strain, relative to ``young_modulus``, as ``G(t) = 1 - sum g_k (1 -
exp(-t / tau_k))``. With the pressures ``P`` of an elastic layer with the same displacement, and what each term keeps::

    p = P - sum g_k m_k,   dm_k/dt = (P - m_k) / tau_k,   w = C P                      likewise the tractions

``P`` is straight within a step, and the rest is exact; a skin that was just reset is free. Two stages more, ``memory``
before the contact and ``relaxation`` after it, are built only then.

They are solved on cells, ``oversampling`` along each side of a taxel. The stages, one file each::

    overlap ─▶ normal contact ─▶ friction ─▶ surface ───────▶ reading
    per cell   p                 q           displacement    averages
                                                             per taxel

The theory is that of small strains: compared with a neo-Hookean skin pressed to 0.4 of its thickness, forces are within
2 % for nu = 0.49 and 13 % for nu = 0.3, and surface motion along the skin is off by up to 41 % (docs/accuracy.md).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from firmware_protocols.bounds import Bounds
from tactemu.base.errors import SceneError
from tactemu.base.units import Length, NonNegative, Pascals, Positive, Share
from tactemu.plan.launches import record
from tactemu.plan.plan import Dtype, Stage
from tactemu.sensors.layer.compiled_layer import CompiledLayer
from tactemu.sensors.layer.grid import layer_grids
from tactemu.sensors.layer.reading import (
    CHANNELS,
    DISPLACEMENT,
    FORCE,
    PRESSURE,
    RESIDUAL,
    SLIP_STATE,
    status_kernel,
    traction_kernel,
)
from tactemu.sensors.layer.relaxation import RelaxationTime, SpectrumName, spectrum_of
from tactemu.sensors.probe_layout import Probes
from tactemu.sensors.sensor_model import Compiled, SensorModel, Setting, Site, TouchPoints

MIN_BEND_RADIUS_THICKNESSES = 5.0
"""Smallest radius of a bent pad, in thicknesses; the theory of one layer in arc length fails below it."""
MAX_ITERATIONS = 100_000
"""Maximum number of iterations of a solver in a step; bounds the time of a step."""
MAX_OVERSAMPLING = 64
"""Maximum number of cells along each side of a taxel; bounds memory."""


class LayerReading(NamedTuple):
    """A reading of the layer: fields of shape ``([n_envs,] [history,] layout)``, vectors ``(..., 3)`` in the link's
    frame."""

    pressure: NDArray[np.floating]
    """Pressure [Pa], positive where a body presses."""
    traction: NDArray[np.floating]
    """Force per area on the skin along its surface [Pa]."""
    force: NDArray[np.floating]
    """Force on the taxel [N]; a push is negative along the normal."""
    displacement: NDArray[np.floating]
    """Displacement of the skin's surface [m]; zeros with ``displacement=False``."""
    slip: NDArray[np.int8]
    """Slip state, 0: free, 1: sticks, 2: slips; int8."""
    residual: NDArray[np.floating]
    """Remainder of the gaps that the solvers should close, relative to the overlap (pressure) or the displacement
    (traction), the larger one; the same for all taxels of a pad."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ElasticLayerTaxel(SensorModel[LayerReading]):
    """The reading is a :class:`LayerReading`: pressure [Pa], traction [Pa], force [N], displacement [m], slip state,
    residual; vectors in the link's frame, forces on the skin. The taxels lie on a flat rectangular grid, or on several
    such pads, each a layer of its own; or on a gently bent grid (a cylinder, a ball, a saddle), one layer in arc
    length. Contact is computed only where taxels are."""

    young_modulus: Pascals = 1.0e5
    """Young's modulus of the skin [Pa]."""
    poisson_ratio: Annotated[float, Bounds(low=0, high=0.5)] = 0.49
    """Poisson's ratio of the skin, 0 to 0.5."""
    thickness: Annotated[float, Bounds(unit="m", above=0, high=math.inf)] = 0.004
    """Thickness of the layer [m]; ``inf`` for a half-space."""
    friction: NonNegative = 0.5
    """Coulomb's coefficient; 0: no friction, and no cost for it."""
    kinetic_friction: NonNegative | None = None
    """Coefficient of a cell that slips, at most ``friction``, which then is that of one that sticks; ``None``: the
    same."""
    slip_distance: Length = 1.0e-4
    """Slip over which a cell's coefficient falls from ``friction`` to ``kinetic_friction`` [m], until it sticks again.
    Where a step moves the body farther than this, the peak of the force depends on the step."""
    object_young_modulus: Pascals | None = None
    """Young's modulus of all objects that press on the skin [Pa]; ``None``: they are rigid."""
    object_poisson_ratio: Annotated[float, Bounds(low=0, high=0.5)] = 0.5
    """Poisson's ratio of soft objects, 0 to 0.5."""
    object_radius: Length | None = None
    """Radius of soft objects [m], whose own deformation is that of a free ball; ``None``: that of a half-space."""
    iterations: Annotated[int, Bounds(low=1, high=MAX_ITERATIONS)] = 16
    """Maximum number of conjugate-gradient iterations in a step, for pressures and again for tractions. The next step
    continues from an unfinished solution."""
    tolerance: Positive = 1.0e-4
    """Residual at which a solver stops."""
    oversampling: Annotated[int, Bounds(low=1, high=MAX_OVERSAMPLING)] = 1
    """Number of cells per taxel along each side: contacts narrower than a taxel need 2 to 4."""
    displacement: bool = True
    """Compute the displacement of the surface."""
    coupled: bool = True
    """Let pressure move the surface sideways too, and so pull at sticking cells (not at all at nu = 0.5 in a thick
    layer)."""
    relaxation: Sequence[tuple[Share, RelaxationTime]] | SpectrumName = ()
    """Relaxation of the modulus: pairs of the share of ``young_modulus`` that relaxes and its time constant [s], or the
    name of a material. ``young_modulus`` is then that of a sudden press; at rest ``1 - sum of the shares`` of it is
    left. Empty: the skin is elastic, at no cost."""
    look_depth: Length | None = None
    """Depth below the surface to which bodies are sensed [m], like ``ray_reach`` of the probes; default: to the far
    side of the link, and on a link without geometry to the thickness or the grid's diagonal, whichever is less. A body
    that has come deeper reads nothing."""

    level = 4
    work = 12
    channels = CHANNELS
    unit = "Pa, N, m"
    gain_inside = False
    layouts = {"pressure": PRESSURE, "force": FORCE, "displacement": DISPLACEMENT, "touch": PRESSURE}
    more_fields = {"slip": slice(SLIP_STATE, SLIP_STATE + 1), "residual": slice(RESIDUAL, RESIDUAL + 1)}
    load_fields = ("pressure", "force", "displacement")
    material = ("young_modulus", "poisson_ratio", "thickness", "friction")
    examples = {"": {"tolerance": 1e-4}}
    valid = (
        "A flat pad of a soft, linear material on a rigid base, pressed to 0.4 of its thickness (forces within 2 % of "
        "a neo-Hookean skin for nu = 0.49, 13 % for nu = 0.3); contacts at least one cell wide; without "
        "inertia. Bent around a cylinder of ten thicknesses, forces are off by 2 % for nu = 0.3, 4 % for 0.45, 8 % "
        "for 0.49, twice that at five: too high where it is convex, too low where it is concave. Speed matters "
        "through `relaxation` alone: linear, at a Poisson's ratio that stays. No wear, no free edges."
    )
    source = (
        "The bonded elastic layer (transfer functions in closed form, sensors/layer/compliance.py), normal contact by "
        "projected conjugate gradients (Polonsky and Keer, 1999), Coulomb friction on the circles |q| = mu p. Its "
        "verification: docs/accuracy.md."
    )

    @classmethod
    def trials(cls, quantity: str) -> list[Setting]:
        tight = {"iterations": 32, "tolerance": 1e-4}
        settings: list[tuple[str, dict[str, float], Dtype]] = [
            ("2 iterations", {"iterations": 2, "tolerance": 1e-3}, "float32"),
            ("tolerance 1e-2", {"iterations": 16, "tolerance": 1e-2}, "float32"),
            ("tolerance 1e-4", tight, "float32"),
            ("oversampling 2", {"iterations": 32, "tolerance": 1e-3, "oversampling": 2}, "float32"),
            ("oversampling 4", {"iterations": 32, "tolerance": 1e-3, "oversampling": 4}, "float32"),
            ("tolerance 1e-4, float64", tight, "float64"),
        ]
        moved = {"displacement": quantity == "displacement"}
        return [Setting(name, moved | options, dtype) for name, options, dtype in settings]

    @classmethod
    def finest(cls, side: int) -> Setting:
        """Return the setting with up to 256 cells along the longer side."""
        split = max(1, min(8, 256 // max(side, 1)))
        options = {"iterations": 200, "tolerance": 1e-5, "oversampling": split}
        return Setting(f"layer, {split} x {split} cells per taxel, residual 1e-5", options)

    @property
    def relaxes(self) -> bool:
        return spectrum_of(self.relaxation, type(self).__name__) is not None

    def validate(self, probes: Probes) -> None:
        where = "ElasticLayerTaxel"
        if self.depth_query not in (None, "ray"):
            raise SceneError(
                f"{where}: depth_query must be 'ray' (or left out), got {self.depth_query!r}: "
                "it solves contact with the depth along the normal"
            )
        if self.object_radius is not None and self.object_young_modulus is None:
            raise SceneError(f"{where}: object_radius is that of soft objects; give object_young_modulus [Pa], too")
        if self.kinetic_friction is not None and self.kinetic_friction > self.friction:
            raise SceneError(
                f"{where}: kinetic_friction must be at most friction ({self.friction:g}), got {self.kinetic_friction:g}"
            )
        for grid in layer_grids(probes, 1, where):
            radius = min((abs(1.0 / bend) for bend in grid.curvature if bend), default=math.inf)
            if radius < 0.999 * MIN_BEND_RADIUS_THICKNESSES * self.thickness:
                raise SceneError(
                    f"{where}: the skin is {self.thickness:g} m thick and bent with a radius of {radius:.2g} m; one "
                    f"layer in arc length needs a radius of {MIN_BEND_RADIUS_THICKNESSES:g} thicknesses or more. "
                    "Use ElastomerTaxel"
                )

    @staticmethod
    def _reading(values: np.ndarray, normals: np.ndarray, areas: np.ndarray) -> LayerReading:
        """Return an array of channels as a reading; normals and areas of the taxels have their layout."""
        force = values[..., FORCE]
        along = force - (force * normals).sum(-1, keepdims=True) * normals
        return LayerReading(
            pressure=values[..., 0],
            traction=(along / areas).astype(values.dtype),
            force=force,
            displacement=values[..., DISPLACEMENT],
            slip=values[..., SLIP_STATE].astype(np.int8),
            residual=values[..., RESIDUAL],
        )

    def compile(self, site: Site) -> Compiled:
        probes, reading = site.probes, site.zeros()
        grids = layer_grids(probes, int(self.oversampling), site.name)
        areas = np.ones(probes.n)
        for grid in grids:
            areas[grid.place >= 0] = grid.area
        derived = {"traction": partial(self._traction, site, areas)}
        normals, areas = probes.normals.reshape(*probes.layout, 3), areas.reshape(*probes.layout, 1)
        present = partial(self._reading, normals=normals, areas=areas)
        names = [site.name if len(grids) == 1 else f"{site.name} pad {k + 1}" for k in range(len(grids))]
        layers = [CompiledLayer(self, grid, site, reading, name) for name, grid in zip(names, grids)]
        stages = [stage for layer in layers for stage in layer.stages]
        finish_kernel = status_kernel(site.context.real)

        def finish(array: wp.array, branch: str):
            if array is reading:
                return array, []
            launch = site.context.record(finish_kernel, array.shape[:2], [reading], [array])
            reason = "slip state and residual are no measurements"
            return array, [Stage(name=f"{site.name}: status", reason=reason, launch=launch)]

        def touch_points() -> list[TouchPoints]:
            return [layer.touch_points() for layer in layers]

        how = {"finish": finish, "present": present, "derived": derived, "touch_points": touch_points}
        return Compiled(truth=reading, raw=reading, stages=stages, **how)

    @staticmethod
    def _traction(site: Site, areas: np.ndarray, reading: wp.array, branch: str) -> tuple[wp.array, Stage]:
        """Return the tractions on the device for :attr:`Sensor.arrays`, and the stage that fills them; with a history,
        those of all its entries."""
        context, flat = site.context, reading.reshape((-1, *reading.shape[-2:]))
        out = wp.zeros((*reading.shape[:-1], 3), dtype=context.real, device=context.device)
        inputs = [flat, site.normals, wp.array(areas, dtype=context.real, device=context.device)]
        outputs = [out.reshape((*flat.shape[:2], 3))]
        launch = record(traction_kernel(context.real), flat.shape[:2], inputs, outputs, context.device)
        return out, Stage(name=f"{site.name}: traction ({branch})", reason="a view of it was asked for", launch=launch)
