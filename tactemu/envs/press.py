"""A ball above a pad of taxels, to be pressed with a given force."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from gymnasium.spaces import Box

from tactemu.envs.arrays import Array
from tactemu.envs.env import SkinEnv
from tactemu.envs.task import SkinTask
from tactemu.envs.vector_env import SkinVectorEnv
from tactemu.geometry.shapes.box import Box as BoxShape
from tactemu.geometry.shapes.sphere import Sphere
from tactemu.imperfections import ElectronicsOptions, ImperfectionOptions
from tactemu.scene.scene import Scene
from tactemu.sensors.probes.kinematic_taxel import KinematicTaxel

PAD_SIZE_M = (0.04, 0.04, 0.01)
PITCH_M = 5e-3
RADIUS_M = 8e-3
SPEED_M_S = 0.02
"""The ball's speed at the end of the range of an action."""
LOWEST_M = (-0.012, -0.012, -3e-3)
HIGHEST_M = (0.012, 0.012, 4e-3)
"""Range of the ball's lowest point; z is 0 at the surface of the pad."""
START_HEIGHT_M = 1e-3
FORCES_N = (0.5, 2.0)
"""Range of the force to press with, drawn at the beginning of each episode."""
MAX_TAXEL_FORCE_N = 2.0
"""The force beyond which a taxel saturates."""
MAX_FORCE_N = 4.0
"""The force that ends an episode."""


class PressTask(SkinTask):
    """Press a ball into a pad of taxels with a given force, and hold it.

    An action moves the ball along x, y and z, at most :data:`SPEED_M_S` each. The observation is ``pad_force`` [N],
    ``ball``, the position of its lowest point [m], and ``target`` [N]. The reward is 1 at the target, and 0 from its
    double on and without a touch; an episode ends at :data:`MAX_FORCE_N`. Both use the true force.

    Args:
        rows: number of rows of taxels, and of columns.
        noise: standard deviation of the noise of each force [N].
        gain_range: range of the gain that each taxel draws at the beginning of each episode.
        max_episode_steps: number of steps after which an episode is truncated.
    """

    observed = {"pad": ["force"]}

    def __init__(
        self,
        *,
        rows: int = 6,
        noise: float = 5e-3,
        gain_range: tuple[float, float] = (0.9, 1.1),
        max_episode_steps: int = 200,
    ):
        self._rows, self._noise, self._gain_range = rows, noise, gain_range
        super().__init__(max_episode_steps=max_episode_steps)

    def build(self, scene: Scene) -> Box:
        half = 0.5 * PITCH_M * (self._rows - 1)
        line = np.linspace(-half, half, self._rows)
        x, y = np.meshgrid(line, line)
        taxels = KinematicTaxel(
            positions=np.stack([x, y, np.full_like(x, 0.5 * PAD_SIZE_M[2])], axis=-1),
            radius=1e-3,
            normal_stiffness=400.0,
            imperfections=ImperfectionOptions(gain_range=self._gain_range),
            electronics=ElectronicsOptions(noise=self._noise, saturation_range=(-MAX_TAXEL_FORCE_N, MAX_TAXEL_FORCE_N)),
        )
        pad = scene.add_body(BoxShape(size=PAD_SIZE_M), name="pad", fixed=True, position=(0, 0, -0.5 * PAD_SIZE_M[2]))
        self._ball = scene.add_body(Sphere(radius=RADIUS_M), name="ball", position=(0, 0, RADIUS_M + START_HEIGHT_M))
        scene.add_sensor(taxels, link=pad, name="pad")
        return Box(-1.0, 1.0, (3,), np.float32)

    def connect(self) -> None:
        self._low, self._high = self.arrays.asarray(LOWEST_M), self.arrays.asarray(HIGHEST_M)
        self._centre = self.arrays.asarray((0.0, 0.0, RADIUS_M))
        self._position, self._target = self.zeros((self.num_envs, 3)), self.zeros((self.num_envs, 1))

    def begin(self, envs: Array) -> None:
        start = self.uniform((-4e-3, -4e-3, START_HEIGHT_M), (4e-3, 4e-3, START_HEIGHT_M), 3)
        self.merge(envs, start, self._position)
        self.merge(envs, self.uniform(*FORCES_N, 1), self._target)
        self.place(self._ball, position=self._position + self._centre)

    def act(self, actions: Array) -> None:
        wanted = self._position + actions * (SPEED_M_S * self.dt)
        moved = self.xp.clip(wanted, self._low, self._high)
        velocity = (moved - self._position) / self.dt
        self._position = moved
        self.place(self._ball, position=moved + self._centre, linear_velocity=velocity)

    def more_spaces(self) -> Mapping[str, Box]:
        limits = np.array([LOWEST_M, HIGHEST_M], np.float32)
        return {"ball": Box(*limits, dtype=np.float32), "target": Box(*FORCES_N, (1,), np.float32)}

    def more_observations(self) -> Mapping[str, Array]:
        return {"ball": self._position, "target": self._target}

    def measure(self) -> None:
        self._force: Array = -self.read("pad", "force", ground_truth=True)[..., 2].sum((-2, -1))  # [N]

    def reward(self) -> Array:
        target = self._target[:, 0]
        return self.xp.clip(1.0 - abs(self._force - target) / target, 0.0, 1.0)

    def terminated(self) -> Array:
        return self._force > MAX_FORCE_N

    def info(self) -> Mapping[str, Array]:
        return {"force": self._force}


class PressEnv(SkinEnv):
    """One environment of :class:`PressTask`, ``tactemu/Press-v0``."""

    task_class = PressTask


class PressVectorEnv(SkinVectorEnv):
    """Many environments of :class:`PressTask`."""

    task_class = PressTask
