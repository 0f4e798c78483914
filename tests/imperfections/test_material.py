"""Hysteresis, creep and the loop against their closed forms."""

import numpy as np
import pytest
import warp as wp

from tests.imperfections.rig import Rig, info, options

ONE = info((1,))


def course(given, loads, dt=1e-3, real=wp.float64, about=ONE) -> np.ndarray:
    """Readings of one taxel for a load per step."""
    rig = Rig(options(**given), about, dt=dt, real=real)
    return np.array([rig.step(load).item() for load in loads])


def test_overshoot_of_a_step_decays_exactly():
    t = np.arange(200) * 1e-3
    seen = course({"hysteresis_strength": 0.5, "hysteresis_tau": 0.05}, np.full(200, 2.0))
    np.testing.assert_allclose(seen, 2.0 * (1 + 0.5 * np.exp(-t / 0.05)), rtol=1e-12)


@pytest.mark.parametrize("real", [wp.float32, wp.float64])
def test_an_hour_at_a_millisecond_does_not_stall(real):
    """tau = 1 h at 1 ms: after 20 000 steps the state is right to 1e-9; float32 would lose 1e-7 of it at each step."""
    rig = Rig(
        options(hysteresis_strength=1.0, hysteresis_tau=3600.0, creep_strength=1.0, creep_tau=3600.0), ONE, real=real
    )
    for _ in range(20_000):
        rig.step(1.0)
    over, crept = (rig.chain.state[name].numpy().item() for name in ("overshoot", "crept"))
    assert over == pytest.approx(np.exp(-19.999 / 3600), rel=1e-9)
    # The load of the creep is the reading of the hysteresis: 1 + exp(-t / tau), rising within the first step.
    h = 20.0 / 3600
    assert crept == pytest.approx(1 - np.exp(-h) + h * np.exp(-h), rel=1e-3)


@pytest.mark.parametrize("ratio", [1e-9, 1e-3, 1.0, 1e3, 1e9])
def test_time_constants_from_nothing_to_a_billion_steps(ratio):
    dt = 1e-3
    seen = course({"hysteresis_strength": 1.0, "hysteresis_tau": dt * ratio}, np.ones(3), dt)
    np.testing.assert_allclose(seen, 1 + np.exp(-np.arange(3) / ratio), rtol=1e-9)
    crept = course({"creep_strength": 1.0, "creep_tau": dt * ratio}, np.ones(3), dt) - 1.0
    h = 1 / ratio
    rise = 1 + np.expm1(-h) / h if h > 1e-4 else h / 2 - h * h / 6
    expected = 1 - (1 - rise) * np.exp(-np.arange(3) * h) if h > 1e-4 else rise + np.arange(3) * h
    np.testing.assert_allclose(crept, expected, rtol=1e-6)


def test_no_time_constant_and_no_time():
    np.testing.assert_allclose(course({"hysteresis_strength": 1.0, "hysteresis_tau": 0.0}, [1, 1, 1]), [2, 1, 1])
    np.testing.assert_allclose(course({"creep_strength": 1.0, "creep_tau": 0.0}, [1, 1, 1]), [2, 2, 2])
    rig = Rig(options(hysteresis_strength=1.0, hysteresis_tau=0.01, creep_strength=1.0, creep_tau=0.01), ONE)
    rig.step(1.0)
    before = {k: a.numpy().copy() for k, a in rig.chain.state.items()}
    rig.step(1.0, dt_ns=0)
    for name, value in before.items():
        np.testing.assert_array_equal(rig.chain.state[name].numpy(), value)


GIVEN = {
    "hysteresis": {"hysteresis_strength": 0.7, "hysteresis_tau": 0.013},
    "two sided": {
        "hysteresis_strength": 0.7,
        "hysteresis_tau": 0.013,
        "hysteresis_strength_unloading": 0.2,
        "hysteresis_tau_unloading": 0.05,
    },
    "creep": {"creep_strength": 0.3, "creep_tau": 0.02},
    "backlash": {"hysteresis_backlash": 0.05},
}


@pytest.mark.parametrize("law", GIVEN)
def test_one_step_is_two_half_steps(law):
    """With the load that each law assumes between steps: held after a jump (hysteresis), else a straight line."""
    rng = np.random.default_rng(3)
    loads = np.concatenate([rng.normal(size=40), np.zeros(10)])
    if "hysteresis_strength" in GIVEN[law]:
        fine = np.repeat(loads, 2)
        fine[:-1:2] = np.concatenate([[0.0], loads[:-1]])  # the jump comes with the second half
    else:
        fine = np.empty(2 * len(loads))
        fine[1::2] = loads
        fine[::2] = (loads + np.concatenate([[0.0], loads[:-1]])) / 2
    whole, halves = course(GIVEN[law], loads, dt=2e-3), course(GIVEN[law], fine, dt=1e-3)[1::2]
    np.testing.assert_allclose(halves, whole, atol=1e-6 * np.abs(whole).max())


def test_creep_of_a_ramp_is_the_closed_form():
    """z of a ramp v t is v (t - tau (1 - exp(-t / tau))), to rounding, at any step length."""
    tau, v = 0.03, 2.0
    for dt in (1e-4, 1e-3, 1e-2):
        t = np.arange(1, 21) * dt
        seen = course({"creep_strength": 1.0, "creep_tau": tau}, v * t, dt)
        np.testing.assert_allclose(seen - v * t, v * (t + tau * np.expm1(-t / tau)), rtol=1e-6)


def test_unloading_without_strength_leaves_nothing_negative():
    loads = np.concatenate([np.full(20, 1.0), np.zeros(20)])
    symmetric = course({"hysteresis_strength": 0.5, "hysteresis_tau": 0.02}, loads)
    given = {"hysteresis_strength": 0.5, "hysteresis_tau": 0.02, "hysteresis_strength_unloading": 0.0}
    one_sided = course(given, loads)
    assert symmetric[20:].min() < -0.2
    assert one_sided[20:].min() >= 0.0
    np.testing.assert_allclose(one_sided[:20], symmetric[:20], rtol=1e-12)


def test_equal_sides_are_the_symmetric_law():
    loads = np.random.default_rng(1).normal(size=100)
    plain = {"hysteresis_strength": 0.5, "hysteresis_tau": 0.02}
    both = plain | {"hysteresis_strength_unloading": 0.5, "hysteresis_tau_unloading": 0.02}
    np.testing.assert_allclose(course(both, loads), course(plain, loads), atol=1e-13)


def test_loop_reads_low_while_loading_and_high_while_unloading_at_any_rate():
    up = np.linspace(0.0, 1.0, 51)
    for repeat in (1, 5):
        loads = np.repeat(np.concatenate([up, up[::-1]]), repeat)
        seen = course({"hysteresis_backlash": 0.1}, loads)[::repeat]
        np.testing.assert_allclose(seen[:51], np.maximum(up - 0.1, 0.0), atol=1e-12)
        np.testing.assert_allclose(seen[51:], np.minimum(np.maximum(up[::-1] + 0.1, 0.1), 0.9), atol=1e-12)


def test_a_reading_that_is_no_number_leaves_the_memory_alone():
    for given in GIVEN.values():
        rig = Rig(options(**given), ONE)
        rig.step(1.0)
        before = {k: a.numpy().copy() for k, a in rig.chain.state.items()}
        for bad in (np.nan, np.inf, -np.inf):
            np.testing.assert_equal(rig.step(bad).item(), bad)
        for name, value in before.items():
            np.testing.assert_array_equal(rig.chain.state[name].numpy(), value)
        assert np.isfinite(rig.step(1.0)).all()
