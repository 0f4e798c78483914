"""ElasticLayerTaxel: the skin as an elastic layer on a rigid base, pressed, dragged and read on a grid of taxels.

With the layer's compliances ``C`` (along the normal) and ``A`` (along the skin), the overlap ``o`` of object and
undeformed skin, the pressures ``p``, the tractions ``q``, and ``a`` where the skin was held, ``s`` how far the object
has slid since and ``v`` how far pressure alone moves the skin sideways::

    p >= 0,  C p >= o,  p (C p - o) = 0                no pull, no penetration, no pressure across a gap
    q of least  q.A q / 2 - q.(a + s - v)  with |q| <= friction * p                        stick, and slip

on cells, ``oversampling`` along each side of a taxel. The stages, one file each::

    overlap ─▶ normal contact ─▶ friction ─▶ surface ─▶ reading
    per cell   p                 q           where the   averages
                                             skin is     per taxel

The theory is that of small strains: against a neo-Hookean skin pressed to 0.4 of its thickness forces are within 2 %
for nu = 0.49 and 13 % for nu = 0.3, surface motion along the skin is off by up to 41 % (docs/accuracy.md).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np
import warp as wp

from tactemu.base.errors import SceneError
from tactemu.base.options import number
from tactemu.geometry.shapes.rays import thickness_behind
from tactemu.geometry.shapes.shape import FAR
from tactemu.plan.clearing import clear_rows
from tactemu.plan.launches import in_turn, record
from tactemu.plan.plan import Dtype, Stage
from tactemu.sensors.layer import friction, pressure, surface
from tactemu.sensors.layer.convolution import Workspace, lanes_of
from tactemu.sensors.layer.friction import friction_kernel
from tactemu.sensors.layer.friction_state import (
    FRICTION_WINDOWS,
    OFF_CHIP,
    friction_state_type,
    friction_windows_type,
)
from tactemu.sensors.layer.grid import LayerGrid, layer_grids
from tactemu.sensors.layer.overlap import near_kernel, overlap_kernel, remember_kernel
from tactemu.sensors.layer.pressure import NO_SURFACE, NORMAL_WINDOWS, Windows, normal_kernel, windows_type
from tactemu.sensors.layer.reading import (
    CHANNELS,
    DISPLACEMENT,
    FORCE,
    PRESSURE,
    RESIDUAL,
    SLIP_STATE,
    reading_kernel,
    skin_type,
    status_kernel,
    traction_kernel,
)
from tactemu.sensors.layer.shared_memory import chip_numbers, fits
from tactemu.sensors.layer.surface import reach_of, surface_kernel
from tactemu.sensors.layer.tables import LayerMaterial, LayerTables
from tactemu.sensors.probe_layout import Probes
from tactemu.sensors.sensor_model import Compiled, SensorModel, Site, Trial

LEAST_RADIUS = 5.0
"""Of a bent pad, in thicknesses."""
MOST_ITERATIONS = 100_000
"""Most iterations of a solver in a step; bounds the time of a step."""
MOST_OVERSAMPLING = 64
"""Most cells along each side of a taxel; bounds memory."""
BLOCKS_AT_ONCE = 1056
"""Blocks on a GPU whose scratch lies in its memory: eight for each of 132 multiprocessors; more environments take
turns."""


class LayerReading(NamedTuple):
    """What the layer feels. Shapes ``([n_envs,] layout)``, vectors ``([n_envs,] layout, 3)`` in the link's frame."""

    pressure: np.ndarray
    """[Pa], positive where something presses."""
    traction: np.ndarray
    """Force per area on the skin along its surface [Pa]."""
    force: np.ndarray
    """On the taxel [N]; a push is negative along the normal."""
    displacement: np.ndarray
    """Of the skin's surface [m]; zeros with ``displacement=False``."""
    slip: np.ndarray
    """0: free, 1: sticks, 2: slips; int8."""
    residual: np.ndarray
    """What is left of the gaps that the solvers should close, relative to the overlap (pressure) or the displacement
    (traction), the larger one; the same for all taxels of a pad."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ElasticLayerTaxel(SensorModel):
    """Reads :class:`LayerReading`: pressure [Pa], traction [Pa], force [N], displacement [m], slip state, residual;
    vectors in the link's frame, forces on the skin. The taxels lie on a flat rectangular grid, or on several such pads,
    each a layer of its own; or on a gently bent one (a cylinder, a ball, a saddle), one layer in arc length. Contact is
    where taxels are."""

    young_modulus: float = 1.0e5
    """Young's modulus of the skin [Pa]."""
    poisson_ratio: float = 0.49
    """Poisson's ratio of the skin, 0 to 0.5."""
    thickness: float = 0.004
    """Thickness of the layer [m]; ``inf`` for a half-space."""
    friction: float = 0.5
    """Coulomb's coefficient; 0: no friction, and nothing is computed for it."""
    iterations: int = 16
    """At most so many conjugate-gradient iterations in a step, for pressures and again for tractions. What a step
    leaves undone the next one continues from."""
    tolerance: float = 1.0e-4
    """Residual at which a solver stops."""
    oversampling: int = 1
    """Cells per taxel along each side: contacts narrower than a taxel need 2 to 4."""
    displacement: bool = True
    """Compute where the surface is."""
    coupled: bool = True
    """Pressure moves the surface sideways too, and so pulls at what sticks (none at nu = 0.5 in a thick layer)."""
    look_depth: float | None = None
    """How far below the surface bodies are looked for [m], as ``ray_reach`` of the probes; default: to the far side of
    the link, and on a link without geometry to the thickness or the grid's diagonal, whichever is less. What has come
    deeper reads nothing."""

    level = 4
    work = 12
    channels = CHANNELS
    unit = "Pa, N, m"
    gain_inside = False
    layouts = {"pressure": PRESSURE, "force": FORCE, "displacement": DISPLACEMENT, "touch": PRESSURE}
    material = ("young_modulus", "poisson_ratio", "thickness", "friction")
    unbounded = ("thickness",)
    examples = {"": {"tolerance": 1e-4}}
    valid = (
        "A flat pad of a soft, linear material on a rigid base, pressed to 0.4 of its thickness (forces within 2 % of "
        "a neo-Hookean skin for nu = 0.49, 13 % for nu = 0.3); contacts at least one cell wide; at rest at every "
        "step. Bent around a cylinder of ten thicknesses, forces are off by 2 % for nu = 0.3, 4 % for 0.45, 8 % for "
        "0.49, twice that at five: too high where it is convex, too low where it is concave. No viscosity, no wear, no "
        "free edges."
    )
    source = (
        "The bonded elastic layer (transfer functions in closed form, sensors/layer/compliance.py), normal contact by "
        "projected conjugate gradients (Polonsky and Keer, 1999), Coulomb friction on the circles |q| = mu p. What "
        "vouches for it: docs/accuracy.md."
    )

    @classmethod
    def trials(cls, quantity: str) -> list[Trial]:
        tight = {"iterations": 32, "tolerance": 1e-4}
        dials: list[tuple[str, dict[str, float], Dtype]] = [
            ("2 iterations", {"iterations": 2, "tolerance": 1e-3}, "float32"),
            ("tolerance 1e-2", {"iterations": 16, "tolerance": 1e-2}, "float32"),
            ("tolerance 1e-4", tight, "float32"),
            ("oversampling 2", {"iterations": 32, "tolerance": 1e-3, "oversampling": 2}, "float32"),
            ("oversampling 4", {"iterations": 32, "tolerance": 1e-3, "oversampling": 4}, "float32"),
            ("tolerance 1e-4, float64", tight, "float64"),
        ]
        moved = {"displacement": quantity == "displacement"}
        return [Trial(name, moved | options, dtype) for name, options, dtype in dials]

    @classmethod
    def finest(cls, side: int) -> Trial:
        """Up to 256 cells along the longer side."""
        split = max(1, min(8, 256 // max(side, 1)))
        dials = {"iterations": 200, "tolerance": 1e-5, "oversampling": split}
        return Trial(f"layer, {split} x {split} cells per taxel, residual 1e-5", dials)

    def validate(self, probes: Probes) -> None:
        where = "ElasticLayerTaxel"
        for name, unit in (("young_modulus", "Pa"), ("thickness", "m"), ("tolerance", "")):
            if name != "thickness" or self.thickness != math.inf:
                number(where, name, getattr(self, name), above=0, unit=unit)
        number(where, "poisson_ratio", self.poisson_ratio, at_least=0, at_most=0.5)
        number(where, "friction", self.friction, at_least=0)
        for name, most in (("iterations", MOST_ITERATIONS), ("oversampling", MOST_OVERSAMPLING)):
            number(where, name, getattr(self, name), at_least=1, at_most=most, integer=True)
        if self.look_depth is not None:
            number(where, "look_depth", self.look_depth, above=0, unit="m")
        if self.contact_depth_query not in (None, "ray"):
            raise SceneError(
                f"{where}: contact_depth_query must be 'ray' (or left out), got {self.contact_depth_query!r}: "
                "a contact is solved with the depth along the normal"
            )
        for grid in layer_grids(probes, 1, where):
            radius = min((abs(1.0 / bend) for bend in grid.curvature if bend), default=math.inf)
            if radius < 0.999 * LEAST_RADIUS * self.thickness:
                raise SceneError(
                    f"{where}: a skin of {self.thickness:g} m that is bent with a radius of {radius:.2g} m: one layer "
                    f"in arc length is right from a radius of {LEAST_RADIUS:g} thicknesses on. Use ElastomerTaxel"
                )

    @staticmethod
    def _reading(values: np.ndarray, normals: np.ndarray, areas: np.ndarray) -> LayerReading:
        """Return an array of channels as a reading; normals and areas of the taxels in the layout."""
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
        stages = [
            stage for name, grid in zip(names, grids) for stage in CompiledLayer(self, grid, site, reading, name).stages
        ]
        finish_kernel = status_kernel(site.context.real)

        def finish(array: wp.array, branch: str):
            if array is reading:
                return array, []
            launch = site.context.record(finish_kernel, array.shape[:2], [reading], [array])
            reason = "slip state and residual are no measurements"
            return array, [Stage(name=f"{site.name}: status", reason=reason, launch=launch)]

        how = {"finish": finish, "present": present, "derived": derived}
        return Compiled(truth=reading, raw=reading, stages=stages, **how)

    @staticmethod
    def _traction(site: Site, areas: np.ndarray, reading: wp.array, branch: str) -> tuple[wp.array, Stage]:
        """Tractions on the device, for :meth:`Sensor.view`; with a history, of all that it holds."""
        context, flat = site.context, reading.reshape((-1, *reading.shape[-2:]))
        out = wp.zeros((*reading.shape[:-1], 3), dtype=context.real, device=context.device)
        inputs = [flat, site.normals, wp.array(areas, dtype=context.real, device=context.device)]
        outputs = [out.reshape((*flat.shape[:2], 3))]
        launch = record(traction_kernel(context.real), flat.shape[:2], inputs, outputs, context.device)
        return out, Stage(name=f"{site.name}: traction ({branch})", reason="it was asked for", launch=launch)


@dataclass(eq=False)
class CompiledLayer:
    """Arrays and stages of one layer in a scene."""

    model: ElasticLayerTaxel
    grid: LayerGrid
    site: Site
    reading: wp.array
    """Of the whole skin; this layer writes its own taxels."""
    name: str
    stages: list[Stage] = field(default_factory=list)

    def __post_init__(self):
        context, model = self.site.context, self.model
        self.real, self.device, self.n_envs = context.real, context.device, context.n_envs
        self.lanes = lanes_of(self.device)
        self.rubs = model.friction > 0
        needs = [pressure.ON_CHIP, *([friction.ON_CHIP] * self.rubs), *([surface.ON_CHIP] * bool(model.displacement))]
        numbers = max(chip_numbers(*each) for each in needs)
        self.chip = fits(self.grid.shape, numbers, self.real, self.lanes, self.device)
        at_once = self.n_envs if self.chip else min(self.n_envs, BLOCKS_AT_ONCE)
        self.n_slots = context.threads if self.device.is_cpu else at_once
        nu, young = float(model.poisson_ratio), float(model.young_modulus)
        self.material = LayerMaterial(young / (2 * (1 + nu)), nu, float(model.thickness))
        self.tables = self._tables(tangential=self.rubs or model.displacement)
        self._allocate()
        coarser = "lower `oversampling`"
        solver = "lower `iterations` or `oversampling`, or raise `tolerance`"
        self._add(self._overlap, "overlap", "depth of each cell along the normal", coarser)
        self._add(self._normal, "pressure", f"bonded layer, at most {model.iterations} iterations", solver)
        if self.rubs:
            why = f"Coulomb friction {model.friction:g} with stick and slip"
            self._add(self._friction, "friction", why, f"set `friction = 0`, {solver}")
        if model.displacement:
            why = "displacement is on; within reach of the contact"
            self._add(self._surface, "surface", why, f"set `displacement = false`, or {coarser}")
        self._add(self._read, "taxels", f"{self.grid.split}x{self.grid.split} cells per taxel", coarser)
        self.stages[1].reset = self._reset

    def _tables(self, *, tangential: bool) -> LayerTables:
        """Return the layer's compliances; layers that are alike share them."""
        constants, cells = self.site.context.constants, self.grid.shape
        key = (LayerTables, self.material, cells, self.grid.cell, tangential)
        if key not in constants:
            constants[key] = LayerTables(
                self.material,
                cells,
                self.grid.cell,
                tangential=tangential,
                real=self.real,
                device=self.device,
            )
        return constants[key]

    # -- arrays -----------------------------------------------------------------------------------------------------

    def _cells(self, dtype, used: bool = True) -> wp.array:
        shape = (self.n_envs, *self.grid.shape) if used else (0, 0, 0)
        return self.site.context.zeros(shape, dtype)

    def _per_env(self, dtype) -> wp.array:
        return self.site.context.zeros(self.n_envs, dtype)

    def _allocate(self) -> None:
        real, vec2 = self.real, wp.types.vector(2, self.real)
        spectra = 3 if self.model.displacement else 2 if self.rubs else 1
        slots = 0 if self.chip else self.n_slots
        self.workspace = Workspace(slots, self.tables.n_max, real, self.lanes, self.device, spectra=spectra)
        struct = windows_type(real)()
        self.windows = Windows(struct, NORMAL_WINDOWS, slots, self.grid.shape, real, self.lanes, self.device)
        self.pressure = self._cells(real)
        self.overlap = self.site.context.full(self.pressure.shape, NO_SURFACE, real)
        self.solved = self.site.context.full(self.pressure.shape, math.nan, real)
        self.near, self.active = self._per_env(wp.vec4i), self._per_env(wp.vec4i)
        self.body, self.slide = self._cells(wp.int32, self.rubs), self._cells(vec2, self.rubs)
        self.box, self.area, self.dirty = (self._per_env(wp.vec4i) for _ in range(3))
        self.residual, self.iterations = self._per_env(wp.float64), self._per_env(wp.int32)
        self.changed, self.rubbed = self._per_env(wp.int32), self._per_env(wp.int32)
        self.state = friction_state_type(real)()
        for name in ("x", "y", "anchor_x", "anchor_y"):
            setattr(self.state, name, self._cells(real, self.rubs))
        self.state.held_by, self.state.slip = self._cells(wp.int32, self.rubs), self._cells(wp.int32, self.rubs)
        self.state.box, self.state.residual = self._per_env(wp.vec4i), self._per_env(wp.float64)
        self.state.iterations = self._per_env(wp.int32)
        self.surface = [self._cells(real, self.model.displacement) for _ in range(3)]
        if self.rubs:
            struct = friction_windows_type(real)()
            shape, names = self.grid.shape, OFF_CHIP if self.chip else FRICTION_WINDOWS
            self.rubbing = Windows(struct, names, self.n_slots, shape, real, self.lanes, self.device)

    def _reset(self, mask: wp.array) -> None:
        state = self.state
        for array in (self.pressure, *self.surface):
            clear_rows(array, mask)
        for array in (state.x, state.y, state.anchor_x, state.anchor_y, state.held_by, state.slip):
            clear_rows(array, mask)
        for array in (self.residual, self.iterations, self.changed, self.rubbed, state.residual, state.iterations):
            clear_rows(array, mask)
        for array in (self.near, self.active, self.box, self.area, self.dirty, state.box):
            clear_rows(array, mask)
        clear_rows(self.overlap, mask, NO_SURFACE)
        clear_rows(self.solved, mask, math.nan)

    # -- stages -----------------------------------------------------------------------------------------------------

    def _add(self, make: Callable[[], Callable[[], None]], name: str, reason: str, cheaper: str) -> None:
        self.stages.append(Stage(name=f"{self.name}: {name}", reason=reason, launch=make(), cheaper=cheaper))

    def _blocks(self, kernel, inputs: list, outputs: list) -> Callable[[], None]:
        """Return a recorded launch with one block of threads per slot."""
        threads = kernel.options["launch_bounds"][0]
        return self.site.context.record_blocks(kernel, self.n_slots, inputs, outputs, threads)

    def _reach(self, horizon: float) -> wp.array:
        """How far below each cell bodies are looked for [m]."""
        site, shape = self.site, self.grid.shape
        if self.model.look_depth is not None or site.link.shape is None:
            return wp.full(shape, horizon, dtype=self.real, device=self.device)
        centres = self.centres.flatten()
        normals = wp.full(len(centres), site.vec3(*self.grid.normal), dtype=site.vec3, device=self.device)
        if self.grid.bent:
            normals = wp.array(self.grid.cell_axes()[2].reshape(-1, 3), dtype=site.vec3, device=self.device)
        thickness = thickness_behind(site.own_table, site.link.index, centres, normals, site.context).numpy()
        limited = np.where(thickness < FAR, thickness, horizon).reshape(shape)
        return wp.array(limited, dtype=self.real, device=self.device)

    def _overlap(self) -> Callable[[], None]:
        site, grid, real = self.site, self.grid, self.real
        vec3 = site.vec3
        diagonal = float(np.hypot(grid.rows * grid.pitch[0], grid.columns * grid.pitch[1]))
        horizon = real(self.model.look_depth or min(float(self.model.thickness), diagonal))
        self.centres = wp.array(grid.cell_centres(), dtype=vec3, device=self.device)
        self.covered = wp.array(grid.covered(), dtype=wp.bool, device=self.device)
        self.reach = self._reach(horizon)
        pose = site.view.pose
        self.last_pose = site.context.zeros(pose.shape if self.rubs else (0, 0), pose.dtype)
        axes = [vec3(*grid.u), vec3(*grid.v), vec3(*grid.normal)]
        cell = wp.types.vector(2, real)(*grid.cell)
        inputs = [
            site.table.struct,
            pose,
            site.targets,
            vec3(*grid.edge),
            *axes,
            cell,
            wp.vec2i(*grid.shape),
            horizon,
        ]
        outputs = [self.near, self.active]
        near = self.site.context.record(near_kernel(real, grid.bent), self.n_envs, inputs, outputs, block_dim=32)
        inputs = [site.table.struct, pose, self.last_pose, site.targets, self.active, self.centres, self.covered]
        own = wp.array(grid.cell_axes() if grid.bent else np.zeros((0, 0, 0, 3)), dtype=vec3, device=self.device)
        parts = 1 if self.device.is_cpu else grid.shape[1]
        inputs += [self.reach, *axes, own, horizon, real(self.tables.length_scale), parts]
        kernel = overlap_kernel(real, site.table.kinds, self.rubs, grid.bent)
        rows = (self.n_envs, grid.shape[0], parts)
        find = self.site.context.record(kernel, rows, inputs, [self.overlap, self.body, self.slide])

        if not self.rubs:
            return in_turn(near, find)
        remember = self.site.context.record(remember_kernel(real), pose.shape, [pose], [self.last_pose])
        return in_turn(near, find, remember)

    def _normal(self) -> Callable[[], None]:
        model, real = self.model, self.real
        # A skin that hardly loses volume rises beside the contact: look for it where the object is that near.
        bulge = 0.1 + 0.9 * min(max((model.poisson_ratio - 0.3) / 0.2, 0.0), 1.0)
        inputs = [self.tables.struct, real(bulge), int(model.iterations), wp.float64(model.tolerance)]
        inputs += [self.overlap, self.active, self.workspace.struct, self.windows.struct]
        outputs = [self.solved, self.pressure, self.box, self.residual, self.iterations, self.changed]
        outputs += [self.dirty]
        return self._blocks(normal_kernel(real, self.lanes, self.chip), inputs, outputs)

    def _friction(self) -> Callable[[], None]:
        model, real = self.model, self.real
        tolerance = wp.float64(model.tolerance)
        inputs = [self.tables.struct, real(model.friction), int(model.iterations), tolerance]
        inputs += [self.pressure, self.box, self.changed, self.slide, self.body]
        inputs += [self.workspace.struct, self.rubbing.struct, self.state]
        return self._blocks(friction_kernel(real, self.lanes, bool(model.coupled), self.chip), inputs, [self.rubbed])

    def _surface(self) -> Callable[[], None]:
        reach = reach_of(self.tables.kernels)
        inputs = [self.tables.struct, wp.vec2i(*reach), self.pressure, self.state, self.box]
        inputs += [self.rubbed if self.rubs else self.changed, self.workspace.struct, self.windows.struct]
        return self._blocks(
            surface_kernel(self.real, self.lanes, self.rubs, self.chip), inputs, [self.area, self.dirty, *self.surface]
        )

    def _read(self) -> Callable[[], None]:
        grid = self.grid
        skin = skin_type(self.real)()
        skin.u, skin.v, skin.normal = (self.site.vec3(*axis) for axis in (grid.u, grid.v, grid.normal))
        skin.length, skin.pressure = self.tables.length_scale, self.tables.pressure_scale
        skin.area, skin.columns, skin.split = grid.area, grid.columns, grid.split
        self.place = wp.array(grid.place, dtype=wp.int32, device=self.device)
        own = grid.taxel_axes() if grid.bent else np.zeros((0, 0, 3))
        own = wp.array(own, dtype=self.site.vec3, device=self.device)
        inputs = [skin, self.place, own, self.pressure, self.residual, self.state, *self.surface]
        inputs += [self.rubbed if self.rubs else self.changed, self.dirty]
        kernel = reading_kernel(self.real, bool(self.model.displacement), self.rubs, grid.bent)
        return self.site.context.record(kernel, self.reading.shape[:2], inputs, [self.reading])
