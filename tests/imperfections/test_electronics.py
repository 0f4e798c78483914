"""Rounding, saturation, temperature, dead taxels, fillers, and numbers that are none."""

import numpy as np
import pytest
import warp as wp

from tactemu.base.errors import SceneError
from tests.imperfections.rig import Rig, info, options

BOTH = pytest.mark.parametrize("real", [wp.float32, wp.float64])


def once(loads, real=wp.float64, **given) -> np.ndarray:
    """Readings of one step, a taxel per load."""
    return Rig(options(**given), info((len(loads),)), real=real).step(np.asarray(loads, dtype=float)[:, None]).ravel()


@BOTH
def test_halves_go_to_even_on_both_sides(real):
    loads = np.array([-2.5, -1.5, -0.5, 0.5, 1.5, 2.5, 3.5])
    np.testing.assert_array_equal(once(loads * 0.25, real, resolution=0.25), np.rint(loads) * 0.25)


@BOTH
@pytest.mark.parametrize("resolution", [0.0, 1e-40, 1e-300])
def test_a_quantiser_finer_than_the_float_changes_nothing(real, resolution):
    loads = np.random.default_rng(0).normal(size=50)
    rig = Rig(options(resolution=resolution, adjustable=("resolution",)), info((50,)), real=real)
    np.testing.assert_array_equal(rig.step(loads[:, None]).ravel(), loads.astype(rig.reading.numpy().dtype))


@BOTH
def test_beyond_the_mantissa_readings_pass(real):
    exact = 2.0**24 if real is wp.float32 else 2.0**53
    loads = np.array([exact * 1.5, -exact * 2])
    np.testing.assert_array_equal(once(loads, real, resolution=1.0), loads)


@BOTH
def test_saturation_comes_before_rounding(real):
    seen = once([-5.0, -0.2, 0.2, 5.0], real, saturation_range=(-1.1, 2.9), resolution=1.0)
    np.testing.assert_array_equal(seen, [-1.0, 0.0, 0.0, 3.0])


def test_saturation_clips_noise_and_bias():
    seen = Rig(options(saturation_range=(0.0, 1.0), noise=2.0, bias=0.5), info((1000,))).run(10, 0.0)
    assert seen.min() == 0.0 and seen.max() == 1.0


EVERYTHING = {
    "crosstalk_strength": 0.3,
    "crosstalk_sigma": 0.001,
    "hysteresis_strength": 0.5,
    "creep_strength": 0.1,
    "hysteresis_backlash": 0.01,
    "scan_time": 5e-4,
    "temperature_course": [(0.0, 20.0), (1.0, 60.0)],
    "temperature_sensitivity": 0.01,
    "temperature_offset": 0.02,
    "random_walk": 0.01,
    "random_walk_density": 0.1,
    "noise": 0.1,
    "noise_density": 0.01,
    "bias": 0.3,
    "saturation_range": (-10.0, 10.0),
    "resolution": 0.01,
    "dead_taxel_probability": 0.3,
    "delay": 2e-3,
    "jitter": 1e-3,
    "delay_interpolation": "linear",
    "history_length": 2,
}


@BOTH
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_never_becomes_one(real, bad):
    """All laws at once: where a raw reading is not finite, the reading that comes of it is not, and of its neighbours
    those within the crosstalk; other environments are the same to the bit, and later readings recover."""
    about = info((8, 8))
    clean, spoilt = (Rig(options(**EVERYTHING), about, n_envs=2, real=real) for _ in range(2))
    for t in range(20):
        load = np.full((2, 64, 1), 0.5)
        a = clean.step(load)
        if t == 5:
            load[1, 27] = bad
        b = spoilt.step(load)
        np.testing.assert_array_equal(a[0], b[0])
        values = spoilt.measured.numpy()[1, :, 0].reshape(8, 8)
        if t == 5:
            assert not np.isfinite(values[3, 3])
            assert np.isfinite(values[0]).all() and np.isfinite(values[7]).all()
        elif t > 6:
            assert np.isfinite(values).all()
        if t > 10:
            assert np.isfinite(b).all()


