"""Setters: only the environments named, only what was built."""

import numpy as np
import pytest

from tactemu.base.errors import SceneError
from tests.imperfections.rig import Rig, info, options

ADJUSTABLE = (
    "bias",
    "noise",
    "random_walk",
    "resolution",
    "gain",
    "dead",
    "radius_noise",
    "saturation_range",
)


def rig(**given) -> Rig:
    return Rig(options(adjustable=ADJUSTABLE, **given), info((4,)), n_envs=4)


def test_adjustable_laws_start_without_effect():
    np.testing.assert_array_equal(rig().step(0.123), np.full((4, 4, 1), 0.123))


@pytest.mark.parametrize(
    "envs, hit",
    [([1], [1]), ([0, 3], [0, 3]), (np.array([False, True, True, False]), [1, 2]), (None, [0, 1, 2, 3])],
)
@pytest.mark.parametrize("setter, value", [("bias", 0.5), ("noise", 0.5), ("random_walk", 0.5), ("resolution", 1.0)])
def test_setters_touch_only_the_environments_named(setter, value, envs, hit):
    r = rig()
    getattr(r.chain, f"set_{setter}")(value, envs=envs)
    changed = (r.step(0.3) != 0.3).any(axis=(1, 2))
    assert np.flatnonzero(changed).tolist() == hit


def test_values_per_environment_and_per_column():
    r = rig()
    r.chain.set_bias([1.0, 2.0, 3.0, 4.0], envs=[2])  # four taxels of one environment
    r.chain.set_bias([[5.0] * 4, [6.0] * 4], envs=[0, 1])
    np.testing.assert_array_equal(r.step(0.0)[..., 0], [[5] * 4, [6] * 4, [1, 2, 3, 4], [0] * 4])


def test_gain_and_death_and_revival():
    r = rig(gain=1.0)
    r.chain.set_gain([1.0, 2.0, 3.0, 4.0], envs=[1])
    np.testing.assert_array_equal(r.gain.numpy(), [[1] * 4, [1, 2, 3, 4], [1] * 4, [1] * 4])
    r.step(0.25)
    r.chain.set_dead(2, envs=[0])
    r.chain.set_dead([0, 1], value=9.0, envs=[3])
    seen = r.step(0.75)[..., 0]
    np.testing.assert_array_equal(seen[0], [0.75, 0.75, 0.25, 0.75])
    np.testing.assert_array_equal(seen[3], [9.0, 9.0, 0.75, 0.75])
    assert r.chain.dead.sum() == 3
    r.chain.set_dead([0, 1, 2, 3], dead=False)
    np.testing.assert_array_equal(r.step(0.5), np.full((4, 4, 1), 0.5))


def test_saturation_and_radius_noise_are_switched_on():
    r = rig()
    r.chain.set_saturation_range(-1.0, 1.0, envs=[0])
    np.testing.assert_array_equal(r.step(3.0)[:2, :, 0], [[1.0] * 4, [3.0] * 4])
    r.chain.set_radius_noise(1e-3, envs=[2])
    r.step()
    moved = (r.radius.numpy() != 0.002).any(axis=1)
    assert moved.tolist() == [False, False, True, False]


@pytest.mark.parametrize(
    "call",
    [
        lambda c: c.set_bias(1.0),
        lambda c: c.set_gain(2.0),
        lambda c: c.set_dead(0),
        lambda c: c.set_radius_noise(1e-3),
        lambda c: c.dead,
    ],
)
def test_what_was_not_built_is_refused_with_the_way_out(call):
    with pytest.raises(SceneError, match="adjustable"):
        call(Rig(options(noise=0.1)).chain)


@pytest.mark.parametrize(
    "call",
    [
        lambda c: c.set_noise(-1.0),
        lambda c: c.set_noise(np.nan),
        lambda c: c.set_bias([1.0, 2.0]),
        lambda c: c.set_bias(1.0, envs=[4]),
        lambda c: c.set_bias(1.0, envs=[-1]),
        lambda c: c.set_gain([1.0, 2.0]),
        lambda c: c.set_gain(np.inf),
        lambda c: c.set_dead(4),
        lambda c: c.set_dead(0, value=np.inf),
        lambda c: c.set_saturation_range(1.0, 0.0),
    ],
)
def test_values_without_meaning_are_refused_and_change_nothing(call):
    r = rig()
    with pytest.raises(SceneError):
        call(r.chain)
    np.testing.assert_array_equal(r.step(0.5), np.full((4, 4, 1), 0.5))


def test_a_number_per_column_needs_room_for_one():
    with pytest.raises(SceneError, match="adjustable"):
        Rig(options(bias=1.0)).chain.set_bias(np.arange(16.0))
