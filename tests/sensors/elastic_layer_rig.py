"""The layer's solvers on plain arrays: what the tests press is an array of overlaps, not a scene."""

import math

import numpy as np
import warp as wp

from tactemu.sensors.layer import friction
from tactemu.sensors.layer.convolution import Workspace, lane_width
from tactemu.sensors.layer.friction import friction_kernel
from tactemu.sensors.layer.friction_state import FRICTION_WINDOWS, friction_state_type, friction_windows_type
from tactemu.sensors.layer.pressure import NORMAL_WINDOWS, Windows, normal_kernel, windows_type
from tactemu.sensors.layer.shared_memory import fits, shared_numbers
from tactemu.sensors.layer.surface import response_reach, surface_kernel
from tactemu.sensors.layer.tables import LayerMaterial, LayerTables


class LayerRig:
    """One layer of ``cells`` (rows, columns) at ``pitch`` [m]; SI in, SI out, no environments axis for one."""

    def __init__(
        self, cells, pitch, young, nu, thickness, *, n_envs=1, real=wp.float32, iterations=200, tolerance=1e-5,
        mu=0.0, coupled=False, device="cpu", lanes=None,
    ):  # fmt: skip
        self.device = wp.get_device(device)
        self.real, self.pitch, self.n_envs = real, pitch, n_envs
        lanes, slots = lanes or lane_width(self.device), 1 if self.device.is_cpu else n_envs
        is_shared = fits(cells, shared_numbers(*friction.SHARED_ARRAYS), real, lanes, self.device)
        self.material = LayerMaterial(young / (2 * (1 + nu)), nu, thickness)
        self.tables = LayerTables(self.material, cells, (pitch, pitch), tangential=True, real=real, device=self.device)
        self.workspace = Workspace(slots, self.tables.n_max, real, lanes, self.device, spectra=3)
        shape, turns = (n_envs, *cells), wp.vec4i(0, n_envs, 0, slots)

        def zeros(dtype, where=shape):
            return wp.zeros(where, dtype=dtype, device=self.device)

        def launch(kernel, inputs, outputs):
            return wp.launch_tiled(
                kernel,
                dim=[slots],
                inputs=[turns, *inputs],
                outputs=outputs,
                block_dim=kernel.options["launch_bounds"][0],
                device=self.device,
                record_cmd=True,
            ).launch

        struct = windows_type(real)()
        self.windows = Windows(struct, NORMAL_WINDOWS, slots, cells, real, lanes, self.device)
        self.overlap, self.pressure_array = zeros(real), zeros(real)
        self.solved = wp.full(shape, real(math.nan), dtype=real, device=self.device)
        self.box, self.area, self.dirty = (zeros(wp.vec4i, n_envs) for _ in range(3))
        self.residual_array, self.iterations = zeros(wp.float64, n_envs), zeros(wp.int32, n_envs)
        self.changed, self.friction_changed = zeros(wp.int32, n_envs), zeros(wp.int32, n_envs)
        limit = wp.float64(tolerance)
        inputs = [self.tables.struct, real(1.0), iterations, limit]
        self.active = wp.full(n_envs, wp.vec4i(0, 0, *cells), dtype=wp.vec4i, device=self.device)
        inputs += [self.overlap, self.active, self.workspace.struct, self.windows.struct]
        outputs = [self.solved, self.pressure_array, self.box, self.residual_array, self.iterations, self.changed]
        outputs += [self.dirty]
        self._normal = launch(normal_kernel(real, lanes, is_shared), inputs, outputs)

        self.slide, self.body = zeros(wp.types.vector(2, real)), zeros(wp.int32)
        self.state = friction_state_type(real)()
        for name in ("x", "y", "anchor_x", "anchor_y"):
            setattr(self.state, name, zeros(real))
        self.state.held_by, self.state.slip = zeros(wp.int32), zeros(wp.int32)
        self.state.box, self.state.residual = zeros(wp.vec4i, n_envs), zeros(wp.float64, n_envs)
        self.state.iterations = zeros(wp.int32, n_envs)
        self._friction = None
        if mu > 0:
            struct = friction_windows_type(real)()
            self.friction_windows = Windows(struct, FRICTION_WINDOWS, slots, cells, real, lanes, self.device)
            inputs = [self.tables.struct, real(mu), iterations, limit]
            inputs += [self.pressure_array, self.box, self.changed, self.slide, self.body]
            inputs += [self.workspace.struct, self.friction_windows.struct, self.state]
            self._friction = launch(friction_kernel(real, lanes, coupled, is_shared), inputs, [self.friction_changed])

        reach = wp.vec2i(*response_reach(self.tables.kernels))
        self.surface_arrays = [zeros(real) for _ in range(3)]
        inputs = [self.tables.struct, reach, self.pressure_array, self.state, self.box]
        inputs += [self.friction_changed if mu > 0 else self.changed, self.workspace.struct, self.windows.struct]
        self._surface = launch(
            surface_kernel(real, lanes, mu > 0, is_shared), inputs, [self.area, self.dirty, *self.surface_arrays]
        )

    def _one(self, array):
        values = array.numpy().astype(float)
        return values[0] if self.n_envs == 1 else values

    def press(self, overlap) -> np.ndarray:
        """Pressure [Pa] under an overlap [m]."""
        scaled = np.asarray(overlap) / self.tables.length_scale
        self.overlap.assign(
            scaled.reshape(self.overlap.shape).astype(np.float32 if self.real is wp.float32 else np.float64)
        )
        self._normal()
        return self.pressure

    @property
    def pressure(self) -> np.ndarray:
        return self._one(self.pressure_array) * self.tables.pressure_scale

    @property
    def residual(self) -> float:
        return float(self.residual_array.numpy()[0])

    def rub(self, x: float, y: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Tractions [Pa] after the object has slid by (x, y) [m]."""
        step = np.broadcast_to(np.array([x, y]) / self.tables.length_scale, (*self.slide.shape, 2))
        self.slide.assign(step.astype(np.float32 if self.real is wp.float32 else np.float64))
        self._friction()
        scale = self.tables.pressure_scale
        return self._one(self.state.x) * scale, self._one(self.state.y) * scale

    def surface(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Displacement along x, y and into the skin [m]."""
        self._surface()
        return tuple(self._one(array) * self.tables.length_scale for array in self.surface_arrays)


def coordinates(cells: int, pitch: float, shift=(0.0, 0.0)) -> tuple[np.ndarray, np.ndarray]:
    """x and y of a square grid's cells [m], centred, shifted by a part of a pitch."""
    x, y = ((np.arange(cells) - (cells - 1) / 2 + s) * pitch for s in shift)
    return np.meshgrid(x, y)
