"""Same seed, same bytes; what is off costs nothing; nothing that is switched on changes another's draws."""

import numpy as np
import pytest
import warp as wp

from tests.imperfections.rig import Rig, info, options
from tests.imperfections.test_electronics import EVERYTHING

ABOUT = info((4, 4))
RANDOM = {
    "noise": {"noise": 0.1},
    "walk": {"random_walk": 0.1},
    "dead": {"dead_taxel_probability": 0.3, "dead_taxel_value_range": (1.0, 2.0)},
    "gain": {"gain_range": (0.5, 2.0)},
    "jitter": {"delay": 2e-3, "jitter": 1e-3, "delay_interpolation": "linear"},
    "radius": {"radius_noise": 1e-4},
}


def outcome(rig: Rig, steps=8) -> dict[str, np.ndarray]:
    """Everything random that a rig makes of a load that grows with time."""
    seen = []
    for k in range(steps):
        reading = rig.step(0.1 * k)
        parts = [reading] + [a.numpy().copy() for a in (rig.gain, rig.radius, rig.chain.stuck) if a is not None]
        seen.append(np.concatenate([p.reshape(rig.context.n_envs, -1) for p in parts], axis=1))
    return np.array(seen)


def test_nothing_switched_on_is_nothing_built():
    rig = Rig(options(), ABOUT)
    assert rig.stages == [] and rig.gain is None and rig.radius is None
    assert rig.measured is rig.raw and rig.reading is rig.raw


@pytest.mark.parametrize(
    "given, stages",
    [
        ({"noise": 0.1}, ["electronics"]),
        ({"noise": 0.1, "bias": 1.0, "resolution": 0.1, "dead_taxel_probability": 0.1}, ["electronics"]),
        ({"noise_density": 0.1}, ["coefficients", "electronics"]),
        ({"bias": 0.1}, ["electronics"]),
        ({"hysteresis_strength": 1.0, "creep_strength": 1.0}, ["coefficients", "material"]),
        ({"hysteresis_backlash": 1.0}, ["material"]),
        ({"delay": 1e-3}, ["delay"]),
        ({"jitter": 1e-3}, ["delay"]),
        ({"history_length": 3}, ["history"]),
        ({"gain": 2.0}, []),
        ({"gain_range": (1.0, 2.0)}, ["gain"]),
        ({"radius_noise": 1e-3}, ["radius_noise"]),
        ({"scan_time": 1e-3}, ["scan"]),
        ({"crosstalk_kernel": [[1.0]]}, ["crosstalk"]),
        ({"hysteresis_tau": 5.0, "creep_tau": 5.0, "random_walk_tau": 5.0, "temperature_course": [(0, 60)]}, []),
    ],
)
def test_only_what_is_switched_on_is_built_and_elementwise_laws_share_a_kernel(given, stages):
    assert [stage.name for stage in Rig(options(**given), ABOUT).stages] == [f"skin: {name}" for name in stages]


@pytest.mark.parametrize("real", [wp.float32, wp.float64])
def test_same_seed_same_bytes(real):
    given = EVERYTHING | {"radius_noise": 1e-4, "gain_range": (0.5, 2.0)}
    first, second, other = (outcome(Rig(options(**given), ABOUT, n_envs=3, real=real, seed=s)) for s in (7, 7, 8))
    assert first.tobytes() == second.tobytes()
    assert first.tobytes() != other.tobytes()


@pytest.mark.parametrize("law", RANDOM)
def test_an_environment_reads_the_same_alone_and_among_4096(law):
    alone = outcome(Rig(options(**RANDOM[law]), ABOUT))
    many = outcome(Rig(options(**RANDOM[law]), ABOUT, n_envs=4096))
    assert alone[:, 0].tobytes() == many[:, 0].tobytes()
    assert many[:, 1].tobytes() != many[:, 0].tobytes()


@pytest.mark.parametrize("other", ["walk", "dead", "jitter", "radius", "gain"])
def test_switching_one_on_changes_no_others_draws(other):
    """What noise adds is the same to the bit of float64 rounding with any other law on beside it."""
    alone = Rig(options(noise=0.1, adjustable=("noise",)), ABOUT)
    both = Rig(options(**RANDOM[other], noise=0.1), ABOUT)
    quiet = Rig(options(**RANDOM[other]), ABOUT)
    for k in range(6):
        a = alone.step(0.1 * k) - 0.1 * k
        both.step(0.1 * k)
        quiet.step(0.1 * k)
        b = both.measured.numpy() - quiet.measured.numpy()
        if other == "dead":
            np.testing.assert_array_equal(both.chain.dead, quiet.chain.dead)
            b = np.where(both.chain.dead[..., None], a, b)
        np.testing.assert_allclose(b, a, atol=1e-14)
    if both.gain is not None:
        np.testing.assert_array_equal(both.gain.numpy(), quiet.gain.numpy())
    if both.radius is not None:
        np.testing.assert_array_equal(both.radius.numpy(), quiet.radius.numpy())


def test_sensors_have_streams_of_their_own():
    seen = [Rig(options(noise=1.0), info((1000,), name=n)).run(20, 0.0).ravel() for n in ("left", "right")]
    assert abs(np.corrcoef(seen)[0, 1]) < 4.5 / np.sqrt(20_000)


def test_a_reset_of_one_environment_leaves_the_others_to_the_bit():
    given = EVERYTHING | {"gain_range": (0.5, 2.0)}
    calm, struck = (Rig(options(**given), ABOUT, n_envs=3) for _ in range(2))
    for k in range(20):
        if k == 9:
            struck.reset([1])
        a, b = calm.step(0.5), struck.step(0.5)
        assert a[[0, 2]].tobytes() == b[[0, 2]].tobytes()
    assert (calm.gain.numpy() != struck.gain.numpy()).all(axis=1).tolist() == [False, True, False]


@pytest.mark.parametrize("law", RANDOM)
def test_a_new_episode_draws_anew_though_its_steps_are_counted_from_the_start(law):
    """Deterministic all the same: the second episode of a second run is that of the first."""
    seen = []
    for _ in range(2):
        rig, episodes = Rig(options(**RANDOM[law]), ABOUT), []
        for _ in range(2):
            episodes.append(outcome(rig))
            rig.reset()
            rig.restart()
        seen.append(episodes)
    assert seen[0][0].tobytes() == seen[1][0].tobytes() and seen[0][1].tobytes() == seen[1][1].tobytes()
    assert seen[0][0].tobytes() != seen[0][1].tobytes()


def test_gains_after_many_resets_are_uniform():
    from scipy.stats import kstest

    rig = Rig(options(gain_range=(0.5, 2.0)), info((1000,)), n_envs=10)
    sample = []
    for _ in range(10):
        sample.append(rig.gain.numpy().copy())
        rig.reset()
    sample = np.array(sample)
    assert sample.size >= 100_000
    assert kstest(sample.ravel(), "uniform", args=(0.5, 1.5)).pvalue > 1e-3
    assert np.abs(np.corrcoef(sample.reshape(10, -1)) - np.eye(10)).max() < 4.5 / np.sqrt(10_000)
