"""White noise and walks by their statistics. Bounds are 4.5 standard errors: a sound law fails one run in 150 000, and
with fixed seeds it never does."""

import numpy as np
import pytest
import warp as wp

from tests.imperfections.rig import Rig, info, options

WIDE = info((1000,))
SIGMAS = 4.5


def errors(given, steps=200, about=WIDE, **rig) -> np.ndarray:
    """What the imperfections add to a load of 1: ``(steps, taxels)``."""
    return Rig(options(**given), about, **rig).run(steps, 1.0).reshape(steps, -1) - 1.0


def assert_spread(sample, sigma):
    """Mean 0 and standard deviation ``sigma`` of independent normal numbers."""
    n = sample.size
    assert n >= 100_000
    assert abs(sample.mean()) < SIGMAS * sigma / np.sqrt(n)
    assert sample.std() == pytest.approx(sigma, rel=SIGMAS / np.sqrt(2 * n))


@pytest.mark.parametrize("real", [wp.float32, wp.float64])
def test_white_noise_is_normal_and_white_in_time_and_space(real):
    from scipy.stats import kstest

    sample = errors({"noise": 0.02}, real=real)
    assert_spread(sample, 0.02)
    assert kstest(sample.ravel() / 0.02, "norm").pvalue > 1e-3
    bound = SIGMAS / np.sqrt(sample.size)
    for lag in (1, 2, 7):
        assert abs(np.mean(sample[lag:] * sample[:-lag])) / 0.02**2 < bound * np.sqrt(200 / (200 - lag))
        assert abs(np.mean(sample[:, lag:] * sample[:, :-lag])) / 0.02**2 < bound * 1.01


def test_spectrum_of_white_noise_is_flat_at_its_density():
    """The one-sided power density of ``noise_density`` d is d^2 in every octave, at any sample rate."""
    from scipy.signal import periodogram

    density = 3e-4
    for dt in (1e-3, 5e-3):
        sample = errors({"noise_density": density}, steps=256, dt=dt)
        power = periodogram(sample, fs=1 / dt, axis=0, detrend=False)[1]
        for low in (8, 16, 32, 64):
            band = power[low : 2 * low].ravel()
            assert band.mean() == pytest.approx(density**2, rel=SIGMAS / np.sqrt(band.size))


def test_noise_and_density_add_in_power():
    sample = errors({"noise": 0.03, "noise_density": 0.04 * np.sqrt(2e-3)})
    assert_spread(sample, 0.05)


def test_noise_per_column():
    """One number per taxel, for force and torque alike."""
    about = info((100,), ("force", "torque"))
    given = np.linspace(0.0, 1.0, 100)
    sample = Rig(options(noise=given), about).run(200).reshape(200, 100, 6)
    spread = sample.std(axis=(0, 2))
    assert spread[0] == 0.0
    np.testing.assert_allclose(spread[1:], given[1:], rtol=SIGMAS / np.sqrt(2 * 1200))


def test_columns_of_a_flat_list_stand_in_blocks():
    """All forces taxel by taxel, then all torques: the order of a flat list."""
    about = info((4,), ("force", "torque"))
    reading = Rig(options(bias=np.arange(24.0)), about).step(0.0)[0]
    np.testing.assert_array_equal(reading[:, :3].ravel(), np.arange(12))
    np.testing.assert_array_equal(reading[:, 3:].ravel(), np.arange(12, 24))


def test_walk_spreads_as_the_root_of_the_steps():
    walk = errors({"random_walk": 0.01}, steps=400)
    assert_spread(np.diff(walk, axis=0, prepend=0.0), 0.01)
    for n in (1, 10, 100, 400):
        assert walk[n - 1].std() == pytest.approx(0.01 * np.sqrt(n), rel=SIGMAS / np.sqrt(2 * 1000))


