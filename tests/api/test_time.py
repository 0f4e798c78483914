"""The time of a simulation: steps are counted, seconds are named."""

from typing import Any

import numpy as np
import pytest

import tactemu as tt


def built(n_envs=None, **options) -> Any:
    """A simulation of one ball."""
    scene = tt.Scene(dt=2e-3)
    scene.add_body(tt.Sphere(radius=0.01), name="ball")
    return scene.build(n_envs, **options)


def test_a_step_takes_a_number_of_steps():
    sim = built()
    sim.step(10)
    assert sim.step_count == 10 and sim.time_ns == 20_000_000 and sim.time == pytest.approx(0.02)
    sim.step(np.int64(2))
    sim.step(0)
    assert sim.step_count == 12
    sim.step(3, dt=1e-3)
    assert sim.step_count == 15 and sim.time_ns == 27_000_000


@pytest.mark.parametrize("wrong", [0.001, 1.0, -1, True, None, "2"])
def test_a_length_in_place_of_a_number_is_refused_in_words(wrong):
    sim = built()
    with pytest.raises(ValueError, match="dt="):
        sim.step(wrong)
    assert sim.step_count == 0


def test_a_time_that_has_passed_takes_no_step():
    """A late loop stretches a step, and may then ask for an earlier time than the simulation has."""
    sim = built()
    sim.advance_to(20_000_000)
    assert sim.step_count == 10
    assert not sim.advance_to(10_000_000) and not sim.advance_to(10_000_000, max_steps=3)
    assert sim.step_count == 10 and sim.time_ns == 20_000_000


def test_each_environment_counts_its_own_time():
    sim = built(3)
    assert np.array_equal(sim.env_time, np.zeros(3))
    sim.step(5)
    sim.reset([1])
    sim.step(2)
    assert np.allclose(sim.env_time, [0.014, 0.004, 0.014], rtol=0, atol=1e-15) and sim.time == pytest.approx(0.014)
    sim.reset(np.array([True, False, False]))
    assert np.allclose(sim.env_time, [0.0, 0.004, 0.014], rtol=0, atol=1e-15)
    sim.reset()
    assert sim.time == 0 and np.array_equal(sim.env_time, np.zeros(3))
    sim.step()
    assert np.array_equal(sim.env_time, np.full(3, 2e-3))


def test_a_batch_on_several_devices_counts_alike():
    scene = tt.Scene(dt=1e-3)
    scene.add_body(tt.Sphere(radius=0.01), name="ball")
    with scene.build_split(5, ["cpu", "cpu"]) as sims:
        sims.step(4)
        sims.reset([0, 4])
        sims.step(1, dt=2e-3)
        assert sims.time == pytest.approx(6e-3)
        assert np.allclose(sims.env_time, [2e-3, 6e-3, 6e-3, 6e-3, 2e-3], rtol=0, atol=1e-15)