def test_temperature_course_between_keyframes_and_outside():
    frames = [(0.01, 25.0), (0.02, 45.0), (0.02, 30.0), (0.04, 20.0)]
    given = {"temperature_course": frames, "temperature_sensitivity": 0.01, "temperature_offset": 0.1}
    rig = Rig(options(**given, temperature_reference=20.0), info((1,)))
    seen = rig.run(60, 2.0).ravel()
    t = np.arange(1, 61) * 1e-3
    celsius = np.where(t <= 0.02, np.interp(t, [0.01, 0.02], [25, 45]), np.interp(t, [0.02, 0.04], [30, 20]))
    np.testing.assert_allclose(seen, 2.0 * (1 + 0.01 * (celsius - 20)) + 0.1 * (celsius - 20), rtol=1e-9)


def test_temperature_after_three_years_at_a_kilohertz():
    """Time is int64 nanoseconds: a float32 second would have stood still after nine hours."""
    year = 365.25 * 86400
    given = {"temperature_course": [(0.0, 0.0), (6 * year, 6 * year)], "temperature_reference": 0.0}
    rig = Rig(options(**given, temperature_offset=1.0), info((1,)), step=round(3 * year * 1000))
    seen = rig.run(3, 0.0).ravel() - 3 * year
    np.testing.assert_allclose(seen, [1e-3, 2e-3, 3e-3], atol=1e-6)


def test_temperature_coefficients_per_taxel():
    given = {"temperature_course": [(0.0, 35.0)], "temperature_offset": [0.0, 0.1, 0.2]}
    np.testing.assert_allclose(once([0.0, 0.0, 0.0], **given), [0.0, 1.0, 2.0], atol=1e-12)


def test_dead_fraction_and_values_over_environments_and_resets():
    """Binomial with p over 1e5 draws, values uniform, another draw at each reset; dead means every channel."""
    from scipy.stats import kstest

    rig = Rig(
        options(dead_taxel_probability=0.07, dead_taxel_value_range=(2.0, 3.0), noise=0.1, bias=0.5),
        info((50,), ("force",)),
        n_envs=1000,
    )
    fraction, values, masks = [], [], []
    for _ in range(2):
        reading = rig.step(0.0)
        dead = rig.chain.dead
        np.testing.assert_array_equal((reading[dead] >= 2.0).all(), True)
        np.testing.assert_array_equal(reading[dead].max(axis=-1), reading[dead].min(axis=-1))
        np.testing.assert_array_equal(rig.step()[dead], reading[dead])
        assert (np.abs(reading[~dead]) < 1.9).all()
        fraction.append(dead)
        values.append(reading[dead][:, 0])
        masks.append(dead)
        rig.reset()
    sample = np.array(fraction)
    assert sample.size >= 100_000
    assert sample.mean() == pytest.approx(0.07, abs=4.5 * np.sqrt(0.07 * 0.93 / sample.size))
    assert kstest(np.concatenate(values), "uniform", args=(2.0, 1.0)).pvalue > 1e-3
    both = (masks[0] & masks[1]).mean()
    assert both == pytest.approx(0.07**2, abs=4.5 * np.sqrt(0.07**2 / masks[0].size))


@pytest.mark.parametrize("probability", [0.0, 1.0])
def test_certain_death_and_certain_life(probability):
    rig = Rig(options(dead_taxel_probability=probability, adjustable=("dead",)), info((1000,)))
    assert rig.chain.dead.all() == bool(probability) and rig.chain.dead.any() == bool(probability)


def test_stuck_at_the_first_reading_after_a_reset():
    rig = Rig(options(dead_taxel_probability=1.0, dead_taxel_mode="last"), info((3,)))
    for first in (1.0, 2.0):
        for later in (first, 7.0, 8.0):
            np.testing.assert_array_equal(rig.step(later).ravel(), np.full(3, first))
        rig.reset()


