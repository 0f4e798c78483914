"""The relaxing layer against closed forms: a full press, a ball that comes and goes, a recovery, a shear, extremes."""

import numpy as np
import pytest

import tactemu as tt
from tactemu.base.errors import SceneError
from tactemu.sensors.layer.relaxation import SPECTRA, spectrum_of
from tactemu.transducers.material import Material
from tests.sensors.test_elastic_layer import TOP, grid

TERMS = ((0.5, 0.05), (0.2, 0.5))
STANDARD = ((0.6, 0.1),)
PLATE = tt.Box(size=(0.05, 0.05, 0.01))
ALLOWED = 5e-3
"""Largest error, as a share of the largest force of the truth."""


def skin_on(shape, dt, *, cells=8, pitch=5e-4, build=None, **options):
    """A scene with one shape above a skin; returns the simulation, the body and the sensor."""
    scene = tt.Scene(dt=dt)
    pad = scene.add_body(tt.Box(size=(0.08, 0.08, 2 * TOP)), fixed=True)
    body = scene.add_body(shape, name="object", position=(0, 0, 1.0))
    options = {
        "young_modulus": 1e5, "poisson_ratio": 0.49, "thickness": 4e-3, "friction": 0.0, "iterations": 100,
        "tolerance": 1e-5, "displacement": False, **options,
    }  # fmt: skip
    skin = scene.add_sensor(tt.ElasticLayerTaxel(positions=grid(cells, cells, pitch), **options), link=pad)
    return scene.build(**(build or {})), body, skin


def course(shape, half_height, depth, times, *, slide=None, **options):
    """Forces on the skin [N], ``(n, 3)``, while the shape is ``depth(t)`` deep, and ``slide(t)`` aside."""
    dt = times[1] - times[0]
    sim, body, skin = skin_on(shape, dt, **options)
    forces = []
    for t in times[1:]:
        aside = 0.0 if slide is None else slide(t)
        sim.set_pose(body, position=(aside, 0, TOP + half_height - depth(t)))
        sim.step()
        forces.append(skin.read().force.sum((0, 1)))
    return np.array(forces)


def pushes(*args, **options):
    return -course(*args, **options)[:, 2]


def modulus(terms, t):
    return 1 - sum(share * (1 - np.exp(-t / tau)) for share, tau in terms)


def stiffness(**options):
    """Force per depth [N/m] of the plate on the elastic skin."""
    return pushes(PLATE, 5e-3, lambda _: 1e-4, [0.0, 1.0], **options)[0] / 1e-4


def ramp(terms, t):
    """The integral of the modulus from 0 to t: the force per speed of a ramp that begins at 0."""
    t = np.maximum(t, 0.0)
    return t + sum(share * (tau * (1 - np.exp(-t / tau)) - t) for share, tau in terms)


def worst(forces, truth):
    return np.abs(forces - truth).max() / np.abs(truth).max()


@pytest.mark.parametrize("terms", [STANDARD, TERMS], ids=["standard solid", "two terms"])
@pytest.mark.parametrize("dt", [1e-3, 1e-2, 0.1])
def test_ramp_and_hold(terms, dt):
    rate, end = 1e-3, 0.2
    times = np.arange(round(1.0 / dt) + 1) * dt
    forces = pushes(PLATE, 5e-3, lambda t: rate * min(t, end), times, relaxation=terms)
    truth = stiffness() * rate * (ramp(terms, times) - ramp(terms, times - end))[1:]
    assert worst(forces, truth) < 1e-4  # exact in time: the depth is straight within a step


