"""The engine ``mujoco-warp`` of a scene file: many environments of a MuJoCo model, on the simulation's device.

::

    scene = tt.Scene(dt=4e-3)
    engine = tt.MujocoWarpEngine(scene, "hand.xml")
    skin = scene.add_sensor(tt.KinematicTaxel(...), link=engine.source.geom("fingertip"))
    sim = scene.build(4096, device="cuda:0")
    commands = torch.from_dlpack(engine.data.ctrl)  # (n_envs, actuators)
    while True:
        commands[:] = policy(torch.from_dlpack(skin.arrays.force))
        sim.step()

It needs the extra ``tactemu[mujoco-warp]``.
"""

# MuJoCo's functions come from a compiled module that a checker cannot see into.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactemu.base.errors import SceneError
from tactemu.engines.batch_engine import BatchEngine
from tactemu.engines.mujoco_source import MujocoSource, check_ranges, load_mujoco
from tactemu.scene.engine_tables import MujocoWarpTable

if TYPE_CHECKING:
    import warp as wp

    from tactemu.scene.scene import Scene
    from tactemu.sensors.simulation import Simulation


STATE = (
    "time", "qpos", "qvel", "act", "history", "qacc_warmstart", "ctrl", "qfrc_applied", "xfrc_applied", "eq_active",
    "mocap_pos", "mocap_quat", "userdata",
)  # fmt: skip
"""The arrays on which MuJoCo's integration depends: ``mjSTATE_INTEGRATION``."""


class MujocoWarpEngine(BatchEngine):
    """A MuJoCo model that MuJoCo Warp moves.

    Its geoms that take part in collisions are bodies of the scene, under their names.

    Args:
        scene: the scene to which the geoms are added.
        file: the model, MJCF or URDF, or an ``mujoco.MjModel``.
        table: the options.

    Raises:
        SceneError: MuJoCo Warp is not installed, or cannot read or simulate the model.
    """

    kind = "mujoco-warp"

    def __init__(self, scene: Scene, file: Path | str | Any, table: MujocoWarpTable | None = None):
        mujoco = load_mujoco()
        self._warp: Any = self._module("mujoco_warp", "mujoco-warp")
        try:
            self.model = mujoco.MjModel.from_xml_path(str(file)) if isinstance(file, str | Path) else file
            check_ranges(self.model, file if isinstance(file, str | Path) else "the model")
            self._start = mujoco.MjData(self.model)
            mujoco.mj_forward(self.model, self._start)
            if table is not None and table.friction is not None:
                self.model.geom_friction[:, 0] = table.friction
                self.model.pair_friction[:, :2] = table.friction
            self._warp.put_model(self.model)
        except (ValueError, OSError, NotImplementedError) as error:
            raise SceneError(f"engine: {file}: {str(error).strip()}") from None
        self._sizes = {} if table is None else table.sizes
        super().__init__(scene, Path(file if isinstance(file, str | Path) else "model"), self.model.opt.timestep)
        self._source = MujocoSource(scene, self.model)
        self.data: Any = None
        """The ``mujoco_warp.Data`` of the scene that was built last, on its device; write your commands to ``ctrl``."""

    @property
    def source(self) -> MujocoSource:
        """The model's geoms and bodies, by their names."""
        return self._source

    @property
    def start(self) -> np.ndarray:
        """A row of ``qpos`` at the model's start."""
        return self._start.qpos

    def create_worlds(self, simulation: Simulation) -> _Worlds:
        """Create as many worlds as the simulation has environments, on its device."""
        self.data = self._warp.put_data(self.model, self._start, nworld=simulation.n_envs, **self._sizes)
        model = self._warp.put_model(self.model)
        model.opt.warn_overflow = 0  # BatchEngine warns instead, and once only
        return _Worlds(self._warp, model, self.data, self._source, self.steps)


class _Worlds:
    """The worlds of one simulation."""

    def __init__(self, warp: Any, model: Any, data: Any, source: MujocoSource, steps: int):
        self._warp, self._model, self._source, self._steps = warp, model, source, steps
        self.data = data
        self._with_velocity = False

    def step(self) -> None:
        for _ in range(self._steps):
            self._warp.step(self._model, self.data)
        self.refresh()

    @property
    def positions(self) -> wp.array:
        return self.data.qpos

    def arrays(self) -> list[wp.array]:
        return [array for name in STATE if (array := getattr(self.data, name, None)) is not None and array.size]

    @property
    def overflow(self) -> wp.array:
        return self.data.overflow

    def refresh(self) -> None:
        self._warp.kinematics(self._model, self.data)  # a step leaves poses as they were before it
        if self._with_velocity:
            self._warp.com_pos(self._model, self.data)
            self._warp.com_vel(self._model, self.data)

    def bind(self, simulation: Simulation) -> None:
        self._with_velocity = simulation._uses_velocity
        self.refresh()
        self._source.bind(simulation, self.data)


open_engine = MujocoWarpEngine.from_file
"""Open the engine of a scene file: see :attr:`tactemu.scene.engine_tables.ModelTable.opener`."""
