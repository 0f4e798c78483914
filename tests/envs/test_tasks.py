"""Tasks of a user's own: the one that the page shows, and messages for mistakes."""

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium", reason="pip install 'tactemu[gym]'")

from gymnasium.spaces import Box  # noqa: E402
from gymnasium.utils.env_checker import check_env  # noqa: E402

import tactemu as tt  # noqa: E402
from tactemu.base.errors import SceneError  # noqa: E402
from tests.pages import ROOT, files_of  # noqa: E402


@pytest.mark.filterwarnings("ignore:.*value is -?infinity|.*alternative render modes")
def test_the_task_of_the_page():
    names = {}
    exec(files_of(ROOT / "docs" / "gymnasium.md")["find.py"], names)
    check_env(names["env"])
    envs = names["envs"]
    observation, _ = envs.reset(seed=0)
    assert observation["tip_depth"].shape == (64, 5, 5) and observation in envs.observation_space
    mask = np.arange(64) < 5
    before = envs.task.goal.copy()
    envs.reset(options={"reset_mask": mask})
    assert ((envs.task.goal != before)[:, :2].all(-1) == mask).all(), "only those have another ball"
    balls = envs.task.goal[:, :2]
    assert np.allclose(envs.task.sim.pose_array.numpy()[:, envs.task.ball.index, :2], balls)
    observation, _ = envs.reset(options={"reset_mask": ~mask})
    balls = envs.task.goal[:, :2]
    total = 0.0
    for _ in range(30):
        towards = np.clip((balls - observation["place"]) / 1e-3, -1, 1)
        observation, reward, *_ = envs.step(towards)
        total += reward
    assert (reward > 0.5 * reward.max()).all() and (reward > 0).all(), "each fingertip is below its ball"


DEAD = {"dead_taxel_probability": 0.5, "dead_taxel_value_range": (-1.0, 1.0)}


class Still(tt.envs.SkinTask):
    """Nothing moves."""

    imperfections, electronics = {}, {}

    def build(self, scene):
        pad = scene.add_body(tt.Box(size=(0.02, 0.02, 0.01)), fixed=True)
        scene.add_body(tt.Sphere(radius=0.01), position=(0, 0, 0.0145))
        line = [(x, 0.0, 0.005) for x in (-0.002, 0.0, 0.002)]
        scene.add_sensor(
            tt.KinematicTaxel(
                positions=line,
                imperfections=tt.ImperfectionOptions(**self.imperfections),
                electronics=tt.ElectronicsOptions(**self.electronics),
            ),
            link=pad,
            name="pad",
        )
        return Box(-1.0, 1.0, (1,), np.float32)

    def begin(self, envs):
        pass

    def act(self, actions):
        pass

    def reward(self):
        return self.read("pad", "force").reshape(self.num_envs, -1).sum(-1)


def variant(**attributes):
    return type("Variant", (Still,), attributes)


@pytest.mark.parametrize(
    ("attributes", "shape", "limits"),
    [
        ({}, (3, 3), (-np.inf, np.inf)),
        ({"observed": {"pad": ["torque"]}}, (3, 3), (-np.inf, np.inf)),
        ({"electronics": {"saturation_range": (1.0, 5.0), "resolution": 2.0}}, (3, 3), (0.0, 6.0)),
        ({"electronics": {"saturation_range": (0.0, 5.0)}, "imperfections": DEAD}, (3, 3), (-1.0, 5.0)),
        ({"electronics": {"history_length": 4}}, (4, 3, 3), (-np.inf, np.inf)),
    ],
)
def test_spaces_of_skins(attributes, shape, limits):
    envs = tt.envs.SkinVectorEnv(2, variant(**attributes)())
    (name,) = envs.single_observation_space
    space = envs.single_observation_space[name]
    assert space.shape == shape and (space.low.min(), space.high.max()) == limits
    assert envs.reset(seed=0)[0] in envs.observation_space
    assert envs.step(np.zeros((2, 1)))[0] in envs.observation_space
    envs.render_mode = "rgb_array"
    assert len(envs.render()) == 2


def step(task):
    envs = tt.envs.SkinVectorEnv(2, task)
    envs.reset(seed=0)
    envs.step(np.zeros((2, 1)))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: variant(observed={"pat": ["force"]})(), r"no skin 'pat'; did you mean 'pad'\? \(skins: pad\)"),
        (lambda: variant(observed={"pad": ["forces"]})(), r"skin 'pad' has no field 'forces'; did you mean 'force'\?"),
        (lambda: Still(max_episode_steps=0), "max_episode_steps must be >= 1, got 0"),
        (lambda: tt.envs.SkinEnv(), "an environment needs a task: give one, or set task_class in a subclass"),
        (lambda: tt.envs.SkinEnv(Still(), rows=3), "options of a task that is made already: rows"),
        (
            lambda: tt.envs.SkinVectorEnv(2, Still(), arrays="jax").reset(),
            "arrays must be 'numpy' or 'torch', got 'jax'",
        ),
        (lambda: step(variant(reward=lambda self: 1.0)()), r"Variant: reward must return \(2,\), got \(\)"),
        (lambda: step(variant(terminated=lambda self: np.zeros(3))()), r"terminated must return \(2,\), got \(3,\)"),
        (lambda: tt.envs.HandEnv(engine="mujoco"), "engine must be one of mujoco-warp, newton, got 'mujoco'"),
    ],
)
def test_mistakes_are_told(make, message):
    with pytest.raises(SceneError, match=message):
        make()


def test_an_environment_needs_a_task_of_its_own():
    task = Still()
    tt.envs.SkinEnv(task).reset(seed=0)
    with pytest.raises(SceneError, match="Still: an environment has this task already; make one for each"):
        tt.envs.SkinEnv(task).reset(seed=0)