@pytest.mark.parametrize(("per_period", "allowed"), [(16, ALLOWED), (64, 3e-4), (256, 5e-5)])
def test_harmonic(per_period, allowed):
    """A plate that swings about a depth: once the start is forgotten, the force leads as the complex modulus says."""
    (share, tau), period, mean, swing = STANDARD[0], 0.5, 5e-4, 1e-4
    omega, times = 2 * np.pi / period, np.arange(4 * per_period + 1) * period / per_period
    forces = pushes(PLATE, 5e-3, lambda t: mean - swing * np.cos(omega * t), times, relaxation=STANDARD)
    x, last = omega * tau, times[-per_period:]
    stored, lost = 1 - share / (1 + x**2), share * x / (1 + x**2)
    truth = mean * (1 - share) + swing * (lost * np.sin(omega * last) - stored * np.cos(omega * last))
    assert worst(forces[-per_period:], stiffness() * truth) < allowed


def lee_radok(terms, times, rate, radius, effective, *, turn):
    """Force [N] of a ball on a half-space that is pressed with ``rate`` until ``turn`` and lifted likewise: Lee and
    Radok (1960) while contact grows, Ting (1966) while it shrinks."""
    forces = []
    for t in times:
        until = t
        if t > turn:  # the moment at which contact was as large before
            low, high = 0.0, turn
            for _ in range(60):
                middle = (low + high) / 2
                pressed = ramp(terms, t - middle) - ramp(terms, t - turn)
                low, high = (middle, high) if pressed > ramp(terms, t - turn) else (low, middle)
            until = low
        edges = np.linspace(0.0, until, 4001)
        grown = 4 / 3 * effective * np.sqrt(radius) * (rate * edges) ** 1.5
        forces.append((modulus(terms, t - (edges[1:] + edges[:-1]) / 2) * np.diff(grown)).sum())
    return np.array(forces)


@pytest.mark.parametrize("dt", [4e-3, 2e-2])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_ball_on_a_half_space(dtype, dt):
    radius, turn, rate, nu = 0.02, 0.2, 2e-3, 0.3
    reach = np.sqrt(radius * rate * turn)
    times = np.arange(round(2 * turn / dt) + 1) * dt
    options = {"thickness": np.inf, "poisson_ratio": nu, "look_depth": 4e-3, "cells": 48, "pitch": 2.5 * reach / 48}
    forces = pushes(
        tt.Sphere(radius=radius), radius, lambda t: rate * (turn - abs(t - turn)), times, relaxation=TERMS,
        build={"dtype": dtype}, **options,
    )  # fmt: skip
    truth = lee_radok(TERMS, times[1:], rate, radius, 1e5 / (1 - nu**2), turn=turn)
    assert worst(forces, truth) < ALLOWED
    assert truth.argmax() < turn / dt and forces[-1] == 0  # it lets go before the ball is back


