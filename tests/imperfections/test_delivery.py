"""Delay, jitter and history to the nanosecond. The load is the time of its step in seconds: a reading tells its age."""

import numpy as np
import pytest
import warp as wp

from tactemu.base.errors import SceneError
from tests.imperfections.rig import Rig, info, options

ONE = info((1,))
SIGMAS = 4.5


def ages(steps, n_envs=1, dt=1e-3, start=None, **given) -> np.ndarray:
    """Age [s] of the reading delivered at each step, ``(steps, n_envs)``, once the ring is full."""
    rig = Rig(options(**given), ONE, n_envs=n_envs, dt=dt)
    out = np.empty((steps, n_envs))
    for k in range(steps):
        now = (rig.now + rig.dt_ns) * 1e-9
        out[k] = now - rig.step(now).reshape(n_envs, -1)[:, 0]
    skip = int(round((given.get("delay", 0) + given.get("jitter", 0)) / dt)) + 3 if start is None else start
    return out[skip:]


@pytest.mark.parametrize("dt", [1e-3, 7e-4, 1 / 3000])
@pytest.mark.parametrize("delay", [0.0037, 0.003, 0.0004])
def test_held_reading_is_the_newest_that_is_old_enough(dt, delay):
    """Never earlier than the delay (to the rounding of time to nanoseconds) and less than a step later."""
    seen = ages(60, dt=dt, delay=delay)
    assert seen.min() >= delay - 2e-9
    assert seen.max() < delay + dt - 1e-9
    assert np.ptp(seen) < 1e-8, "a constant delay does not alternate between steps"


@pytest.mark.parametrize("delay", [0.0037, 0.0030001, 1e-9, 0.25e-3])
def test_interpolated_delay_is_exact(delay):
    np.testing.assert_allclose(ages(40, delay=delay, delay_interpolation="linear"), delay, atol=2e-9)


@pytest.mark.parametrize("delay, steps", [(0.0034, 3), (0.0036, 4), (0.0025, 2), (0.0035, 4)])
def test_nearest_rounds_to_whole_steps_halves_to_even(delay, steps):
    np.testing.assert_allclose(ages(40, delay=delay, delay_interpolation="nearest"), steps * 1e-3, atol=1e-12)


def test_nothing_arrives_before_the_delay_has_passed():
    rig = Rig(options(delay=0.0037), ONE)
    np.testing.assert_array_equal(rig.run(6, 1.0).ravel(), [0, 0, 0, 0, 1, 1])


def test_delay_with_unequal_steps_is_told_by_time():
    rig = Rig(options(delay=0.005), ONE)
    now, delivered = 0, []
    for dt_ns in (1_000_000, 3_000_000, 2_500_000, 1_500_000, 2_000_000, 1_000_000, 4_000_000):
        now += dt_ns
        delivered.append((now, round(rig.step(now, dt_ns=dt_ns).item())))
    assert delivered[3:] == [
        (8_000_000, 1_000_000),
        (10_000_000, 4_000_000),
        (11_000_000, 4_000_000),
        (15_000_000, 10_000_000),
    ]


@pytest.mark.parametrize("reorder", [True, False])
def test_jitter_is_uniform_and_reorders_only_when_asked(reorder):
    """Draws are told by interpolated ages of 1000 environments: uniform in [delay, delay + jitter] where reordering is
    allowed or impossible (jitter below the step)."""
    from scipy.stats import kstest

    given = {"delay": 2e-3, "jitter": 0.9e-3, "delay_interpolation": "linear", "jitter_reorder": reorder}
    seen = ages(120, n_envs=1000, **given)
    assert seen.size >= 100_000
    assert kstest(seen.ravel(), "uniform", args=(2e-3, 0.9e-3)).pvalue > 1e-3
    assert seen.min() >= 2e-3 - 1e-9 and seen.max() <= 2.9e-3 + 1e-9
    centred = seen - 2.45e-3
    assert abs(np.mean(centred[1:] * centred[:-1])) < SIGMAS * 0.9e-3**2 / 12 / np.sqrt(seen.size)


