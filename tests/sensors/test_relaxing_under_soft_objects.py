"""A relaxing skin under soft objects: Lee-Radok and Ting with both compliances, limits in time, states, threads."""

import numpy as np
import pytest

import tactemu as tt
from tests.sensors.test_elastic_layer import TOP
from tests.sensors.test_relaxation import ALLOWED, lee_radok, pushes, skin_on, worst

YOUNG, NU, RADIUS, RATE, TURN = 1e5, 0.3, 0.02, 2e-3, 0.2
"""The skin [Pa], and a ball [m] that is pressed in with a speed [m/s] until a time [s]."""
REACH = np.sqrt(RADIUS * RATE * TURN)
HALF_SPACE = {
    "thickness": np.inf, "poisson_ratio": NU, "look_depth": 4e-3, "cells": 48, "pitch": 2.5 * REACH / 48,
}  # fmt: skip
MATERIALS = {  # share and time constant [s] of the skin, modulus [Pa] and Poisson's ratio of the object
    "alike": (0.6, 0.1, 1e5, 0.45),
    "softer object": (0.9, 0.05, 3e4, 0.5),
    "harder object": (0.6, 0.1, 1e6, 0.3),
}


def skin_and_object(share, tau, young, nu):
    """Return the relaxation of skin and object in series, one term, and their modulus at first, ``E*``.

    The creep of the skin, ``J = (1 - share exp(-(1 - share) t / tau)) / ((1 - share) E*)``, plus ``1 / E*`` of the
    object is again that of a standard solid.
    """
    skin, other = YOUNG / (1 - NU**2), young / (1 - nu**2)
    first, last = 1 / skin + 1 / other, 1 / (skin * (1 - share)) + 1 / other
    return ((1 - first / last, tau / (1 - share) * first / last),), 1 / first


def soft(share, tau, young, nu):
    return {"relaxation": ((share, tau),), "object_young_modulus": young, "object_poisson_ratio": nu}


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("dt", [4e-3, 2e-2])
@pytest.mark.parametrize("material", MATERIALS.values(), ids=MATERIALS)
def test_a_ball_that_comes_and_goes_and_one_that_stays(material, dt, dtype):
    """Lee and Radok (1960) for ramp and hold, Ting (1966) for the way back."""
    terms, first = skin_and_object(*material)
    times = np.arange(round(2 * TURN / dt) + 1) * dt
    options = {**HALF_SPACE, **soft(*material), "build": {"dtype": dtype}}
    ball = tt.Sphere(radius=RADIUS)
    forces = pushes(ball, RADIUS, lambda t: RATE * (TURN - abs(t - TURN)), times, **options)
    assert worst(forces, lee_radok(terms, times[1:], RATE, RADIUS, first, turn=TURN)) < ALLOWED
    assert forces[-1] == 0
    forces = pushes(ball, RADIUS, lambda t: RATE * min(t, TURN), times, **options)
    assert worst(forces, hold(terms, times[1:], first)) < ALLOWED


def hold(terms, times, first):
    """Force [N] of a ball that is pressed in and stays."""
    ((share, tau),) = terms
    forces = []
    for t in times:
        edges = np.linspace(0.0, min(t, TURN), 4001)
        grown = 4 / 3 * first * np.sqrt(RADIUS) * (RATE * edges) ** 1.5
        left = 1 - share * -np.expm1(-(t - (edges[1:] + edges[:-1]) / 2) / tau)
        forces.append((left * np.diff(grown)).sum())
    return np.array(forces)


def test_steps_of_any_length_in_one_run():
    """The compliance of a step is that of its own length; a step of no time changes nothing."""
    material, t, forces, times = MATERIALS["softer object"], 0.0, [], []
    sim, ball, skin = skin_on(tt.Sphere(radius=RADIUS), 1e-2, **HALF_SPACE, **soft(*material))
    for dt in (4e-3, 1e-2, 0.0, 4e-3, 2e-2, 0.0, 1e-2, 5e-2, 1e-3, 1e-2, 4e-2, 2e-2, 3e-2):
        t += dt
        sim.set_pose(ball, position=(0, 0, TOP + RADIUS - RATE * t))
        sim.step(dt=dt)
        forces.append(-skin.read().force[..., 2].sum())
        times.append(t)
    terms, first = skin_and_object(*material)
    assert worst(np.array(forces), lee_radok(terms, times, RATE, RADIUS, first, turn=TURN)) < 2 * ALLOWED