def test_steps_converge():
    """A ball that swings: twice the steps, a fourth of the error, down to the solver's tolerance."""

    def swing(n):
        times = np.arange(n + 1) / n
        return pushes(
            tt.Sphere(radius=0.02), 0.02, lambda t: 3e-4 * np.sin(np.pi * t / 2) ** 2, times, relaxation=TERMS,
            build={"dtype": "float64"}, tolerance=1e-8, iterations=400,
        )  # fmt: skip

    coarse, middle, fine, truth = (swing(n)[n // 16 - 1 :: n // 16] for n in (16, 32, 64, 512))
    errors = [worst(each, truth) for each in (coarse, middle, fine)]
    assert errors[0] < 2e-2 and errors[2] < 1e-3
    assert errors[0] / errors[1] > 2.5 and errors[1] / errors[2] > 2.5


def test_skin_recovers_with_the_retardation_time():
    """After a plate is lifted the surface returns as exp(-(1 - g) t / tau)."""
    (share, tau), dt, depth = STANDARD[0], 1e-3, 2e-4
    sim, body, skin = skin_on(PLATE, dt, displacement=True, relaxation=STANDARD)
    sim.set_pose(body, position=(0, 0, TOP + 5e-3 - depth))
    sim.step(2000)
    sim.set_pose(body, position=(0, 0, TOP + 0.1))
    sunk = []
    for _ in range(300):
        sim.step()
        reading = skin.read()
        sunk.append(-reading.displacement[4, 4, 2])
    assert not reading.pressure.any() and not reading.slip.any()
    t = np.arange(300) * dt
    truth = depth * share * np.exp(-(1 - share) * t / tau)
    assert np.abs(np.array(sunk) - truth).max() < ALLOWED * depth


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_sticking_plate_relaxes_along_the_skin(dtype, coupled):
    """Tractions relax as pressures do: a stuck plate that is moved aside and held, under a load that has relaxed."""
    dt, depth, aside = 1e-2, 2e-4, 5e-5
    times = np.arange(301) * dt

    def slide(t):
        return aside * np.clip(t - 1.0, 0.0, 0.1) / 0.1

    options = {"friction": 5.0, "coupled": coupled, "slide": slide, "poisson_ratio": 0.3, "build": {"dtype": dtype}}
    forces = course(PLATE, 5e-3, lambda _: depth, times, relaxation=TERMS, **options)[:, 0]
    elastic = course(PLATE, 5e-3, lambda _: depth, times, **options)[-1, 0]
    truth = elastic / 0.1 * (ramp(TERMS, times - 1.0) - ramp(TERMS, times - 1.1))[1:]
    assert abs(elastic) > 0.01
    assert worst(forces, truth) < ALLOWED


def test_slipping_plate_is_dragged_by_the_relaxed_load():
    """Under full slip the tangential force is friction times the normal force of the moment."""
    times = np.arange(101) * 1e-2
    options = {"friction": 0.3, "slide": lambda t: 5e-3 * t, "relaxation": STANDARD}
    forces = course(PLATE, 5e-3, lambda _: 1e-4, times, **options)
    assert np.abs(forces[50:, 0] / -forces[50:, 2]).max() == pytest.approx(0.3, rel=1e-3)
    assert forces[-1, 2] == pytest.approx(-1e-4 * stiffness() * 0.4, rel=ALLOWED)


EXTREMES = {
    "relaxes within a step": ((0.5, 1e-9), (0.3, 1e-6)),
    "does not relax": ((0.5, 1e9), (0.3, 1e7)),
    "flows": ((1.0, 0.1),),
    "nearly flows": ((0.999, 0.05),),
    "wide": ((0.1, 1e-6), (0.2, 1e-3), (0.3, 1.0), (0.3, 1e3), (0.1, 1e9)),
}


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("name", EXTREMES)
def test_extremes(name, dtype):
    terms, rate, end, dt = EXTREMES[name], 1e-3, 0.2, 1e-2
    times = np.arange(101) * dt
    options = {"relaxation": terms, "build": {"dtype": dtype}}
    forces = pushes(PLATE, 5e-3, lambda t: rate * min(t, end), times, **options)
    truth = stiffness() * rate * (ramp(terms, times) - ramp(terms, times - end))[1:]
    assert np.isfinite(forces).all()
    assert worst(forces, truth) < 1e-3


def test_slow_terms_do_not_stall_in_float32():
    """A million steps of a term: what it keeps in each is less than a float32 resolves."""
    terms, dt, depth = ((0.5, 1e4),), 1e-2, 2e-4
    sim, body, skin = skin_on(PLATE, dt, cells=2, relaxation=terms)
    sim.set_pose(body, position=(0, 0, TOP + 5e-3 - depth))
    sim.step()
    first = -skin.read().force[..., 2].sum()
    sim.step(20_000)
    assert -skin.read().force[..., 2].sum() / first == pytest.approx(modulus(terms, 200.0), rel=1e-4)


def test_steps_of_any_length_in_one_run():
    """A step's length may change: the memory is that of the time, not of the steps. A step of no time changes
    nothing."""
    sim, body, skin = skin_on(PLATE, 1e-2, relaxation=TERMS)
    rate, t, forces, truth = 1e-3, 0.0, [], []
    for dt in (1e-3, 2e-2, 0.0, 5e-3, 0.1, 0.0, 1e-4, 0.3):
        t += dt
        sim.set_pose(body, position=(0, 0, TOP + 5e-3 - rate * t))
        sim.step(dt=dt)
        forces.append(-skin.read().force[..., 2].sum())
        truth.append(rate * ramp(TERMS, t))
    assert worst(np.array(forces), stiffness() * np.array(truth)) < 1e-4


def press_and_drag(sim, body, skin, steps, envs=None):
    """Readings while a ball presses and moves aside."""
    readings = []
    for k in range(*steps):
        depth = 3e-4 * min(k, 10) / 10
        sim.set_pose(body, position=(5e-5 * k, 0, TOP + 5e-3 - depth))
        sim.step()
        readings.append(skin.read().force.copy())
    return np.array(readings)


BALL = {"friction": 0.5, "displacement": True, "relaxation": TERMS, "cells": 16}


def test_reset_forgets_and_repeats():
    sim, ball, skin = skin_on(tt.Sphere(radius=5e-3), 1e-2, **BALL)
    first = press_and_drag(sim, ball, skin, (20,))
    sim.set_pose(ball, position=(0, 0, 1.0))
    sim.reset()
    sim.step()
    assert not any(field.any() for field in skin.read())
    sim.reset()
    assert np.array_equal(press_and_drag(sim, ball, skin, (20,)), first)


def test_reset_of_one_environment_leaves_the_other():
    sim, ball, skin = skin_on(tt.Sphere(radius=5e-3), 1e-2, build={"n_envs": 3}, **BALL)
    alone, ball_alone, skin_alone = skin_on(tt.Sphere(radius=5e-3), 1e-2, **BALL)
    press_and_drag(sim, ball, skin, (20,))
    whole = press_and_drag(alone, ball_alone, skin_alone, (40,))
    sim.reset(envs=[1])
    both = press_and_drag(sim, ball, skin, (20, 40))
    assert np.array_equal(both[:, 0], whole[20:]) and np.array_equal(both[:, 2], whole[20:])
    assert not np.array_equal(both[:, 1], whole[20:])


def test_saved_state_and_threads_read_the_same():
    options = {"build": {"n_envs": 4}, **BALL}
    sim, ball, skin = skin_on(tt.Sphere(radius=5e-3), 1e-2, **options)
    press_and_drag(sim, ball, skin, (15,))
    state = sim.state()
    rest = press_and_drag(sim, ball, skin, (15, 30))
    sim.prepare_restore(state)()
    assert np.array_equal(press_and_drag(sim, ball, skin, (15, 30)), rest)
    other, other_ball, other_skin = skin_on(tt.Sphere(radius=5e-3), 1e-2, **options)
    other.prepare_restore(state)()
    assert np.array_equal(press_and_drag(other, other_ball, other_skin, (15, 30)), rest)
    threads = {"build": {"n_envs": 4, "threads": 2}, **BALL}
    parted, parted_ball, parted_skin = skin_on(tt.Sphere(radius=5e-3), 1e-2, **threads)
    assert np.array_equal(press_and_drag(parted, parted_ball, parted_skin, (30,))[15:], rest)


def test_both_float_widths_read_the_same():
    readings = []
    for dtype in ("float32", "float64"):
        sim, ball, skin = skin_on(tt.Sphere(radius=5e-3), 1e-2, build={"dtype": dtype}, **BALL)
        readings.append(press_and_drag(sim, ball, skin, (30,)))
    assert np.abs(readings[0] - readings[1]).max() < 2e-3 * np.abs(readings[1]).max()


def test_pose_that_is_no_number_reads_nan_until_a_reset():
    sim, ball, skin = skin_on(tt.Sphere(radius=5e-3), 1e-2, **BALL)
    first = press_and_drag(sim, ball, skin, (20,))
    with pytest.raises(tt.PoseError):
        press = (np.nan, 0, TOP)
        sim.set_pose(ball, position=press)
        sim.step()
    assert np.isnan(skin.read().force).any()
    sim.set_pose(ball, position=(0, 0, 1.0))
    sim.reset()
    assert np.array_equal(press_and_drag(sim, ball, skin, (20,)), first)


def test_memory_is_only_where_something_was():
    """A skin that has recovered is as cheap and as empty as a new one."""
    sim, ball, skin = skin_on(tt.Sphere(radius=5e-3), 1e-2, relaxation=((0.5, 1e-3),), cells=16, displacement=True)
    press_and_drag(sim, ball, skin, (20,))
    sim.set_pose(ball, position=(0, 0, 1.0))
    sim.step(40)
    assert not any(field.any() for field in skin.read())


def test_stages_are_only_what_is_asked_for():
    elastic, _, _ = skin_on(PLATE, 1e-2)
    none, _, _ = skin_on(PLATE, 1e-2, relaxation=((0.0, 1.0),))
    relaxing, _, _ = skin_on(PLATE, 1e-2, relaxation="polyurethane")
    names = [[stage.name.split(": ")[-1] for stage in sim.plan.stages] for sim in (elastic, none, relaxing)]
    assert names[0] == names[1] and set(names[2]) - set(names[0]) == {"memory", "relaxation"}
    assert len(elastic.context.memory) == len(none.context.memory) < len(relaxing.context.memory)
    assert "relaxes: to 0.292 of its modulus" in str(relaxing.plan)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (((0.6, 0.1), (0.5, 0.2)), "add up to at most 1"),
        (((1.2, 0.1),), "must be >= 0 and <= 1"),
        (((-0.1, 0.1),), "must be >= 0"),
        (((0.5, 0.0),), "must be >= 1e-09"),
        (((0.5,),), "must be 2 numbers"),
        (0.5, "must be"),
        ("honey", "one of"),
        (tuple((0.01, 0.1) for _ in range(33)), "at most 32 terms"),
    ],
)
def test_wrong_spectra_are_named(given, words):
    with pytest.raises(SceneError, match=words):
        skin_on(PLATE, 1e-2, relaxation=given)


