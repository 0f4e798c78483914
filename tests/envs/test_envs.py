"""Environments of Gymnasium: judged by its checker, and by its own vector environments of single ones."""

import multiprocessing
import subprocess
import sys
import warnings

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium", reason="pip install 'tactemu[gym]'")

from gymnasium.error import ResetNeeded  # noqa: E402
from gymnasium.utils.env_checker import check_env, data_equivalence  # noqa: E402
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv  # noqa: E402

import tactemu as tt  # noqa: E402
import tactemu.envs  # noqa: E402  registers them
from tactemu.base.errors import PoseError, SceneError  # noqa: E402
from tests.scene.engine_models import NEEDS_ENGINES  # noqa: E402

N_ENVS = 3
SEED = 2**31 - 2
"""Environments take this and the numbers that follow, over the end of 31 bits."""
SHORT = {"max_episode_steps": 21}
MODES = list(AutoresetMode)
KINDS = ["Press", pytest.param("Hand", marks=NEEDS_ENGINES)]


def single(**options):
    return tt.envs.PressEnv(**(SHORT | options))


def many(num_envs=N_ENVS, **options):
    return tt.envs.PressVectorEnv(num_envs, **(SHORT | options))


def actions(steps, n_envs=N_ENVS):
    """Actions that press: the first environment presses until its force ends the episode."""
    made = np.random.default_rng(0).uniform(-1, 1, (steps, n_envs, 3)).astype(np.float32)
    made[:, 0, 2] = -1
    return made


def same(found, expected):
    """Compare bit for bit what two environments return."""
    assert data_equivalence(found, expected, exact=True), (found, expected)


