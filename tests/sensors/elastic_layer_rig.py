"""The layer's solvers on plain arrays: what the tests press is an array of overlaps, not a scene."""

import math
from typing import Any

import numpy as np
import warp as wp

from tactemu.sensors.layer import friction
from tactemu.sensors.layer.convolution import Workspace, lane_width
from tactemu.sensors.layer.friction import friction_kernel
from tactemu.sensors.layer.friction_state import FRICTION_WINDOWS, friction_state_type, friction_windows_type
from tactemu.sensors.layer.overlap import overlap_type
from tactemu.sensors.layer.pressure import NORMAL_WINDOWS, Windows, normal_kernel, pressure_state_type, windows_type
from tactemu.sensors.layer.shared_memory import complex_numbers, fits
from tactemu.sensors.layer.surface import response_reach, surface_kernel, surface_type
from tactemu.sensors.layer.tables import LayerMaterial, LayerTables, layer_type


class LayerRig:
    """One layer of ``cells`` (rows, columns) at ``pitch`` [m]; SI in, SI out, no environments axis for one."""

    def __init__(
        self, cells, pitch, young, nu, thickness, *, n_envs=1, real: Any = wp.float32, iterations=200, tolerance=1e-5,
        mu=0.0, mu_kinetic=None, slip_distance=1e-4, coupled=False, device="cpu", lanes=None,
    ):  # fmt: skip
        self.device = wp.get_device(device)
        self.real, self.pitch, self.n_envs = real, pitch, n_envs
        lanes, slots = lanes or lane_width(self.device), 1 if self.device.is_cpu else n_envs
        is_shared = fits(cells, complex_numbers(friction.SHARED_WINDOWS), real, lanes, self.device)
        self.material = LayerMaterial(young / (2 * (1 + nu)), nu, thickness)
        self.tables = LayerTables(self.material, cells, (pitch, pitch), tangential=True, real=real, device=self.device)
        workspace = Workspace(slots, self.tables.n_max, real, lanes, self.device, spectra=3)
        shape, turns = (n_envs, *cells), wp.vec4i(0, n_envs, 0, slots)

        def zeros(dtype, where=shape):
            return wp.zeros(where, dtype=dtype, device=self.device)

        def launch(kernel, inputs):
            return wp.launch_tiled(
                kernel,
                dim=[slots],
                inputs=[turns, self.layer, *inputs],
                block_dim=kernel.options["launch_bounds"][0],
                device=self.device,
                record_cmd=True,
            ).launch

        self.layer = layer_type(real)()
        self.layer.tables, self.layer.bulge, self.layer.friction = self.tables.struct, 1.0, mu
        weakens = mu_kinetic is not None
        self.layer.kinetic = mu if mu_kinetic is None else mu_kinetic
        self.layer.slip_distance = slip_distance / self.tables.length_scale
        self.layer.cap, self.layer.tolerance = iterations, tolerance
        self.layer.reach = wp.vec2i(*response_reach(self.tables.kernels))
        self.windows = Windows(windows_type(real)(), NORMAL_WINDOWS, workspace, slots, cells)
        over, pressed = self.over, self.pressed = overlap_type(real)(), pressure_state_type(real)()
        state, surface = self.state, self.surface_state = friction_state_type(real)(), surface_type(real)()
        over.overlap, pressed.pressure = zeros(real), zeros(real)
        over.slide, over.body = zeros(wp.types.vector(2, real)), zeros(wp.int32)
        over.active = wp.full(n_envs, wp.vec4i(0, 0, *cells), dtype=wp.vec4i, device=self.device)
        pressed.solved = wp.full(shape, real(math.nan), dtype=real, device=self.device)
        for struct in (pressed, state):
            struct.box, struct.residual = zeros(wp.vec4i, n_envs), zeros(wp.float64, n_envs)
            struct.iterations, struct.changed = zeros(wp.int32, n_envs), zeros(wp.int32, n_envs)
        pressed.dirty, surface.area = zeros(wp.vec4i, n_envs), zeros(wp.vec4i, n_envs)
        for name in ("x", "y", "anchor_x", "anchor_y"):
            setattr(state, name, zeros(real))
        state.held_by, state.slip, state.slipped = zeros(wp.int32), zeros(wp.int32), zeros(real)
        for name in "uvw":
            setattr(surface, name, zeros(real))

        self._normal = launch(normal_kernel(real, lanes, is_shared), [over, self.windows.struct, pressed])
        self._friction = None
        if mu > 0:
            self.friction_windows = Windows(friction_windows_type(real)(), FRICTION_WINDOWS, workspace, slots, cells)
            inputs = [over, pressed, self.friction_windows.struct, state]
            self._friction = launch(friction_kernel(real, lanes, coupled, is_shared, weakens), inputs)
        inputs = [pressed, state, self.windows.struct, surface]
        self._surface = launch(surface_kernel(real, lanes, mu > 0, is_shared), inputs)

    def _one(self, array):
        values = array.numpy().astype(float)
        return values[0] if self.n_envs == 1 else values

    def press(self, overlap) -> np.ndarray:
        """Pressure [Pa] under an overlap [m]."""
        scaled = np.asarray(overlap) / self.tables.length_scale
        self.over.overlap.assign(
            scaled.reshape(self.over.overlap.shape).astype(np.float32 if self.real is wp.float32 else np.float64)
        )
        self._normal()
        return self.pressure

    @property
    def pressure(self) -> np.ndarray:
        return self._one(self.pressed.pressure) * self.tables.pressure_scale

    @property
    def residual(self) -> float:
        return float(self.pressed.residual.numpy()[0])

    def rub(self, x: float, y: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Tractions [Pa] after the object has slid by (x, y) [m]."""
        step = np.broadcast_to(np.array([x, y]) / self.tables.length_scale, (*self.over.slide.shape, 2))
        self.over.slide.assign(step.astype(np.float32 if self.real is wp.float32 else np.float64))
        self._friction()
        scale = self.tables.pressure_scale
        return self._one(self.state.x) * scale, self._one(self.state.y) * scale

    def surface(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Displacement along x, y and into the skin [m]."""
        self._surface()
        arrays = self.surface_state.u, self.surface_state.v, self.surface_state.w
        return tuple(self._one(array) * self.tables.length_scale for array in arrays)


def coordinates(cells: int, pitch: float, shift=(0.0, 0.0)) -> tuple[np.ndarray, np.ndarray]:
    """x and y of a square grid's cells [m], centred, shifted by a part of a pitch."""
    x, y = ((np.arange(cells) - (cells - 1) / 2 + s) * pitch for s in shift)
    return np.meshgrid(x, y)