DRAG = {"thickness": 4e-3, "friction": 0.5, "displacement": True, "cells": 16, "tolerance": 1e-6, "iterations": 300}
STEPS = 20


def dragged(steps=(STEPS,), *, dtype="float64", run=None, **options):
    """Force and displacement, ``(steps, 6)`` each taxel, of a ball that is pressed in and dragged."""
    sim, ball, skin = run or skin_on(tt.Sphere(radius=5e-3), 1e-2, build={"dtype": dtype}, **DRAG, **options)
    readings = []
    for k in range(*steps):
        sim.set_pose(ball, position=(3e-5 * max(k - 5, 0), 0, TOP + 5e-3 - 3e-4 * min(k + 1, 5) / 5))
        sim.step()
        reading = skin.read()
        readings.append(np.concatenate([reading.force, 1e3 * reading.displacement], -1).copy())
    return np.array(readings)


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize(("tau", "left"), [(1e7, 1.0), (1e-8, 0.4)], ids=["slow", "fast"])
def test_far_from_its_time_constant_it_is_elastic(tau, left, coupled):
    """Pressures, tractions and the skin's own displacement: with the modulus at first, and with that at rest."""
    objects = {"object_young_modulus": 6e4, "object_poisson_ratio": 0.3, "poisson_ratio": 0.4, "coupled": coupled}
    relaxing = dragged(relaxation=((0.6, tau),), **objects)
    elastic = dragged(young_modulus=left * YOUNG, **objects)
    for part in (slice(0, 3), slice(3, 6)):
        assert np.abs(elastic[..., part]).max() > 1e-3
        assert np.abs(relaxing - elastic)[..., part].max() < 1e-3 * np.abs(elastic[..., part]).max()


def test_a_hard_object_of_finite_modulus_is_nearly_rigid():
    hard, rigid = (dragged(relaxation=((0.6, 0.05),), **each) for each in ({"object_young_modulus": 1e12}, {}))
    assert np.abs(hard - rigid).max() < 1e-4 * np.abs(rigid).max()


def test_both_float_widths_read_the_same():
    options = soft(*MATERIALS["softer object"])
    single, double = (dragged(dtype=dtype, **options) for dtype in ("float32", "float64"))
    assert np.abs(single - double).max() < 2e-3 * np.abs(double).max()


def test_saved_states_resets_and_threads_read_the_same():
    options = {**DRAG, **soft(*MATERIALS["alike"]), "build": {"n_envs": 4}}
    ball = tt.Sphere(radius=5e-3)
    one, other = skin_on(ball, 1e-2, **options), skin_on(ball, 1e-2, **options)
    first = dragged((10,), run=one)
    state = one[0].state()
    rest = dragged((10, STEPS), run=one)
    assert np.array_equal(rest[:, 0], rest[:, 3]) and np.abs(rest[..., 0]).max() > 1e-3
    one[0].step(dt=0.3)  # of another length: what a step of it makes is no part of a state
    one[0].prepare_restore(state)()
    assert np.array_equal(dragged((10, STEPS), run=one), rest)
    other[0].step(dt=0.3)
    other[0].prepare_restore(state)()
    assert np.array_equal(dragged((10, STEPS), run=other), rest)
    one[0].reset()
    assert np.array_equal(dragged((10,), run=one), first)
    parted = skin_on(ball, 1e-2, **options | {"build": {"n_envs": 4, "threads": 2}})
    assert np.array_equal(dragged((STEPS,), run=parted)[10:], rest)


def test_the_stage_is_built_only_where_both_are_asked_for():
    def stages(**options):
        sim, _, _ = skin_on(tt.Sphere(radius=5e-3), 1e-2, **options)
        return [stage.name.split(": ")[-1] for stage in sim.plan.stages]

    relaxation = {"relaxation": ((0.5, 0.1),)}
    assert "compliance" not in stages(**relaxation) and "compliance" not in stages(object_young_modulus=1e5)
    assert (
        stages(object_young_modulus=1e5, **relaxation).index("compliance") == stages(**relaxation).index("memory") + 1
    )