def test_long_jitter_never_reorders_a_million_readings():
    """Jitter of ten steps: source times never fall, ages stay within [delay, delay + jitter]."""
    given = {"delay": 1e-3, "jitter": 10e-3}
    for interpolation in ("hold", "linear"):
        seen = ages(520, n_envs=1000, delay_interpolation=interpolation, **given)
        assert seen.size >= 500_000
        source = np.arange(len(seen))[:, None] * 1e-3 - seen
        assert np.diff(source, axis=0).min() >= -1e-9
        assert seen.min() >= 1e-3 - 1e-9 and seen.max() < 12e-3
    unordered = ages(200, n_envs=100, jitter_reorder=True, **given)
    assert (np.diff(np.arange(len(unordered))[:, None] * 1e-3 - unordered, axis=0) < -5e-4).mean() > 0.2


def test_jitter_differs_between_environments_and_sensors():
    """The reference indexes jitter by column, so that one sensor gets another's; here each has its own draws."""
    given = {"delay": 2e-3, "jitter": 1e-3, "delay_interpolation": "linear"}
    series = []
    for name in ("left", "right"):
        rig = Rig(options(**given), info((1,), name=name), n_envs=2)
        series += list(
            np.array([(rig.now + 10**6) * 1e-9 - rig.step((rig.now + 10**6) * 1e-9).ravel() for _ in range(600)])[10:].T
        )
    assert np.abs(np.corrcoef(series) - np.eye(4)).max() < SIGMAS / np.sqrt(590)


@pytest.mark.parametrize("depth", [1, 3])
def test_history_holds_the_last_delivered_readings_newest_first(depth):
    rig = Rig(options(delay=2e-3, history_length=depth), info((2,)))
    seen = np.array([rig.step(k + 1.0)[0, :, 0, 0] for k in range(8)])
    for h in range(depth):
        np.testing.assert_array_equal(seen[:, h], np.maximum(np.arange(1.0, 9.0) - 2 - h, 0))


@pytest.mark.parametrize("restart", [False, True])
def test_reset_forgets_what_is_under_way(restart):
    """Readings are 0 until one made after the reset is old enough, also when the time starts anew."""
    rig = Rig(options(delay=2e-3, history_length=2), ONE, n_envs=2)
    rig.run(20, 1.0)
    if restart:
        rig.reset()
        rig.restart()
    else:
        rig.reset([1])
    np.testing.assert_array_equal(rig.reading.numpy()[1], 0.0)
    seen = rig.run(5, 2.0)[:, :, 0, 0, 0]
    np.testing.assert_array_equal(seen[:, 1], [0, 0, 2, 2, 2])
    np.testing.assert_array_equal(seen[:, 0], [0, 0, 2, 2, 2] if restart else [1, 1, 2, 2, 2])


def test_delayed_bits_stay_bits():
    """A touch flag can be delayed too: the ring takes any number type."""
    rig = Rig(options(delay=2e-3, delay_interpolation="linear"), ONE)
    bits = wp.zeros((1, 1, 1), dtype=wp.bool, device="cpu")
    out, stages = rig.chain.compile_delivery(bits)
    rig.stages += stages
    seen = []
    for k in range(6):
        bits.fill_(k >= 2)
        rig.step()
        seen.append(bool(out.numpy().item()))
    assert seen == [False, False, False, False, True, True]


def test_step_counter_beyond_two_to_the_31():
    rig = Rig(options(delay=3e-3), ONE, step=2**31 - 4)
    seen = [rig.step(float(k)).item() for k in range(10)]
    assert seen == [0, 0, 0, 0, 1, 2, 3, 4, 5, 6]


def test_jitter_is_set_per_environment_within_the_room_made():
    rig = Rig(options(delay=2e-3, delay_interpolation="linear", adjustable=("jitter",)), ONE, n_envs=3)
    rig.chain.set_jitter([0.5e-3, 1e-3], envs=[0, 2])
    seen = np.array([(k + 1) * 1e-3 - rig.step((k + 1) * 1e-3).ravel() for k in range(300)])[5:] - 2e-3
    np.testing.assert_allclose(seen[:, 1], 0.0, atol=2e-9)
    assert seen[:, 0].max() <= 0.5e-3 + 1e-9 and seen[:, 2].max() > 0.9e-3
    with pytest.raises(SceneError, match=r"jitter must be in 0\.\.0\.001 s"):
        rig.chain.set_jitter(5e-3)
    with pytest.raises(SceneError, match="adjustable"):
        Rig(options(delay=1e-3), ONE).chain.set_jitter(1e-3)
