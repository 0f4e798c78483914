"""The equations of transducers, against closed forms and other people's code."""

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from tactemu.transducers import laws
from tests.transducers.dipoles import dipole_field


def test_a_dipole_has_twice_the_field_on_its_axis_and_the_opposite_at_its_equator():
    moment, r = 0.02, 0.01
    field = dipole_field(np.array([[0, 0, r], [r, 0, 0]]), np.zeros((1, 3)), np.array([[0, 0, moment]]))
    assert field == pytest.approx(1e-7 * moment / r**3 * np.array([[0, 0, 2], [0, 0, -1]]))


def test_fields_of_dipoles_have_neither_source_nor_whirl_and_add_up():
    rng = np.random.default_rng(3)
    magnets, moments = rng.normal(size=(20, 3)) * 0.004, rng.normal(size=(20, 3)) * 0.01
    at, h = np.array([0.02, -0.015, 0.03]), 1e-5
    steps = np.concatenate([at + h * np.eye(3), at - h * np.eye(3)])
    field = dipole_field(steps, magnets, moments)
    gradient = (field[:3] - field[3:]) / (2 * h)  # of x, y, z by rows
    scale = np.abs(gradient).max()
    assert abs(np.trace(gradient)) < 1e-6 * scale
    assert np.abs(gradient - gradient.T).max() < 1e-6 * scale
    alone = sum(dipole_field(at[None], magnets[k : k + 1], moments[k : k + 1]) for k in range(20))
    assert dipole_field(at[None], magnets, moments) == pytest.approx(alone)


@pytest.mark.parametrize(("terms", "within"), [(1, 0.025), (2, 5e-4)])
def test_a_sum_of_exponentials_follows_the_logarithm_within_the_error_that_it_states(terms, within):
    memory = laws.LogMemory.over(0.05, 2000.0, terms)
    t = np.geomspace(0.05, 2000.0, 500)
    apart = np.abs(memory.grown(t) - memory.at_first - np.log10(t / 0.05))
    assert apart.max() == pytest.approx(memory.error, rel=0.05)
    assert memory.error < within
    assert memory.grown(np.array([0.0, 1e12])) == pytest.approx([0.0, memory.weights.sum()])


def test_a_divider_gives_half_where_its_resistances_are_equal():
    load = np.array([0.0, 1.0, 30.0, 1e9])
    law = laws.divider(load, 4095.0, 30.0, 1.5)
    assert law == pytest.approx([0.0, 4095 / (1 + 30**1.5), 2047.5, 4095.0], rel=1e-5)


def test_a_loading_curve_is_monotone_and_that_of_scipy_between_its_ends():
    x, y = np.array([0.0, 0.5, 1.0, 2.0, 3.5, 6.0]), np.array([0.0, 0.0, 0.6, 2.2, 5.8, 6.0])
    at = np.linspace(-1.0, 8.0, 901)
    ours = laws.curve(at, x, y)
    assert (np.diff(ours) >= -1e-12).all()
    inside = (at >= 1.0) & (at <= 3.5)  # scipy weighs chords by their lengths; the same where these are equal enough
    assert ours[inside] == pytest.approx(PchipInterpolator(x, y)(at[inside]), abs=0.03)
    assert laws.curve(x, x, y) == pytest.approx(y)


def test_sliding_noise_is_what_sampling_a_noisy_sine_has():
    rng = np.random.default_rng(1)
    t = np.arange(200_000) * 0.028
    signal = 50.0 * np.sin(2 * np.pi * 1.01 * t) + rng.normal(0, 2.0, len(t))
    measured = np.diff(signal).std() / np.sqrt(2)
    assert measured == pytest.approx(laws.sliding_noise(2.0, 50.0, 1.01, 0.028), rel=0.01)