@pytest.mark.parametrize("name", SPECTRA)
def test_published_spectra_are_spectra(name):
    spectrum = spectrum_of(name, "test")
    assert spectrum and 0 < spectrum.at_rest < 1
    assert spectrum.modulus(0.0) == 1 and spectrum.modulus(1e12) == pytest.approx(spectrum.at_rest)


@pytest.mark.parametrize("option", ["creep_strength", "hysteresis_strength", "hysteresis_strength_unloading"])
def test_imperfections_do_not_relax_again(option):
    with pytest.raises(SceneError, match=f"{option} at 0: its skin relaxes by itself"):
        skin_on(PLATE, 1e-2, relaxation=TERMS, imperfections=tt.ImperfectionOptions(**{option: 0.1}))


def test_transducers_do_not_relax_again():
    scene = tt.Scene(dt=1e-2)
    pad = scene.add_body(tt.Box(size=(0.08, 0.08, 2 * TOP)), fixed=True)
    scene.add_body(PLATE, position=(0, 0, 1.0))
    model = tt.ElasticLayerTaxel(positions=grid(4, 4, 1e-3), relaxation=TERMS)
    worn = Material(softening=0.1, baseline=0.01)
    scene.add_sensor(model, link=pad, transducers=[worn])
    scene.build()
    for option in ("creep_per_decade", "loop"):
        scene = tt.Scene(dt=1e-2)
        pad = scene.add_body(tt.Box(size=(0.08, 0.08, 2 * TOP)), fixed=True)
        scene.add_sensor(model, link=pad, transducers=[Material(**{option: 0.1})])
        with pytest.raises(SceneError, match=f"Material.{option} at 0.*Wear"):
            scene.build()
