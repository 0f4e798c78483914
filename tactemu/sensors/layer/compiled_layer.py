"""One elastic layer in a scene: its arrays, and the stages from overlap to reading."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import warp as wp

from tactemu.geometry.shapes.rays import thickness_behind
from tactemu.geometry.shapes.shape import FAR
from tactemu.plan.clearing import clear_rows
from tactemu.plan.launches import in_turn
from tactemu.plan.plan import Stage
from tactemu.sensors.layer import friction, pressure, surface
from tactemu.sensors.layer.convolution import Workspace, lane_width
from tactemu.sensors.layer.friction import friction_kernel
from tactemu.sensors.layer.friction_state import (
    FRICTION_WINDOWS,
    GLOBAL_WINDOWS,
    friction_state_type,
    friction_windows_type,
)
from tactemu.sensors.layer.grid import LayerGrid
from tactemu.sensors.layer.overlap import keep_poses_kernel, near_kernel, overlap_kernel
from tactemu.sensors.layer.pressure import NO_SURFACE, NORMAL_WINDOWS, Windows, normal_kernel, windows_type
from tactemu.sensors.layer.reading import reading_kernel, skin_type
from tactemu.sensors.layer.shared_memory import fits, shared_numbers
from tactemu.sensors.layer.surface import response_reach, surface_kernel
from tactemu.sensors.layer.tables import LayerMaterial, LayerTables
from tactemu.sensors.sensor_model import Site

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
    def iterations(self) -> int: ...

    @property
    def tolerance(self) -> float: ...

    @property
    def displacement(self) -> bool: ...

    @property
    def coupled(self) -> bool: ...

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
        self.has_friction = model.friction > 0
        needs = [
            pressure.SHARED_ARRAYS,
            *([friction.SHARED_ARRAYS] * self.has_friction),
            *([surface.SHARED_ARRAYS] * bool(model.displacement)),
        ]
        numbers = max(shared_numbers(*each) for each in needs)
        self.is_shared = fits(self.grid.shape, numbers, self.real, self.lanes, self.device)
        at_once = self.n_envs if self.is_shared else min(self.n_envs, MAX_BLOCKS)
        self.n_slots = context.threads if self.device.is_cpu else at_once
        nu, young = float(model.poisson_ratio), float(model.young_modulus)
        self.material = LayerMaterial(young / (2 * (1 + nu)), nu, float(model.thickness))
        self.tables = self._tables(tangential=self.has_friction or model.displacement)
        self._allocate()
        coarser = "lower `oversampling`"
        solver = "lower `iterations` or `oversampling`, or raise `tolerance`"
        self._add(self._overlap, "overlap", "depth of each cell along the normal", coarser)
        self._add(self._normal, "pressure", f"bonded layer, at most {model.iterations} iterations", solver)
        if self.has_friction:
            why = f"Coulomb friction {model.friction:g} with stick and slip"
            self._add(self._friction, "friction", why, f"set `friction = 0`, {solver}")
        if model.displacement:
            why = "displacement is on; within reach of the contact"
            self._add(self._surface, "surface", why, f"set `displacement = false`, or {coarser}")
        self._add(self._read, "taxels", f"{self.grid.split}x{self.grid.split} cells per taxel", coarser)
        self.stages[1].reset = self._reset

    def _tables(self, *, tangential: bool) -> LayerTables:
        """Return the layer's compliances; equal layers share them."""
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
        spectra = 3 if self.model.displacement else 2 if self.has_friction else 1
        slots = 0 if self.is_shared else self.n_slots
        self.workspace = Workspace(slots, self.tables.n_max, real, self.lanes, self.device, spectra=spectra)
        struct = windows_type(real)()
        self.windows = Windows(struct, NORMAL_WINDOWS, slots, self.grid.shape, real, self.lanes, self.device)
        self.pressure = self._cells(real)
        self.overlap = self.site.context.full(self.pressure.shape, NO_SURFACE, real)
        self.solved = self.site.context.full(self.pressure.shape, math.nan, real)
        self.near, self.active = self._per_env(wp.vec4i), self._per_env(wp.vec4i)
        self.body, self.slide = self._cells(wp.int32, self.has_friction), self._cells(vec2, self.has_friction)
        self.box, self.area, self.dirty = (self._per_env(wp.vec4i) for _ in range(3))
        self.residual, self.iterations = self._per_env(wp.float64), self._per_env(wp.int32)
        self.changed, self.friction_changed = self._per_env(wp.int32), self._per_env(wp.int32)
        self.state = friction_state_type(real)()
        for name in ("x", "y", "anchor_x", "anchor_y"):
            setattr(self.state, name, self._cells(real, self.has_friction))
        self.state.held_by, self.state.slip = (
            self._cells(wp.int32, self.has_friction),
            self._cells(wp.int32, self.has_friction),
        )
        self.state.box, self.state.residual = self._per_env(wp.vec4i), self._per_env(wp.float64)
        self.state.iterations = self._per_env(wp.int32)
        self.surface = [self._cells(real, self.model.displacement) for _ in range(3)]
        if self.has_friction:
            struct = friction_windows_type(real)()
            shape, names = self.grid.shape, GLOBAL_WINDOWS if self.is_shared else FRICTION_WINDOWS
            self.friction_windows = Windows(struct, names, self.n_slots, shape, real, self.lanes, self.device)

    def _reset(self, mask: wp.array) -> None:
        state = self.state
        for array in (self.pressure, *self.surface):
            clear_rows(array, mask)
        for array in (state.x, state.y, state.anchor_x, state.anchor_y, state.held_by, state.slip):
            clear_rows(array, mask)
        for array in (
            self.residual,
            self.iterations,
            self.changed,
            self.friction_changed,
            state.residual,
            state.iterations,
        ):
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
        """Return the depth below each cell to which bodies are sensed [m]."""
        site, shape = self.site, self.grid.shape
        if self.model.look_depth is not None or site.link.shape is None:
            return wp.full(shape, horizon, dtype=self.real, device=self.device)
        centres = self.centres.flatten()
        normals = wp.full(len(centres), site.vec3(*self.grid.normal), dtype=site.vec3, device=self.device)
        if self.grid.is_bent:
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
        self.last_pose = site.context.zeros(pose.shape if self.has_friction else (0, 0), pose.dtype)
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
        near = self.site.context.record(near_kernel(real, grid.is_bent), self.n_envs, inputs, outputs, block_dim=32)
        inputs = [site.table.struct, pose, self.last_pose, site.targets, self.active, self.centres, self.covered]
        own = wp.array(grid.cell_axes() if grid.is_bent else np.zeros((0, 0, 0, 3)), dtype=vec3, device=self.device)
        parts = 1 if self.device.is_cpu else grid.shape[1]
        inputs += [self.reach, *axes, own, horizon, real(self.tables.length_scale), parts]
        kernel = overlap_kernel(real, site.table.kinds, self.has_friction, grid.is_bent)
        rows = (self.n_envs, grid.shape[0], parts)
        find = self.site.context.record(kernel, rows, inputs, [self.overlap, self.body, self.slide])

        if not self.has_friction:
            return in_turn(near, find)
        remember = self.site.context.record(keep_poses_kernel(real), pose.shape, [pose], [self.last_pose])
        return in_turn(near, find, remember)

    def _normal(self) -> Callable[[], None]:
        model, real = self.model, self.real
        # A nearly incompressible skin rises beside the contact: include cells where the object is that near.
        bulge = 0.1 + 0.9 * min(max((model.poisson_ratio - 0.3) / 0.2, 0.0), 1.0)
        inputs = [self.tables.struct, real(bulge), int(model.iterations), wp.float64(model.tolerance)]
        inputs += [self.overlap, self.active, self.workspace.struct, self.windows.struct]
        outputs = [self.solved, self.pressure, self.box, self.residual, self.iterations, self.changed]
        outputs += [self.dirty]
        return self._blocks(normal_kernel(real, self.lanes, self.is_shared), inputs, outputs)

    def _friction(self) -> Callable[[], None]:
        model, real = self.model, self.real
        tolerance = wp.float64(model.tolerance)
        inputs = [self.tables.struct, real(model.friction), int(model.iterations), tolerance]
        inputs += [self.pressure, self.box, self.changed, self.slide, self.body]
        inputs += [self.workspace.struct, self.friction_windows.struct, self.state]
        return self._blocks(
            friction_kernel(real, self.lanes, bool(model.coupled), self.is_shared),
            inputs,
            [self.friction_changed],
        )

    def _surface(self) -> Callable[[], None]:
        reach = response_reach(self.tables.kernels)
        inputs = [self.tables.struct, wp.vec2i(*reach), self.pressure, self.state, self.box]
        inputs += [
            self.friction_changed if self.has_friction else self.changed,
            self.workspace.struct,
            self.windows.struct,
        ]
        return self._blocks(
            surface_kernel(self.real, self.lanes, self.has_friction, self.is_shared),
            inputs,
            [self.area, self.dirty, *self.surface],
        )

    def _read(self) -> Callable[[], None]:
        grid = self.grid
        skin = skin_type(self.real)()
        skin.u, skin.v, skin.normal = (self.site.vec3(*axis) for axis in (grid.u, grid.v, grid.normal))
        skin.length, skin.pressure = self.tables.length_scale, self.tables.pressure_scale
        skin.area, skin.columns, skin.split = grid.area, grid.columns, grid.split
        self.place = wp.array(grid.place, dtype=wp.int32, device=self.device)
        own = grid.taxel_axes() if grid.is_bent else np.zeros((0, 0, 3))
        own = wp.array(own, dtype=self.site.vec3, device=self.device)
        inputs = [skin, self.place, own, self.pressure, self.residual, self.state, *self.surface]
        inputs += [self.friction_changed if self.has_friction else self.changed, self.dirty]
        kernel = reading_kernel(self.real, bool(self.model.displacement), self.has_friction, grid.is_bent)
        return self.site.context.record(kernel, self.reading.shape[:2], inputs, [self.reading])
