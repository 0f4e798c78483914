"""Resets with a seed on CUDA: the draws of the CPU, by masks and numbers on the device, without waiting and in graphs.

Run on a machine with a CUDA device: ``python -m pytest tests/gpu/test_seeds_on_cuda.py``.
"""

import numpy as np
import pytest
import warp as wp

from tactemu.base.errors import SceneError
from tactemu.imperfections.random import draw, step_of, stream_keys
from tactemu.plan.clock import Clock
from tactemu.plan.plan import Context
from tactemu.sensors.sensor import reading_array
from tests.api.test_seeds import Rig

pytestmark = pytest.mark.gpu
DEVICE = "cuda:0"
N_ENVS = 300
DONE = np.random.default_rng(1).random(N_ENVS) < 0.3


def on_device(values, dtype) -> wp.array:
    return wp.array(values, dtype=dtype, device=DEVICE)


@wp.kernel(module="unique", enable_backward=False)
def _draws(keys: wp.vec2ui, clock: Clock, out: wp.array2d(dtype=wp.vec4ui)):
    e, i = wp.tid()
    stream = clock.streams[e]
    out[e, i] = draw(keys, stream, step_of(clock, stream, e), i)


def words(device: str) -> np.ndarray:
    """Words that environments draw in a later step, of which some have seeds of all sizes."""
    context = Context(device=wp.get_device(device), n_envs=N_ENVS, real=wp.float32, seed=3, first_env=12)
    seeds = np.random.default_rng(0).integers(0, 2**63 - 1, N_ENVS)
    context.step.fill_(5)
    context.begin(wp.array(DONE, device=device), wp.array(seeds, dtype=wp.int64, device=device))
    context.step.fill_(2**33)
    context.begin(wp.full(N_ENVS, True, dtype=wp.bool, device=device))
    context.step.fill_(2**33 + 7)
    out = wp.zeros((N_ENVS, 16), dtype=wp.vec4ui, device=device)
    wp.launch(_draws, dim=out.shape, inputs=[stream_keys(3, "skin/noise"), context.clock, out], device=device)
    return out.numpy()


def test_the_same_words_are_drawn_on_both_devices():
    assert np.array_equal(words("cpu"), words(DEVICE))


