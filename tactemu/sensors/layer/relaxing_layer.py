"""The memory of one layer in a scene: its arrays, and its two stages around the contact."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import warp as wp

from tactemu.plan.clearing import clear_rows
from tactemu.plan.launches import Launch
from tactemu.sensors.layer.friction_state import friction_state_type
from tactemu.sensors.layer.grid import LayerGrid
from tactemu.sensors.layer.memory import memory_type
from tactemu.sensors.layer.overlap import NO_SURFACE, overlap_type
from tactemu.sensors.layer.pressure import Windows, pressure_state_type
from tactemu.sensors.layer.recall import recall_kernel
from tactemu.sensors.layer.relaxation import Spectrum
from tactemu.sensors.layer.remember import remember_kernel
from tactemu.sensors.sensor_model import Site


class Layer(Protocol):
    """The layer, as far as its memory uses it (:mod:`.compiled_layer`)."""

    site: Site
    grid: LayerGrid
    real: Any
    device: wp.Device
    lanes: int
    n_envs: int
    n_slots: int
    has_friction: bool
    is_shared: bool
    is_coupled: bool
    over: Any
    pressed: Any
    state: Any
    windows: Windows


def _copy(kind: Any, struct: Any, **changed: Any) -> Any:
    """Return a copy of an instance of a Warp struct, with some other arrays."""
    copy = kind()
    for name in kind.vars:
        setattr(copy, name, changed.get(name, getattr(struct, name)))
    return copy


class RelaxingLayer:
    """The memory of a layer.

    Args:
        layer: the layer, whose arrays are made.
        spectrum: the relaxation of its modulus.
    """

    def __init__(self, layer: Layer, spectrum: Spectrum):
        self._layer, self.spectrum = layer, spectrum
        context, n_envs = layer.site.context, layer.n_envs
        components, terms = (3 if layer.has_friction else 1), len(spectrum.shares)
        cells, along = (n_envs, *layer.grid.shape), (n_envs, *layer.grid.shape) if layer.has_friction else (0, 0, 0)
        self.memory = memory = memory_type(layer.real)()
        memory.shares = wp.array(np.array(spectrum.shares), dtype=wp.float64, device=layer.device)
        memory.times = wp.array(np.array(spectrum.times), dtype=wp.float64, device=layer.device)
        memory.rest = spectrum.at_rest
        memory.decays = wp.zeros((n_envs, terms), dtype=wp.float64, device=layer.device)
        memory.growths = wp.zeros((n_envs, terms), dtype=wp.float64, device=layer.device)
        memory.scale = wp.zeros(n_envs, dtype=wp.float64, device=layer.device)
        memory.kept = context.zeros((n_envs, components * terms, *layer.grid.shape), wp.float64)
        memory.whole = context.zeros((n_envs, components, *layer.grid.shape), layer.real)
        memory.overlap = context.full(cells, NO_SURFACE, layer.real)
        memory.pressure = context.zeros(cells, layer.real)
        for name in ("x", "y", "u", "v"):
            setattr(memory, name, context.zeros(along, layer.real))
        memory.held_x, memory.held_y = context.zeros(along, wp.float64), context.zeros(along, wp.float64)
        memory.box, memory.area, memory.held = (context.zeros(n_envs, wp.vec4i) for _ in range(3))
        memory.peak = context.zeros(n_envs, wp.float64)

    def reset(self, mask: wp.array) -> None:
        """Forget everything in the environments of the mask."""
        memory = self.memory
        for array in (
            memory.kept, memory.whole, memory.pressure, memory.x, memory.y, memory.u, memory.v, memory.held_x,
            memory.held_y, memory.box, memory.area, memory.held, memory.peak,
        ):  # fmt: skip
            clear_rows(array, mask)
        clear_rows(memory.overlap, mask, NO_SURFACE)

    # -- the layer's structs, as its other stages take them ------------------------------------------------------------

    @property
    def over(self) -> Any:
        """The overlaps less the displacement by memory, with which the contact is solved."""
        return _copy(overlap_type(self._layer.real), self._layer.over, overlap=self.memory.overlap)

    @property
    def read(self) -> list[Any]:
        """The pressures and tractions of this step."""
        return self._loads(pressure=self.memory.pressure, x=self.memory.x, y=self.memory.y)

    @property
    def displaced(self) -> list[Any]:
        """The pressures and tractions of an elastic layer with the same displacement."""
        whole = [self.memory.whole[:, k] for k in range(self.memory.whole.shape[1])]
        along = dict(zip(("x", "y"), whole[1:]))
        return self._loads(pressure=whole[0], box=self.memory.box, **along)

    def _loads(self, x: wp.array | None = None, y: wp.array | None = None, **pressed: wp.array) -> list[Any]:
        layer, along = self._layer, {} if x is None or y is None else {"x": x, "y": y}
        return [
            _copy(pressure_state_type(layer.real), layer.pressed, **pressed),
            _copy(friction_state_type(layer.real), layer.state, **along),
        ]

    # -- stages --------------------------------------------------------------------------------------------------------

    def recall(self, solver: Any) -> Launch:
        """Return the stage before the contact; ``solver`` is the layer as kernels take it."""
        layer = self._layer
        kernel = recall_kernel(layer.real, layer.lanes, layer.has_friction, layer.is_coupled, layer.is_shared)
        inputs = [solver, layer.site.context.clock, layer.over, layer.windows.struct, self.memory, layer.state]
        return self._blocks(kernel, inputs)

    def remember(self) -> Launch:
        """Return the stage after the contact."""
        layer = self._layer
        kernel = remember_kernel(layer.real, layer.lanes, layer.has_friction)
        return self._blocks(kernel, [self.memory, layer.pressed, layer.state])

    def _blocks(self, kernel: Any, inputs: list[Any]) -> Launch:
        threads = kernel.options["launch_bounds"][0]
        return self._layer.site.context.record_blocks(kernel, self._layer.n_slots, inputs, [], threads)