@pytest.mark.parametrize("dt, steps", [(1e-3, 400), (2e-3, 200), (1e-2, 40)])
def test_walk_per_root_second_does_not_depend_on_the_step(dt, steps):
    walk = errors({"random_walk_density": 0.5}, steps=steps, dt=dt, about=info((20_000,)))
    assert walk[-1].std() == pytest.approx(0.5 * np.sqrt(0.4), rel=SIGMAS / np.sqrt(2 * 20_000))


def test_allan_deviation_tells_noise_from_walk():
    """Slopes -1/2 and +1/2 of the Allan deviation, with their coefficients: N/sqrt(T) and K sqrt(T/3)."""
    dt, density, walk_density = 1e-2, 0.02, 0.1
    white = errors({"noise_density": density}, steps=1024, dt=dt)
    walk = errors({"random_walk_density": walk_density}, steps=1024, dt=dt)
    for m in (4, 16, 64):
        time = m * dt
        # White noise of one-sided density d has N = d / sqrt(2).
        assert allan(white, m) == pytest.approx(density / np.sqrt(2 * time), rel=0.02)
        assert allan(walk, m) == pytest.approx(walk_density * np.sqrt(time / 3), rel=0.02 if m > 4 else 0.05)


def allan(sample: np.ndarray, m: int) -> float:
    """Allan deviation over averages of ``m`` samples, of all columns together."""
    means = sample[: len(sample) // m * m].reshape(-1, m, sample.shape[1]).mean(axis=1)
    return float(np.sqrt(0.5 * np.mean(np.diff(means, axis=0) ** 2)))


def test_bounded_walk_has_its_spread_and_its_correlation_time():
    """Gauss-Markov: stationary deviation K sqrt(tau / 2), autocorrelation exp(-lag / tau)."""
    tau, density, dt = 0.05, 0.4, 5e-3
    walk = errors({"random_walk_density": density, "random_walk_tau": tau}, steps=400, dt=dt)[100:]
    expected = density * np.sqrt(tau / 2)
    independent = walk.size * dt / (2 * tau)
    assert walk.std() == pytest.approx(expected, rel=SIGMAS / np.sqrt(2 * independent))
    for lag in (1, 5, 10, 20):
        measured = np.mean(walk[lag:] * walk[:-lag]) / expected**2
        assert measured == pytest.approx(np.exp(-lag * dt / tau), abs=SIGMAS / np.sqrt(independent) * 1.5)


def test_bounded_walk_of_one_step_is_that_of_two_half_steps():
    about = info((50_000,))
    given = {"random_walk_density": 0.4, "random_walk_tau": 0.01}
    whole = errors(given, steps=3, dt=1e-2, about=about)[-1]
    halves = errors(given, steps=6, dt=5e-3, about=about)[-1]
    assert whole.std() / halves.std() == pytest.approx(1.0, rel=SIGMAS / np.sqrt(50_000))


def test_a_billion_steps_of_a_walk():
    """State is float64: a walk far out still takes steps of its own size, in float32 too."""
    rig = Rig(options(random_walk=1.0), WIDE, real=wp.float32)
    rig.run(1, 0.0)
    state = rig.chain.state["random_walk"]
    state.fill_(3.2e4)
    steps = [state.numpy().copy()]
    for _ in range(100):
        rig.step()
        steps.append(state.numpy().copy())
    assert_spread(np.diff(steps, axis=0), 1.0)


def test_a_step_without_time_adds_no_walk_and_no_infinite_noise():
    rig = Rig(options(random_walk_density=1.0, noise_density=1.0, random_walk_tau=0.0), WIDE)
    np.testing.assert_array_equal(rig.step(1.0, dt_ns=0), np.ones((1, 1000, 1)))


def test_steps_beyond_two_to_the_31_draw_new_numbers():
    rig = Rig(options(noise=1.0), WIDE, step=2**31 - 3)
    seen = rig.run(6, 0.0).reshape(6, -1)
    assert np.abs(np.corrcoef(seen) - np.eye(6)).max() < SIGMAS / np.sqrt(1000)