@pytest.mark.parametrize("kind", KINDS)
def test_gymnasium_s_checker_passes_with_noise_on(kind):
    env = gymnasium.make(f"tactemu/{kind}-v0", noise=0.05, disable_env_checker=True, render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*(minimum|maximum) value is -?infinity")  # angles and the ball
        warnings.filterwarnings("ignore", category=DeprecationWarning)
        check_env(env.unwrapped)
    env.close()


@pytest.mark.parametrize("kind", KINDS)
def test_spaces_hold_what_is_returned(kind):
    envs = gymnasium.make_vec(f"tactemu/{kind}-v0", num_envs=2)
    assert type(envs) is getattr(tt.envs, f"{kind}VectorEnv") and envs.num_envs == 2
    env = gymnasium.make(f"tactemu/{kind}-v0")
    assert envs.single_observation_space == env.observation_space
    assert envs.single_action_space == env.action_space
    assert envs.observation_space == gymnasium.vector.utils.batch_space(env.observation_space, 2)
    assert envs.action_space == gymnasium.vector.utils.batch_space(env.action_space, 2)
    observation, _ = envs.reset(seed=0)
    assert observation in envs.observation_space
    observation, reward, terminated, truncated, infos = envs.step(envs.action_space.sample())
    assert observation in envs.observation_space
    assert reward.dtype == np.float64 and terminated.dtype == truncated.dtype == bool
    assert reward.shape == terminated.shape == truncated.shape == infos["force"].shape == (2,)
    assert all(unit == "N" for unit in envs.metadata["units"].values())
    envs.close()


def test_limits_follow_from_the_electronics():
    space = single().observation_space["pad_force"]
    assert space.shape == (6, 6, 3) and (space.low == -2).all() and (space.high == 2).all()


@pytest.mark.parametrize("mode", MODES)
def test_a_vector_environment_equals_single_ones(mode):
    """Gymnasium's own vector environment of single ones judges episodes that end, by a force or by time."""
    envs = many(autoreset_mode=mode)
    expected = SyncVectorEnv([single] * N_ENVS, autoreset_mode=mode)
    assert envs.metadata["autoreset_mode"] is expected.metadata["autoreset_mode"] is mode
    same(envs.reset(seed=SEED), expected.reset(seed=SEED))
    ended = np.zeros(2, int)
    for each in actions(60):
        found, wanted = envs.step(each), expected.step(each)
        same(found, wanted)
        ended += found[2].sum(), found[3].sum()
        done = found[2] | found[3]
        if mode is AutoresetMode.DISABLED and done.any():
            same(*(env.reset(options={"reset_mask": done}) for env in (envs, expected)))
    assert ended.min() > 0, "some episodes are terminated, others truncated"


@pytest.mark.parametrize("mode", MODES)
def test_tensors_have_the_same_values(mode):
    torch = pytest.importorskip("torch", reason="torch: an environment of its own")
    envs, expected = many(autoreset_mode=mode, arrays="torch"), many(autoreset_mode=mode)
    found, wanted = envs.reset(seed=SEED), expected.reset(seed=SEED)
    for each in actions(60):
        for name, values in wanted[0].items():
            assert isinstance(found[0][name], torch.Tensor) and (found[0][name].numpy() == values).all()
        if "final_obs" in wanted[-1]:
            for e in np.flatnonzero(wanted[-1]["_final_obs"]):
                same({name: row[e].numpy() for name, row in found[-1]["final_obs"].items()}, wanted[-1]["final_obs"][e])
        found, wanted = envs.step(torch.as_tensor(each)), expected.step(each)
        np.testing.assert_allclose(found[1].numpy(), wanted[1], atol=1e-6)
        assert all((one.numpy() == other).all() for one, other in zip(found[2:4], wanted[2:4]))
        done = wanted[2] | wanted[3]
        if mode is AutoresetMode.DISABLED and done.any():
            found = envs.reset(options={"reset_mask": torch.as_tensor(done)})
            wanted = expected.reset(options={"reset_mask": done})


@NEEDS_ENGINES
def test_vectors_of_hands_equal_single_ones():
    options = {"max_episode_steps": 3}
    envs = tt.envs.HandVectorEnv(2, **options)
    expected = SyncVectorEnv([lambda: tt.envs.HandEnv(**options)] * 2)
    same(envs.reset(seed=SEED), expected.reset(seed=SEED))
    close = np.tile(np.float32([0.6, 0.6, 0.6, 0.6, 0.2, 1.0]), (2, 1))
    for each in close * np.float32([[[1.0], [0.5]]] * 5):
        same(envs.step(each), expected.step(each))


def test_seeds():
    envs = many()
    first, _ = envs.reset(seed=5)
    again, _ = envs.reset(seed=[5, 9, 5])
    same(first["target"][0], again["target"][0])
    same(again["target"][0], again["target"][2])
    assert again["target"][1] != first["target"][1]
    step = actions(1)[0] * 0 - 1
    readings = []
    for seed in (5, 5, None, 6):
        envs.reset(seed=seed)
        readings.append(envs.step(step)[0]["pad_force"])
    same(readings[0], readings[1])
    assert (readings[1] != readings[2]).all(), "without a seed noise is drawn anew"
    same(readings[0][1:], readings[3][:-1])


def test_without_a_seed_two_runs_differ():
    first, second = (many().reset()[0]["target"] for _ in range(2))
    assert (first != second).all()


def test_a_step_needs_a_reset():
    env = single()
    with pytest.raises(ResetNeeded, match="call reset first"):
        env.step(env.action_space.sample())
    env.reset(seed=0)
    for _ in range(SHORT["max_episode_steps"]):
        *_, truncated, _ = env.step(np.zeros(3, np.float32))
    assert truncated
    with pytest.raises(ResetNeeded, match="environments have ended: 0"):
        env.step(env.action_space.sample())


@pytest.mark.parametrize("mask", [np.ones(2, bool), np.ones(N_ENVS), [True] * N_ENVS])
def test_a_wrong_mask_is_refused(mask):
    envs = many()
    envs.reset(seed=0)
    with pytest.raises(SceneError, match=r"reset_mask must be bool, of shape \(3,\), got"):
        envs.reset(options={"reset_mask": mask})


def test_actions_are_clipped_and_must_be_numbers():
    env = single()
    env.reset(seed=0)
    before, *_ = env.step(np.zeros(3, np.float32))
    after, *_ = env.step(np.array([100.0, 0.0, 0.0]))
    assert after["ball"][0] - before["ball"][0] == pytest.approx(2e-4, rel=1e-3)
    with pytest.raises(PoseError, match="ball"):
        env.step(np.full(3, np.nan))


def test_pictures_are_brighter_where_the_ball_presses():
    env = single(render_mode="rgb_array", noise=0.0)
    env.reset(seed=0)
    at_rest = env.render()
    for _ in range(8):
        env.step(np.float32([0, 0, -1]))
    pressed = env.render()
    assert at_rest.shape == pressed.shape == (6 * 16 + 16, 6 * 16 + 16, 3) and pressed.dtype == np.uint8
    assert pressed.max() > at_rest.max()
    envs = many(render_mode="rgb_array")
    envs.reset(seed=0)
    assert len(envs.render()) == N_ENVS
    assert env.metadata["render_modes"] == envs.metadata["render_modes"] == ["rgb_array"]
    assert env.metadata["render_fps"] == 100
    with pytest.raises(SceneError, match="render_mode must be 'rgb_array' or None, got 'human'"):
        single(render_mode="human")


@pytest.mark.parametrize("context", ["fork", "spawn"])
def test_processes_of_single_ones(context):
    if context not in multiprocessing.get_all_start_methods():
        pytest.skip(f"this system has no {context}")
    envs, expected = AsyncVectorEnv([single] * 2, context=context), many(2)
    try:
        same(envs.reset(seed=3), expected.reset(seed=3))
        for each in actions(30, 2):
            same(envs.step(each), expected.step(each))
    finally:
        envs.close()


@pytest.mark.filterwarnings("ignore:.*Worker-0|.*Traceback|.*Raising the last")
def test_a_fork_on_a_gpu_is_refused_in_words():
    envs = AsyncVectorEnv([lambda: single(device="cuda:0")], context="fork")
    try:
        with pytest.raises(SceneError, match=r"a forked process cannot use the GPU 'cuda:0'.* context='spawn'"):
            envs.reset(seed=0)
    finally:
        envs.close(terminate=True)


def test_a_name_registers_by_its_module():
    assert gymnasium.make("tactemu.envs:tactemu/Press-v0").unwrapped.spec.id == "tactemu/Press-v0"


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("import sys, tactemu; assert 'gymnasium' not in sys.modules", ""),
        ("import sys; sys.modules['gymnasium'] = None; import tactemu as tt; dir(tt.envs)", ""),
        (
            "import sys; sys.modules['gymnasium'] = None; from tactemu.envs import PressEnv",
            "pip install 'tactemu[gym]'",
        ),
    ],
)
def test_gymnasium_is_imported_when_needed(code, words):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60)
    assert (words in done.stderr) if words else (done.returncode == 0), done.stderr
