"""Environments of Gymnasium on a GPU: they observe what those on a CPU do, and no step waits with torch."""

import numpy as np
import pytest

pytest.importorskip("gymnasium", reason="pip install 'tactemu[gym]'")

from gymnasium.vector import AsyncVectorEnv, AutoresetMode

import tactemu as tt
from tactemu.base.errors import SceneError
from tests.envs.test_envs import SEED, SHORT, actions, many

pytestmark = pytest.mark.gpu
DEVICE = "cuda:0"


def close(found, expected):
    """Compare observations, rewards and ends; a GPU may round otherwise."""
    for name, values in expected[0].items():
        np.testing.assert_allclose(np.asarray(found[0][name].cpu()), values, atol=1e-5)
    for one, other in zip(found[1:-1], expected[1:-1]):
        np.testing.assert_allclose(np.asarray(one.cpu()), other, atol=1e-5)


@pytest.mark.parametrize("library", ["numpy", "torch"])
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_a_gpu_observes_what_a_cpu_does(mode, library):
    torch = pytest.importorskip("torch", reason="torch is not installed")
    envs, expected = many(device=DEVICE, arrays=library, autoreset_mode=mode), many(autoreset_mode=mode)
    found = envs.reset(seed=SEED)
    close((to_torch(torch, found[0]), *found[1:]), expected.reset(seed=SEED))
    for each in actions(60):
        observation, *rest, infos = envs.step(torch.as_tensor(each, device=DEVICE) if library == "torch" else each)
        found = to_torch(torch, observation), *(torch.as_tensor(one) for one in rest), infos
        close(found, expected.step(each))


def to_torch(torch, observation):
    return {name: torch.as_tensor(values) for name, values in observation.items()}


def test_a_fork_is_refused_and_spawned_processes_work():
    make = [lambda: tt.envs.PressEnv(device=DEVICE, **SHORT)] * 2
    envs = AsyncVectorEnv(make, context="fork")
    with pytest.raises(SceneError, match="a forked process cannot use the GPU"):
        envs.reset(seed=0)
    envs.close(terminate=True)
    envs = AsyncVectorEnv(make, context="spawn")
    observation, _ = envs.reset(seed=0)
    assert observation["pad_force"].shape == (2, 6, 6, 3)
    envs.close()