@BOTH
def test_fillers_read_zero_whatever_is_switched_on(real):
    radius = np.full(16, 0.002)
    radius[[0, 5]] = 0.0
    given = {k: v for k, v in EVERYTHING.items() if k not in ("crosstalk_strength", "crosstalk_sigma")}
    rig = Rig(options(**given | {"dead_taxel_value_range": (1.0, 2.0)}), info(radius=radius), real=real)
    seen = rig.run(20, np.where(radius > 0, 1.0, 0.0)[:, None])[..., 0]
    assert (seen[..., [0, 5]] == 0.0).all()
    assert (seen[5:][..., 1] != 0.0).all()


@pytest.mark.parametrize(
    "given, words",
    [
        ({"noise": -1.0}, "noise"),
        ({"noise": np.nan}, "noise"),
        ({"bias": [1.0, 2.0]}, "bias has shape (2,)"),
        ({"bias": np.inf}, "finite"),
        ({"saturation_range": (1.0, 0.0)}, "low <= high"),
        ({"temperature_offset": 1.0}, "temperature_course"),
        ({"temperature_course": [(1.0, 2.0), (0.0, 1.0)]}, "rise"),
        ({"dead_taxel_probability": 1.5}, "at most 1"),
        ({"delay_interpolation": "cubic"}, "delay_interpolation"),
        ({"crosstalk_kernel": np.ones((2, 2))}, "odd"),
        ({"crosstalk_strength": 0.5}, "crosstalk_sigma"),
        ({"adjustable": ("hysteresis",)}, "hysteresis"),
        ({"history_length": 1.5}, "whole"),
        ({"scan_time": 1e-3, "scan_order": "spiral"}, "spiral"),
        ({"gain": [1.0, 2.0]}, "gain"),
        ({"delay": 1e5}, "readings"),
        ({"delay": 1e9}, "at most 1e+06 s"),
        ({"noise": "loud"}, "noise must be a number, got the text"),
        ({"creep_tau": (1.0, 2.0)}, "creep_tau must be a finite number"),
        ({"adjustable": 3}, "adjustable must be a list"),
    ],
)
def test_options_without_meaning_are_refused_by_name(given, words):
    with pytest.raises(SceneError, match=r"(skin.*|ChainOptions): ") as error:
        Rig(options(**given))
    assert words in str(error.value)


@BOTH
@pytest.mark.parametrize("layout", [(0,), (0, 4), (1,), (1, 1)])
def test_no_taxel_and_one_taxel(layout, real):
    given = {"noise": 0.1, "delay": 1e-3, "dead_taxel_probability": 0.5, "scan_time": 1e-3}
    if len(layout) == 2:
        given |= EVERYTHING | {"gain_range": (0.5, 2.0), "radius_noise": 1e-4}
    rig = Rig(options(**given), info(layout), real=real)
    for _ in range(4):
        reading = rig.step(1.0)
    assert reading.shape[-2] == np.prod(layout) and np.isfinite(reading).all()
    rig.reset()


def test_a_gain_outside_the_formula_acts_after_hysteresis():
    given = {"hysteresis_strength": 0.5, "bias": 0.25}
    about = info((3,), ("displacement",), gain_inside=False)
    plain = Rig(options(**given), about).run(4, 1.0) - 0.25
    gained = Rig(options(**given, gain=[1.0, 2.0, 3.0]), about).run(4, 1.0) - 0.25
    np.testing.assert_allclose(gained, plain * np.array([1.0, 2.0, 3.0])[:, None], rtol=1e-12)
    with_backlash = Rig(options(gain=2.0, hysteresis_backlash=0.1), about).step(1.0)
    np.testing.assert_allclose(with_backlash, 1.8)


def test_a_million_taxels():
    rig = Rig(options(noise=1.0, resolution=0.5), info((1_000_000,)), real=wp.float32)
    seen = rig.step(0.0)
    assert seen.size == 1_000_000
    assert seen.std() == pytest.approx(np.sqrt(1 + 0.5**2 / 12), rel=0.01)
