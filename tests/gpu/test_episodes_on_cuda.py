"""Motions on each environment's own clock on a CUDA device: in graphs, with masked resets; against the CPU.

Run on a machine with a CUDA device: ``python -m pytest tests/gpu/test_episodes_on_cuda.py``.
"""

import numpy as np
import pytest
import warp as wp

import tactemu as tt
from tactemu.base.errors import SceneError
from tests.api.test_episodes import PRESS, SEQUENCE, built

pytestmark = pytest.mark.gpu
DEVICE = "cuda:0"
N_ENVS = 6
DONE = np.random.default_rng(4).random((40, N_ENVS)) < 0.1
"""The environments that each turn resets before its step."""


def turns(device, motion, *, captured=False):
    """The readings, poses and times of 40 turns; of a graph of one turn that is launched again and again."""
    sim, _ball, skin = built(N_ENVS, motion, device=device)
    done = wp.zeros(N_ENVS, dtype=wp.bool, device=device)
    sim.step()
    sim.reset(done)
    graph = None
    if captured:
        with wp.ScopedCapture(device) as capture:
            sim.reset(done)
            sim.step()
        graph = capture.graph
    found = []
    for mask in DONE:
        done.assign(mask)
        if graph is not None:
            wp.capture_launch(graph)
        else:
            sim.reset(done)
            sim.step()
        poses = sim.pose_array.numpy()[:, 1].copy()  # on a CPU it is a view
        found.append((skin.read().reshape(N_ENVS, -1), poses, sim.env_time[:, None]))
    return [np.array(each) for each in zip(*found)]


@pytest.mark.parametrize("motion", [PRESS, SEQUENCE], ids=["press", "sequence"])
def test_a_graph_captures_steps_with_motions_and_masked_resets(motion):
    on_cpu, by_hand, in_graph = turns("cpu", motion), turns(DEVICE, motion), turns(DEVICE, motion, captured=True)
    assert all(map(np.array_equal, by_hand, in_graph))
    readings, poses, times = (np.abs(a - b).max() for a, b in zip(on_cpu, in_graph))
    assert times == 0 and poses <= (0 if motion is PRESS else 1e-12) and readings <= 1e-7
    assert on_cpu[0].max() > 5e-4


def changes(sim, ball):
    """Ways to take a body from its motion and to give it back."""
    return [
        lambda: sim.set_pose(ball, position=(0, 0, 0.0095), envs=[1, 4]),
        lambda: sim.reset([4, 5]),
        lambda: sim.set_pose(ball, position=(0, 0, 0.5)),
        lambda: sim.set_pose(ball, quaternion=(0, 0, 0, 1), order="xyzw"),
        lambda: sim.release(ball, envs=[2, 3]),
        lambda: sim.set_pose(ball, linear_velocity=(0, 1, 0), envs=[2]),
        lambda: sim.reset(np.arange(N_ENVS) == 0),
        lambda: sim.reset(),
    ]


@pytest.mark.parametrize(
    "motion", [PRESS, tt.FromFunction(function=lambda t: (0, 0, -0.1 * t))], ids=["plain", "python"]
)
def test_bodies_are_taken_and_released_as_on_the_cpu(motion):
    found = []
    for device in ("cpu", DEVICE):
        sim, ball, _ = built(N_ENVS, motion, device=device)
        poses = [sim.pose(ball)]
        for change in changes(sim, ball):
            sim.step(4)
            change()
            poses += [sim.pose(ball, env) for env in range(N_ENVS)]
            sim.step(3)
            poses += [sim.pose(ball, env) for env in range(N_ENVS)]
        found.append(np.array([np.concatenate(pose) for pose in poses]))
    assert np.array_equal(*found)


def test_a_state_holds_the_starts_on_a_gpu():
    sim, ball, skin = built(N_ENVS, device=DEVICE)
    sim.step(5)
    sim.reset(wp.array(np.arange(N_ENVS) == 2, dtype=wp.bool, device=DEVICE))
    sim.set_pose(ball, position=(0, 0, 0.0095), envs=[3])
    sim.step(15)
    state = sim.state()
    sim.step(10)
    expected = skin.read()
    sim.reset()
    sim.prepare_restore(state)()
    sim.step(10)
    assert np.array_equal(skin.read(), expected)


def test_what_python_moves_is_refused_in_words():
    sim, _, _ = built(N_ENVS, tt.FromFunction(function=lambda t: (0, 0, -0.1 * t)), device=DEVICE)
    sim.step()
    with pytest.raises(SceneError, match="a mask on the device does not tell Python which environments begin anew"):
        sim.reset(wp.zeros(N_ENVS, dtype=wp.bool, device=DEVICE))
    with pytest.raises(SceneError, match="cannot capture what Python computes: the motions of ball"):
        with wp.ScopedCapture(DEVICE):
            sim.step()
    sim.reset([1])
    sim.step()


@pytest.mark.parametrize("envs", [None, [1, 4], np.arange(N_ENVS) == 2], ids=["all", "numbers", "mask"])
def test_a_captured_reset_of_environments_on_the_host_is_refused_in_words(envs):
    sim, _, _ = built(N_ENVS, device=DEVICE)
    sim.step()
    sim.reset(wp.zeros(N_ENVS, dtype=wp.bool, device=DEVICE))
    with pytest.raises(SceneError, match="reset the same environments in each launch; give a mask on the device"):
        with wp.ScopedCapture(DEVICE):
            sim.reset(envs)
    sim.reset(envs)
    sim.step()


def test_poses_of_another_simulator_take_a_body_from_its_motion():
    sim, ball, _ = built(2, device=DEVICE)
    places = wp.array([[[0, 0, 0.02]], [[0, 0, 0.03]]], dtype=wp.float64, device=DEVICE)
    sim.bind_poses(position=places, index={"ball": 0})
    for _ in range(4):
        sim.step()
    sim.reset(wp.ones(2, dtype=wp.bool, device=DEVICE))
    sim.step()
    assert np.array_equal(sim.pose_array.numpy()[:, 1, 2], (0.02, 0.03))
    sim.release(ball)
    sim.reset()
    sim.step(4)
    assert all(map(np.array_equal, sim.pose(ball), ball.pose(0.004)))
