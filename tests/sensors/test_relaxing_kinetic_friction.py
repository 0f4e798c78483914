"""Kinetic friction of a skin that relaxes: limits in time, the bound of the tractions, the fall of the force, rest."""

import numpy as np
import pytest

import tactemu as tt
from tests.sensors.test_elastic_layer import TOP
from tests.sensors.test_relaxation import PLATE, STANDARD, TERMS, modulus, skin_on, stiffness

STATIC, KINETIC, SPEED, DT = 0.5, 0.3, 5e-4, 1e-2
BALL = tt.Sphere(radius=5e-3)
SHAPES = {"plate": (PLATE, 2e-4), "ball": (BALL, 3e-4)}
"""Each shape, and how deep it is [m]; both are 10 mm high."""
STOP, START, END = 110, 160, 240
"""Steps at which a drag stops, begins again, and ends."""


def way(step):
    """Return how far the object has been dragged [m]: it moves, rests, and moves on."""
    return SPEED * DT * (np.clip(step - 10, 0, STOP - 10) + max(step - START, 0))


def drawn(shape="ball", steps=(END,), *, run=None, build=None, **options):
    """Return the readings of a drag, ``(steps, n_envs, ...)`` each: forces, pressures, tractions and slips."""
    body, depth = SHAPES[shape]
    given = {
        "friction": STATIC, "kinetic_friction": KINETIC, "slip_distance": 1e-4, "cells": 16, "displacement": True,
        "iterations": 300, **options,
    }  # fmt: skip
    sim, body, skin = run or skin_on(body, DT, build=build or {}, **given)
    readings = []
    for k in range(*steps):
        sim.set_pose(body, position=(way(k), 0, TOP + 5e-3 - depth))
        sim.step()
        reading = skin.read()
        assert all(np.isfinite(field).all() for field in reading)
        readings.append([reading.force.copy(), reading.pressure.copy(), reading.traction.copy(), reading.slip.copy()])
    return [np.array(each) for each in zip(*readings)]


def total(force):
    return force.sum((1, 2))


def coefficient(force):
    """Return the drag over the load of each step."""
    return total(force)[:, 0] / -total(force)[:, 2]


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize(("tau", "left"), [(1e7, 1.0), (1e-8, 0.4)], ids=["slow", "fast"])
@pytest.mark.parametrize("shape", SHAPES)
def test_far_from_its_time_constant_it_is_elastic(shape, tau, left, dtype):
    """With the modulus at first, and with that at rest; also after a rest, in which the whole skin sticks again."""
    build = {"dtype": dtype}
    relaxing = drawn(shape, relaxation=((0.6, tau),), build=build)[0]
    elastic = drawn(shape, young_modulus=left * 1e5, build=build)[0]
    largest = np.abs(total(elastic)).max(0)
    assert np.abs(total(relaxing) - total(elastic)).max() < 2e-3 * largest.max()
    assert coefficient(elastic)[START:].max() > 0.45  # it sticks anew


@pytest.mark.parametrize("spectrum", [STANDARD, TERMS, ((1.0, 0.1),)], ids=["standard solid", "two terms", "flows"])
@pytest.mark.parametrize("shape", SHAPES)
def test_tractions_stay_below_the_bound_and_the_force_falls_to_the_kinetic_one(shape, spectrum):
    force, pressure, traction, _slip = drawn(shape, relaxation=spectrum)
    along = np.linalg.norm(traction, axis=-1)
    assert (along <= STATIC * pressure + 1e-6 * pressure.max()).all()
    mu = coefficient(force)
    peak = mu[:STOP].argmax()
    assert KINETIC + 0.05 < mu[peak] < STATIC
    if shape == "plate":  # under the ball new cells, which stick at first, lift the force
        assert np.diff(mu[peak:STOP]).max() < 2e-4
    assert mu[STOP - 1] == pytest.approx(KINETIC, rel=5e-3)


def test_a_sliding_plate_is_dragged_by_the_kinetic_share_of_the_relaxed_load():
    """Force, load and their fall in closed form, without the pull of pressure along the skin."""
    force = drawn("plate", relaxation=STANDARD, coupled=False)[0]
    mu, times = coefficient(force), DT * np.arange(1, END + 1)
    peak = mu.argmax()
    assert np.diff(mu[10:peak]).min() > 0 and np.diff(mu[peak:STOP]).max() < 1e-5
    load = stiffness(cells=16) * SHAPES["plate"][1] * modulus(STANDARD, times - DT / 2)
    assert -total(force)[10:, 2] == pytest.approx(load[10:], rel=2e-3)
    assert total(force)[STOP - 20 : STOP, 0] == pytest.approx(KINETIC * load[STOP - 20 : STOP], rel=2e-3)


def test_a_skin_that_creeps_under_a_resting_body_slips_on():
    """After its peak the force has fallen: the skin draws back and slips on at the kinetic bound until that ends."""
    force, pressure, traction, slip = drawn("plate", relaxation=STANDARD)
    touched = pressure[START - 1] > 0
    assert (slip[START - 1][touched] == 2).all()
    bound = np.linalg.norm(traction[START - 1], axis=-1)[touched] / pressure[START - 1][touched]
    assert bound == pytest.approx(KINETIC, rel=1e-3)
    assert coefficient(force)[START:].max() < KINETIC + 1e-3


@pytest.mark.parametrize("at", [30, 60, STOP + 5])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_saved_states_and_threads_read_the_same(dtype, at):
    options = {"relaxation": TERMS, "friction": STATIC, "kinetic_friction": KINETIC, "cells": 16, "displacement": True}
    build, end = {"n_envs": 3, "dtype": dtype}, at + 30
    one, other = (skin_on(BALL, DT, build=build, **options) for _ in range(2))
    drawn(steps=(at,), run=one)
    state = one[0].state()
    rest = drawn(steps=(at, end), run=one)
    for run in (one, other):
        run[0].prepare_restore(state)()
        for got, wanted in zip(drawn(steps=(at, end), run=run), rest):
            assert np.array_equal(got, wanted)
    parted = skin_on(BALL, DT, build=build | {"threads": 2}, **options)
    for got, wanted in zip(drawn(steps=(end,), run=parted), rest):
        assert np.array_equal(got[at:], wanted)
