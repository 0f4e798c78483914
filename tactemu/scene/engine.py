"""``[engine]`` of a scene file: a simulator that moves the bodies, here MuJoCo. Skins feel its geoms."""

# MuJoCo's functions come from a compiled module that a checker cannot see into.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from tactemu.errors import SceneError
from tactemu.scene.bodies import Body
from tactemu.scene.mujoco_source import MujocoSource, load_mujoco

if TYPE_CHECKING:
    from tactemu.physics.simulation import Simulation
    from tactemu.scene.scene import Scene


_logger = logging.getLogger(__name__)

CATCH_UP_STEPS = 50
"""Steps of the model that one step of the scene waits for at most, unless two of its steps are more."""


class MujocoEngine:
    """A MuJoCo model that runs beside the scene, from its own start and by its own time step.

    Its geoms that take part in collisions are bodies of the scene, under their names.

    Args:
        scene: where they are added.
        file: the model, MJCF or URDF.

    Raises:
        SceneError: MuJoCo is not installed, or cannot read the file.
    """

    not_state: ClassVar[tuple[str, ...]] = ()

    def __init__(self, scene: Scene, file: Path):
        mujoco = self._mujoco = load_mujoco()
        try:
            self.model = mujoco.MjModel.from_xml_path(str(file))
        except (ValueError, OSError) as error:
            raise SceneError(f"engine: {file}: {str(error).strip()}") from None
        self.data = mujoco.MjData(self.model)
        self.source = MujocoSource(scene, self.model)
        self._left_out_s = 0.0
        """How much later than the clock the model is."""
        scene.posers.append(self.pose)

    @property
    def bodies(self) -> list[Body]:
        """Those that it added to the scene."""
        return self.source.bodies

    def carrier(self, name: str) -> Body:
        """The geom or MuJoCo body of this name, to put a skin on.

        Raises:
            SceneError: there is neither.
        """
        if self._has("GEOM", name):
            return self.source.geom(name)
        if self._has("BODY", name):
            return self.source.link(name)
        raise SceneError(f"engine: no geom or body {name!r}; {self.source.names()}")

    def beside(self, name: str) -> tuple[int, ...]:
        """The places in the scene of the geoms that move with a geom or MuJoCo body: its skin does not feel them."""
        carrier = int(self.model.geom(name).bodyid[0]) if self._has("GEOM", name) else name
        return tuple(body.index for body in self.source.geoms_of(carrier))

    def pose(self, simulation: Simulation, t_s: float) -> None:
        """Run the model up to ``t_s``, from its start where that has passed, and pose its geoms as they are then.

        A loop that is late asks for much at once; what is more than :data:`CATCH_UP_STEPS` is left out, and the model
        goes on from there later than the clock: else it would be later each time.
        """
        dt = self.model.opt.timestep
        if t_s < self.data.time + self._left_out_s - dt / 2:
            self._mujoco.mj_resetData(self.model, self.data)
            self._left_out_s = 0.0
        steps = round((t_s - self._left_out_s - self.data.time) / dt)
        most = max(CATCH_UP_STEPS, math.ceil(2 * simulation.dt / dt))
        if steps > most:
            if not self._left_out_s:
                _logger.warning("engine: MuJoCo does not keep up with the clock; it runs slower from %.3f s on", t_s)
            self._left_out_s += (steps - most) * dt
        for _ in range(min(steps, most)):
            self._mujoco.mj_step(self.model, self.data)
        self.source.update(simulation, self.data)

    def state(self) -> dict[str, Any]:
        """MuJoCo's own, as far as integration depends on it."""
        spec = self._mujoco.mjtState.mjSTATE_INTEGRATION
        values = np.empty(self._mujoco.mj_stateSize(self.model, spec))
        self._mujoco.mj_getState(self.model, self.data, values, spec)
        return {"left_out_s": self._left_out_s, "values": values}

    def prepared(self, state: dict[str, Any]) -> Callable[[], None]:
        """What takes on a state once it is called.

        Raises:
            ValueError: it is not one of this model.
        """
        spec, values, left_out_s = self._mujoco.mjtState.mjSTATE_INTEGRATION, state["values"], state["left_out_s"]
        size = self._mujoco.mj_stateSize(self.model, spec)
        if values.shape != (size,) or values.dtype != np.float64:
            raise ValueError(f"expected {size} numbers of MuJoCo, got {values.shape} {values.dtype}")

        def take() -> None:
            self._mujoco.mj_setState(self.model, self.data, values, spec)
            self._left_out_s = float(left_out_s)

        return take

    def _has(self, kind: str, name: str) -> bool:
        return self._mujoco.mj_name2id(self.model, getattr(self._mujoco.mjtObj, f"mjOBJ_{kind}"), name) >= 0