def readings(device: str, steps: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """Readings of environments some of which were reset with a seed on the way, and which taxels are dead then."""
    rig = Rig(N_ENVS, device=device)
    seen = []
    for k in range(steps):
        if k == 3:
            rig.sim.reset(seed=100)
        if k == 6:
            rig.sim.reset(np.flatnonzero(DONE), seed=7)
        rig.press(k)
        seen.append(reading_array(rig.skins[0]).numpy().copy())
    return np.array(seen), rig.skins[0].imperfections.dead


def test_readings_after_a_seed_are_those_of_the_cpu_within_rounding():
    (cpu, dead), (cuda, dead_cuda) = readings("cpu"), readings(DEVICE)
    assert np.array_equal(dead, dead_cuda)
    assert np.isfinite(cuda).all()
    assert np.abs(cpu - cuda).max() <= 1e-4 * np.abs(cpu).max()


def alone(seed: int) -> list[bytes]:
    """The readings on the GPU of one environment that is reset with a seed."""
    rig = Rig(device=DEVICE)
    rig.sim.reset(seed=seed)
    return rig.run(steps=5)


def numbers_of(given: str, dtype) -> tuple[object, np.ndarray]:
    """A seed for the environments of a mask as it may be given, and the number that each takes."""
    place = np.cumsum(DONE) - 1
    if given == "a number":
        return 40, 40 + place
    if given == "one on the device":
        return on_device([40], dtype), 40 + place
    own = 3 * np.arange(N_ENVS)
    return (own if given == "a list" else on_device(own, dtype)), own


@pytest.mark.parametrize("dtype", [wp.int32, wp.int64, wp.uint32])
@pytest.mark.parametrize("given", ["a number", "a list", "one on the device", "each on the device"])
def test_a_mask_and_numbers_on_the_device(given, dtype):
    rig = Rig(N_ENVS, device=DEVICE)
    rig.run(steps=3)
    seed, numbers = numbers_of(given, dtype)
    mask = on_device(DONE, wp.bool)
    for _ in range(3):  # launch by launch, captured, from the graph
        rig.run(steps=2)
        rig.sim.reset(mask, seed=seed)
        steps = []
        for k in range(5):
            rig.press(k)
            steps.append(reading_array(rig.skins[0]).numpy().copy())
        for env in np.flatnonzero(DONE)[[0, 1, -1]]:
            assert [each[env].tobytes() for each in steps] == alone(int(numbers[env]))
    rig.sim.reset(mask)  # without a seed: the next episode of the same number, by the other graph
    env = int(np.flatnonzero(DONE)[0])
    assert rig.run(env, steps=5)[-1] != alone(int(numbers[env]))[-1]


def test_all_environments_by_numbers_on_the_device():
    rig = Rig(N_ENVS, device=DEVICE)
    rig.run(steps=3)
    rig.sim.reset(seed=on_device(np.arange(N_ENVS) + 5, wp.int64))
    assert rig.run(env=9, steps=5) == alone(14)


def rested(rig: Rig, mask: wp.array, seed, poses: wp.array) -> None:
    """Reset with a seed, and take steps with the ball where it was; a delay ends in them."""
    rig.sim.reset(mask, seed=seed)
    wp.copy(rig.sim.pose_array, poses)
    rig.sim.step(5)


def alone_at_rest(seed: int) -> bytes:
    """The reading of one environment after :func:`rested`."""
    rig = Rig(1, device=DEVICE)
    rig.press(0)
    rested(rig, on_device([True], wp.bool), on_device([seed], wp.int64), wp.clone(rig.sim.pose_array))
    return rig.seen(0)


@pytest.mark.parametrize("given", ["one on the device", "each on the device"])
def test_a_graph_takes_the_numbers_that_the_array_has_when_it_is_launched(given):
    rig = Rig(N_ENVS, device=DEVICE)
    rig.run(steps=2)
    seed, _ = numbers_of(given, wp.int64)
    assert isinstance(seed, wp.array)
    mask = on_device(DONE, wp.bool)
    rig.sim.reset(mask)
    with pytest.raises(SceneError, match="reset once with such an array"), wp.ScopedCapture(DEVICE):
        rig.sim.reset(mask, seed=seed)
    rig.sim.reset(mask, seed=seed)
    rig.press(0)
    poses = wp.clone(rig.sim.pose_array)  # of the press, which a reset ends
    with wp.ScopedCapture(DEVICE) as capture:
        rested(rig, mask, seed, poses)
    env = int(np.flatnonzero(DONE)[4])
    for first in (40, 900, 40):
        seed.assign(np.full(seed.shape, first))
        wp.capture_launch(capture.graph)
        number = first + 4 if given == "one on the device" else first
        assert rig.seen(env) == alone_at_rest(number)
    assert alone_at_rest(40) != alone_at_rest(900)


@pytest.mark.parametrize("seed, envs", [(4, "mask"), (list(range(N_ENVS)), "mask"), ("array", None), ("array", [1, 2])])
def test_a_graph_refuses_seeds_and_environments_that_would_be_the_same_at_each_launch(seed, envs):
    rig = Rig(N_ENVS, device=DEVICE)
    rig.run(steps=2)
    rig.sim.reset(on_device(DONE, wp.bool), seed=4)
    given = on_device(np.arange(N_ENVS), wp.int64) if seed == "array" else seed
    where = on_device(DONE, wp.bool) if envs == "mask" else envs
    same = "the same seed in each launch" if envs == "mask" else "the same environments in each launch"
    with pytest.raises(SceneError, match=same), wp.ScopedCapture(DEVICE):
        rig.sim.reset(where, seed=given)


@pytest.mark.parametrize("seed", [np.zeros(2), np.zeros(2, np.int64), np.zeros((N_ENVS, 1), np.int64)])
def test_an_array_that_does_not_fit_is_refused(seed):
    rig = Rig(N_ENVS, device=DEVICE)
    with pytest.raises(SceneError, match=f"must have 1 or {N_ENVS} numbers"):
        rig.sim.reset(on_device(DONE, wp.bool), seed=wp.array(seed, device=DEVICE))
    with pytest.raises(SceneError, match="move it there first"):
        rig.sim.reset(on_device(DONE, wp.bool), seed=wp.zeros(N_ENVS, dtype=wp.int64, device="cpu"))
