"""A hand with touch above a ball, to be held with a given force."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import warp as wp
from gymnasium.spaces import Box

from tactemu.base.errors import SceneError
from tactemu.base.folders import example_file
from tactemu.engines.mujoco_warp_engine import MujocoWarpEngine
from tactemu.engines.newton_engine import NewtonEngine
from tactemu.envs.arrays import Array
from tactemu.envs.env import SkinEnv
from tactemu.envs.task import SkinTask
from tactemu.envs.vector_env import SkinVectorEnv
from tactemu.imperfections import ElectronicsOptions
from tactemu.scene.scene import Scene
from tactemu.sensors.probes.kinematic_taxel import KinematicTaxel

ENGINES = {"mujoco-warp": MujocoWarpEngine, "newton": NewtonEngine}
HAND = "hands/ability_hand_motors.xml"
"""The file of the hand in the folder of the examples."""
JOINT_RANGES_RAD = {
    "index": (0.0, 1.75),
    "middle": (0.0, 1.75),
    "ring": (0.0, 1.75),
    "pinky": (0.0, 1.75),
    "thumb_flexor": (0.0, 1.75),
    "thumb_rotator": (-1.75, 0.0),
}
"""The joints that have a motor, and their ranges."""
FINGERTIPS = ("index_tip", "middle_tip", "ring_tip", "pinky_tip", "thumb_tip")
"""The bodies with a skin; the skins have their names."""
PAD_M = np.stack([*np.meshgrid(np.linspace(-5e-3, 5e-3, 6), np.linspace(-8e-3, 8e-3, 6)), np.full((6, 6), 4e-3)], -1)
"""Positions of the taxels of a fingertip."""
FORCES_N = (3.0, 5.0)
"""Range of the force to hold with, drawn at the beginning of each episode."""
MAX_TAXEL_FORCE_N = 2.0
"""The force beyond which a taxel saturates."""
DROP_HEIGHT_M = 0.03
"""Height of the ball's centre that ends an episode: the ball has left its table."""


class HandTask(SkinTask):
    """Close a hand of six motors on a ball, and hold it with a given force on the fingertips.

    An action has the targets of the joints of :data:`JOINT_RANGES_RAD`, -1 to 1 for each range. The observation is
    the force on each fingertip's taxels [N], ``joints`` [rad], ``ball``, the position of its centre [m], and
    ``target`` [N]. The reward is 1 at the target, and 0 from its double on and without a touch; an episode ends when
    the ball falls. Both use true values.

    Args:
        engine: the simulator of the motion, ``mujoco-warp`` or ``newton``.
        noise: standard deviation of the noise of each force [N].
        max_episode_steps: number of steps after which an episode is truncated.

    Raises:
        SceneError: the simulator is another, or it is not installed.
    """

    dt = 4e-3
    observed = {tip: ["force"] for tip in FINGERTIPS}

    def __init__(self, *, engine: str = "mujoco-warp", noise: float = 5e-3, max_episode_steps: int = 250):
        if engine not in ENGINES:
            raise SceneError(f"engine must be one of {', '.join(ENGINES)}, got {engine!r}")
        self._kind, self._noise = engine, noise
        super().__init__(max_episode_steps=max_episode_steps)

    def build(self, scene: Scene) -> Box:
        with wp.ScopedDevice("cpu"):  # an engine takes the default device while it reads its model
            self._engine = ENGINES[self._kind](scene, example_file(HAND))
        bodies = self._engine.source
        taxels = KinematicTaxel(
            positions=PAD_M,
            radius=1.5e-3,
            normal_stiffness=200.0,
            sense=(bodies.body_of("object").index,),
            electronics=ElectronicsOptions(noise=self._noise, saturation_range=(-MAX_TAXEL_FORCE_N, MAX_TAXEL_FORCE_N)),
        )
        for tip in FINGERTIPS:
            scene.add_sensor(taxels, link=bodies.body_of(tip), name=tip)
        return Box(-1.0, 1.0, (len(JOINT_RANGES_RAD),), np.float32)

    def connect(self) -> None:
        engine = self._engine
        columns = [engine.source.column(joint) for joint in JOINT_RANGES_RAD]
        if isinstance(engine, NewtonEngine):
            self._commands, motors = engine.control.joint_target_q, columns
        else:
            self._commands = engine.data.ctrl
            motors = [engine.model.actuator(joint).id for joint in JOINT_RANGES_RAD]
        self._motors, self._joints = self.arrays.asarray(motors), self.arrays.asarray(columns)
        self._ball = engine.source.column("object")
        # Newton has the targets of all environments in one row
        self._rows = self.arrays.copy(self.arrays.reader(self._commands)()).reshape(self.num_envs, -1)
        self._positions = self.arrays.reader(engine.positions)
        self._low, self._high = self.arrays.asarray(list(zip(*JOINT_RANGES_RAD.values())))
        self._target = self.zeros((self.num_envs, 1))

    def begin(self, envs: Array) -> None:
        self.merge(envs, self.uniform(*FORCES_N, 1), self._target)

    def act(self, actions: Array) -> None:
        self._rows[:, self._motors] = self._low + (self._high - self._low) * (0.5 + 0.5 * actions)
        self.arrays.write(self._commands, self._rows)

    def more_spaces(self) -> Mapping[str, Box]:
        return {
            "joints": Box(-np.inf, np.inf, (len(JOINT_RANGES_RAD),), np.float32),  # limits of joints are soft
            "ball": Box(-np.inf, np.inf, (3,), np.float32),
            "target": Box(*FORCES_N, (1,), np.float32),
        }

    def more_observations(self) -> Mapping[str, Array]:
        positions = self._positions()
        ball = positions[:, self._ball : self._ball + 3]
        return {"joints": positions[:, self._joints], "ball": ball, "target": self._target}

    def measure(self) -> None:
        self._force: Array = sum(
            -self.read(tip, "force", ground_truth=True)[..., 2].sum((-2, -1)) for tip in FINGERTIPS
        )  # [N]

    def reward(self) -> Array:
        target = self._target[:, 0]
        return self.xp.clip(1.0 - abs(self._force - target) / target, 0.0, 1.0)

    def terminated(self) -> Array:
        return self._positions()[:, self._ball + 2] < DROP_HEIGHT_M

    def info(self) -> Mapping[str, Array]:
        return {"force": self._force}


class HandEnv(SkinEnv):
    """One environment of :class:`HandTask`, ``tactemu/Hand-v0``."""

    task_class = HandTask


class HandVectorEnv(SkinVectorEnv):
    """Many environments of :class:`HandTask`."""

    task_class = HandTask
