"""An environment of Gymnasium that a user writes around a scene with noise: its seed is that of the scene's reset."""

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium", reason="pip install 'tactemu[gym]'")

from gymnasium.spaces import Box  # noqa: E402
from gymnasium.utils.env_checker import check_env  # noqa: E402

import tactemu as tt  # noqa: E402


class Pressed(gymnasium.Env):
    """A ball that an action moves up and down above four taxels with noise."""

    observation_space = Box(-np.inf, np.inf, (2, 2, 3), np.float32)
    action_space = Box(-1.0, 1.0, (1,), np.float32)

    def __init__(self):
        scene = tt.Scene(dt=1e-3)
        pad = scene.add_body(tt.Box(size=(0.08, 0.08, 0.02)), fixed=True)
        self.ball = scene.add_body(tt.Sphere(radius=0.01), position=(0, 0, 0.02))
        places = [[(x, y, 0.01) for x in (-2e-3, 2e-3)] for y in (-2e-3, 2e-3)]
        taxels = tt.KinematicTaxel(positions=places, electronics=tt.ElectronicsOptions(noise=0.01))
        self.skin = scene.add_sensor(taxels, link=pad)
        self.sim = scene.build()

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.sim.reset(seed=seed)
        return self.skin.read().force, {}

    def step(self, action):
        self.sim.set_pose(self.ball, position=(0, 0, 0.0195 + 5e-4 * float(action[0])))
        self.sim.step()
        force = self.skin.read().force
        return force, float(force[..., 2].sum()), False, False, {}


@pytest.mark.filterwarnings("ignore:.*value is -?infinity|.*alternative render modes")
def test_the_checker_passes_with_noise_on():
    env = Pressed()
    check_env(env)
    env.reset(seed=1)
    first, *_ = env.step(np.zeros(1))
    env.reset(seed=1)
    again, *_ = env.step(np.zeros(1))
    env.reset(seed=2)
    other, *_ = env.step(np.zeros(1))
    assert (first == again).all() and (first != other).all() and first[..., 2].max() < 0
