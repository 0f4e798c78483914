"""One elastic layer in a scene: its arrays, and the stages from overlap to reading."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import warp as wp

from tactemu.geometry.shapes.rays import thickness_behind
from tactemu.geometry.shapes.shape import FAR
from tactemu.plan.clearing import clear_rows
from tactemu.plan.launches import in_turn
from tactemu.plan.plan import Stage
from tactemu.sensors.layer import friction, pressure, recall, surface
from tactemu.sensors.layer.blended_tables import BlendedTables
from tactemu.sensors.layer.convolution import Workspace, lane_width
from tactemu.sensors.layer.friction import friction_kernel
from tactemu.sensors.layer.friction_state import (
    FRICTION_WINDOWS,
    friction_state_type,
    friction_windows_type,
)
from tactemu.sensors.layer.grid import LayerGrid
from tactemu.sensors.layer.overlap import (
    NO_SURFACE,
    ball_rows_kernel,
    cells_type,
    keep_poses_kernel,
    near_kernel,
    overlap_kernel,
    overlap_type,
)
from tactemu.sensors.layer.overlap_simd import is_ball_overlap
from tactemu.sensors.layer.pressure import NORMAL_WINDOWS, Windows, normal_kernel, pressure_state_type, windows_type
from tactemu.sensors.layer.reading import reading_kernel, skin_type
from tactemu.sensors.layer.relaxation import SpectrumName, spectrum_of
from tactemu.sensors.layer.relaxing_layer import RelaxingLayer
from tactemu.sensors.layer.shared_memory import complex_numbers, fits, shared_numbers
from tactemu.sensors.layer.surface import response_reach, surface_kernel, surface_type
from tactemu.sensors.layer.tables import LayerMaterial, LayerTables, layer_type
from tactemu.sensors.sensor_model import Site, TouchPoints

MAX_BLOCKS = 1056
"""Maximum number of blocks on a GPU whose scratch lies in its global memory: eight for each of 132 multiprocessors;
more environments take turns."""


class LayerOptions(Protocol):
    """The options of an ElasticLayerTaxel that a layer uses; it documents them."""

    @property
    def young_modulus(self) -> float: ...

    @property
    def poisson_ratio(self) -> float: ...

    @property
    def thickness(self) -> float: ...

    @property
    def friction(self) -> float: ...

    @property
    def kinetic_friction(self) -> float | None: ...

    @property
    def slip_distance(self) -> float: ...

    @property
    def object_young_modulus(self) -> float | None: ...

    @property
    def object_poisson_ratio(self) -> float: ...

    @property
    def object_radius(self) -> float | None: ...

    @property
    def iterations(self) -> int: ...

    @property
    def tolerance(self) -> float: ...

    @property
    def displacement(self) -> bool: ...

    @property
    def coupled(self) -> bool: ...

    @property
    def relaxation(self) -> SpectrumName | Sequence: ...

    @property
    def look_depth(self) -> float | None: ...


@dataclass(eq=False)
class CompiledLayer:
    """The arrays and stages of one layer in a scene."""

    model: LayerOptions
    grid: LayerGrid
    site: Site
    reading: wp.array
    """Reading of the skin; this layer writes its own taxels."""
    name: str
    stages: list[Stage] = field(default_factory=list)

    def __post_init__(self):
        context, model = self.site.context, self.model
        self.real, self.device, self.n_envs = context.real, context.device, context.n_envs
        self.lanes = lane_width(self.device)
        self.has_friction, self.is_coupled = model.friction > 0, bool(model.coupled)
        self.kinetic = model.friction if model.kinetic_friction is None else float(model.kinetic_friction)
        self.weakens = self.kinetic < model.friction
        spectrum = spectrum_of(model.relaxation, self.name)
        numbers = max(
            complex_numbers(len(pressure.NORMAL_WINDOWS)),
            complex_numbers(friction.SHARED_WINDOWS) * self.has_friction,
            complex_numbers(surface.SHARED_WINDOWS) * bool(model.displacement),
            shared_numbers(*recall.SHARED_ARRAYS) * (spectrum is not None),
        )
        self.is_shared = fits(self.grid.shape, numbers, self.real, self.lanes, self.device)
        at_once = self.n_envs if self.is_shared else min(self.n_envs, MAX_BLOCKS)
        self.n_slots = context.threads if self.device.is_cpu else at_once
        nu, young = float(model.poisson_ratio), float(model.young_modulus)
        shear = young / (2 * (1 + nu))
        skin = LayerMaterial(shear, nu, float(model.thickness))
        self.material = skin
        if model.object_young_modulus is not None:
            nu, radius = float(model.object_poisson_ratio), float(model.object_radius or math.inf)
            ratio = shear * 2 * (1 + nu) / float(model.object_young_modulus)
            self.material = LayerMaterial(*skin[:3], ratio, nu, radius)
        self.tables = self.skin_tables = self._tables(self.material, tangential=self.has_friction or model.displacement)
        if self.material != skin and (model.displacement or spectrum):  # surface and memory are those of the skin alone
            self.skin_tables = self._tables(skin, tangential=True, unit_compliance=self.tables.unit_compliance)
        self._allocate(spectra=3 if model.displacement or spectrum else 2 if self.has_friction else 1)
        relaxing = self.relaxing = RelaxingLayer(self, spectrum) if spectrum else None
        blended = self.blended = None
        if relaxing and self.tables is not self.skin_tables:
            blended = self.blended = BlendedTables(self.skin_tables, self.tables, self.real, self.device)
        self.contact_tables = blended.struct if blended else self.tables.struct
        coarser = "lower `oversampling`"
        solver = "lower `iterations` or `oversampling`, or raise `tolerance`"
        self._add(self._overlap, "overlap", "depth of each cell along the normal", coarser)
        fewer = f"give `relaxation` fewer terms, or {coarser}"
        if relaxing:
            self._add(lambda: relaxing.recall(self._layer(True)), "memory", f"the skin relaxes: {spectrum}", fewer)
        if relaxing and blended:
            why = "objects do not relax; made anew for a step of another length"
            self._add(lambda: blended.blend(self.site.context.dt, relaxing.memory), "compliance", why, "")
        soft = "" if model.object_young_modulus is None else f" under objects of {model.object_young_modulus:g} Pa"
        self._add(self._normal, "pressure", f"bonded layer{soft}, at most {model.iterations} iterations", solver)
        if self.has_friction:
            falls = f", {self.kinetic:g} once it slips," if self.weakens else ""
            why = f"Coulomb friction {model.friction:g}{falls} with stick and slip"
            self._add(self._friction, "friction", why, f"set `friction = 0`, {solver}")
        if relaxing:
            why = "what each term keeps of this step"
            self._add(relaxing.remember, "relaxation", why, fewer)
        if model.displacement:
            why = "displacement is on; within reach of the contact"
            self._add(self._surface, "surface", why, f"set `displacement = false`, or {coarser}")
        self._add(self._read, "taxels", f"{self.grid.split}x{self.grid.split} cells per taxel", coarser)
        self.stages[1].reset = self._reset

    def _tables(
        self, material: LayerMaterial, *, tangential: bool, unit_compliance: float | None = None
    ) -> LayerTables:
        """Return the compliances of a material; equal layers share them."""
        constants, cells = self.site.context.constants, self.grid.shape
        key = (LayerTables, material, cells, self.grid.cell, tangential, unit_compliance)
        if key not in constants:
            constants[key] = LayerTables(
                material,
                cells,
                self.grid.cell,
                tangential=tangential,
                real=self.real,
                device=self.device,
                unit_compliance=unit_compliance,
            )
        return constants[key]

    # -- arrays -----------------------------------------------------------------------------------------------------

    def _cells(self, dtype, used: bool = True) -> wp.array:
        shape = (self.n_envs, *self.grid.shape) if used else (0, 0, 0)
        return self.site.context.zeros(shape, dtype)

    def _per_env(self, dtype) -> wp.array:
        return self.site.context.zeros(self.n_envs, dtype)

    def _allocate(self, *, spectra: int) -> None:
        real, vec2 = self.real, wp.types.vector(2, self.real)
        slots = 0 if self.is_shared else self.n_slots
        workspace = Workspace(slots, self.tables.n_max, real, self.lanes, self.device, spectra=spectra)
        self.windows = Windows(windows_type(real)(), NORMAL_WINDOWS, workspace, slots, self.grid.shape)
        over, pressed = self.over, self.pressed = overlap_type(real)(), pressure_state_type(real)()
        state, surface = self.state, self.surface = friction_state_type(real)(), surface_type(real)()
        # A saved state holds these arrays in this order.
        pressed.pressure = self._cells(real)
        over.overlap = self.site.context.full(pressed.pressure.shape, NO_SURFACE, real)
        pressed.solved = self.site.context.full(pressed.pressure.shape, math.nan, real)
        over.near, over.active = self._per_env(wp.vec4i), self._per_env(wp.vec4i)
        over.body, over.slide = self._cells(wp.int32, self.has_friction), self._cells(vec2, self.has_friction)
        pressed.box, surface.area, pressed.dirty = (self._per_env(wp.vec4i) for _ in range(3))
        pressed.residual, pressed.iterations = self._per_env(wp.float64), self._per_env(wp.int32)
        pressed.changed, state.changed = self._per_env(wp.int32), self._per_env(wp.int32)
        for name in ("x", "y", "anchor_x", "anchor_y"):
            setattr(state, name, self._cells(real, self.has_friction))
        for name in ("held_by", "slip"):
            setattr(state, name, self._cells(wp.int32, self.has_friction))
        if self.weakens:
            state.slipped = self._cells(real)
        state.box, state.residual = self._per_env(wp.vec4i), self._per_env(wp.float64)
        state.iterations = self._per_env(wp.int32)
        for name in "uvw":
            setattr(surface, name, self._cells(real, self.model.displacement))
        if self.has_friction:
            struct = friction_windows_type(real)()
            self.friction_windows = Windows(struct, FRICTION_WINDOWS, workspace, slots, self.grid.shape)

    def _layer(self, of_skin: bool = False):
        """Return the layer and the options of its solvers, as kernels take them; the tables are those that contact
        needs or, with ``of_skin``, those of the skin alone."""
        model, layer = self.model, layer_type(self.real)()
        layer.tables, layer.friction, layer.kinetic = self.contact_tables, model.friction, self.kinetic
        if of_skin:
            layer.tables = self.skin_tables.struct
        layer.slip_distance = model.slip_distance / self.tables.length_scale
        # A nearly incompressible skin rises beside the contact: include cells where the object is that near.
        layer.bulge = 0.1 + 0.9 * min(max((model.poisson_ratio - 0.3) / 0.2, 0.0), 1.0)
        layer.cap, layer.tolerance = int(model.iterations), model.tolerance
        layer.reach = wp.vec2i(*response_reach(self.skin_tables.kernels))
        return layer

    def _reset(self, mask: wp.array) -> None:
        over, pressed, state, surface = self.over, self.pressed, self.state, self.surface
        for array in (
            pressed.pressure, pressed.box, pressed.residual, pressed.iterations, pressed.changed, pressed.dirty,
            surface.u, surface.v, surface.w, surface.area, over.near, over.active, state.x, state.y, state.anchor_x,
            state.anchor_y, state.held_by, state.slip, state.box, state.residual, state.iterations, state.changed,
        ):  # fmt: skip
            clear_rows(array, mask)
        if self.weakens:
            clear_rows(state.slipped, mask)
        clear_rows(over.overlap, mask, NO_SURFACE)
        clear_rows(pressed.solved, mask, math.nan)
        if self.relaxing:
            self.relaxing.reset(mask)

    # -- stages -----------------------------------------------------------------------------------------------------

    def _add(self, make: Callable[[], Callable[[], None]], name: str, reason: str, cheaper: str) -> None:
        self.stages.append(Stage(name=f"{self.name}: {name}", reason=reason, launch=make(), cheaper=cheaper))

    def _blocks(self, kernel, inputs: list, *, of_skin: bool = False) -> Callable[[], None]:
        """Return a recorded launch with one block of threads per slot; ``of_skin``: with the compliances of the skin
        alone."""
        threads = kernel.options["launch_bounds"][0]
        return self.site.context.record_blocks(kernel, self.n_slots, [self._layer(of_skin), *inputs], [], threads)

    def touch_points(self) -> TouchPoints:
        """Return the cells, at which bodies touch the layer."""
        grid = self.grid
        normals = grid.cell_axes()[2] if grid.is_bent else np.broadcast_to(grid.normal, (*grid.shape, 3))
        return TouchPoints(
            positions=grid.cell_centres().reshape(-1, 3),
            normals=normals.reshape(-1, 3),
            radii=np.where(grid.covered().reshape(-1), 0.0, -1.0),
            reach=self._cells_struct().reach.numpy().reshape(-1),
        )

    def _reach(self, centres: wp.array, horizon: float) -> wp.array:
        """Return the depth below each cell to which bodies are sensed [m]."""
        site, shape = self.site, self.grid.shape
        if self.model.look_depth is not None or site.link.shape is None:
            return wp.full(shape, horizon, dtype=self.real, device=self.device)
        centres = centres.flatten()
        normals = wp.full(len(centres), site.vec3(*self.grid.normal), dtype=site.vec3, device=self.device)
        if self.grid.is_bent:
            normals = wp.array(self.grid.cell_axes()[2].reshape(-1, 3), dtype=site.vec3, device=self.device)
        thickness = thickness_behind(site.own_table, site.link.index, centres, normals, site.context).numpy()
        limited = np.where(thickness < FAR, thickness, horizon).reshape(shape)
        return wp.array(limited, dtype=self.real, device=self.device)

    def _cells_struct(self):
        """Return the cells, as the kernels of the overlap take them."""
        site, grid, real = self.site, self.grid, self.real
        vec3, cells = site.vec3, cells_type(real)()
        diagonal = float(np.hypot(grid.rows * grid.pitch[0], grid.columns * grid.pitch[1]))
        cells.horizon = self.model.look_depth or min(float(self.model.thickness), diagonal)
        cells.corner, cells.u, cells.v, cells.n = (vec3(*a) for a in (grid.edge, grid.u, grid.v, grid.normal))
        cells.size, cells.shape = wp.types.vector(2, real)(*grid.cell), wp.vec2i(*grid.shape)
        cells.pitch = self.tables.length_scale
        cells.centres = wp.array(grid.cell_centres(), dtype=vec3, device=self.device)
        cells.covered = wp.array(grid.covered(), dtype=wp.bool, device=self.device)
        cells.reach = self._reach(cells.centres, cells.horizon)
        own = grid.cell_axes() if grid.is_bent else np.zeros((0, 0, 0, 3))
        cells.axes = wp.array(own, dtype=vec3, device=self.device)
        return cells

    def _overlap(self) -> Callable[[], None]:
        site, grid, real = self.site, self.grid, self.real
        cells, pose = self._cells_struct(), site.view.pose
        self.over.last_pose = site.context.zeros(pose.shape if self.has_friction else (0, 0), pose.dtype)
        inputs = [site.sensed, cells, self.over]
        near = site.context.record(near_kernel(real, grid.is_bent), self.n_envs, inputs, [], block_dim=32)
        parts = 1 if self.device.is_cpu else grid.shape[1]
        kernel = overlap_kernel(real, site.table.kinds, self.has_friction, grid.is_bent)
        if self.device.is_cpu and is_ball_overlap(site.table.kinds, grid.is_bent):
            kernel = ball_rows_kernel(real, self.has_friction)
        find = site.context.record(kernel, (self.n_envs, grid.shape[0], parts), [*inputs, parts], [])
        if not self.has_friction:
            return in_turn(near, find)
        remember = site.context.record(keep_poses_kernel(real), pose.shape, [pose], [self.over.last_pose])
        return in_turn(near, find, remember)

    def _normal(self) -> Callable[[], None]:
        kernel = normal_kernel(self.real, self.lanes, self.is_shared)
        over = self.relaxing.over if self.relaxing else self.over
        return self._blocks(kernel, [over, self.windows.struct, self.pressed])

    def _friction(self) -> Callable[[], None]:
        creeps = self.weakens and self.relaxing is not None
        kernel = friction_kernel(self.real, self.lanes, self.is_coupled, self.is_shared, self.weakens, creeps)
        return self._blocks(kernel, [self.over, self.pressed, self.friction_windows.struct, self.state])

    def _surface(self) -> Callable[[], None]:
        kernel = surface_kernel(self.real, self.lanes, self.has_friction, self.is_shared)
        loads = self.relaxing.displaced if self.relaxing else [self.pressed, self.state]
        return self._blocks(kernel, [*loads, self.windows.struct, self.surface], of_skin=True)

    def _read(self) -> Callable[[], None]:
        grid = self.grid
        skin = skin_type(self.real)()
        skin.u, skin.v, skin.normal = (self.site.vec3(*axis) for axis in (grid.u, grid.v, grid.normal))
        skin.length, skin.pressure = self.tables.length_scale, self.tables.pressure_scale
        skin.area, skin.columns, skin.split = grid.area, grid.columns, grid.split
        skin.place = wp.array(grid.place, dtype=wp.int32, device=self.device)
        own = grid.taxel_axes() if grid.is_bent else np.zeros((0, 0, 3))
        skin.axes = wp.array(own, dtype=self.site.vec3, device=self.device)
        kernel = reading_kernel(self.real, bool(self.model.displacement), self.has_friction, grid.is_bent)
        loads = self.relaxing.read if self.relaxing else [self.pressed, self.state]
        inputs = [skin, *loads, self.surface]
        return self.site.context.record(kernel, self.reading.shape[:2], inputs, [self.reading])
