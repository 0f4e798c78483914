"""Whole scenes with imperfections against the reference: physics, gain inside the formula, latches, delay, resets.

The reference reads nothing while its contact list is empty, though a probe's radius may reach the indenter; there the
indenter is held far away, so that both start from the same raw readings.
"""

import functools
import json
from typing import Any

import numpy as np
import pytest

import tactemu as tt
from tactemu.base.option_groups import from_flat
from tests.imperfections.rig import DATA

CASES = {
    "c05": ("gauss", "k1", "k2g", "k3g", "hyst", "gain", "all"),
    "c13": ("plain", "delay", "hist", "bias", "dead", "hyst", "cbias", "chyst", "khist"),
}
ROUNDED = ("res", "biasres", "kdelay")
TOLERANCE = {"float64": 1e-9, "float32": 2e-5}
FAR = np.array([0.0, 0.0, 1.0])


@functools.cache
def recorded(name: str) -> tuple[dict, dict]:
    """Arrays and facts of a case."""
    arrays = {}
    for part in (name, f"{name}_scene"):
        arrays |= dict(np.load(DATA / f"{part}.npz"))
    return arrays, json.loads((DATA / f"{name}_scene.json").read_text())


@functools.cache
def replayed(name: str, dtype: str) -> dict[str, list]:
    """Our readings, ``{key: [reading per step]}``, of all sensors of a case in one scene."""
    arrays, facts = recorded(name)
    scene: Any = tt.Scene(dt=facts["dt"], convention="genesis", names="genesis")
    pad = scene.add_body(tt.Box(size=(0.08, 0.08, 0.02)), name="pad")
    ball = scene.add_body(tt.Sphere(radius=0.02), name="ball")
    sensors = {}
    for key, sensor in facts["sensors"].items():
        options = {k: v for k, v in sensor["options"].items() if k != "ent"}
        sensors[key] = scene.add_sensor(getattr(tt, sensor["type"]), link=pad, name=key, **options)
    sim = scene.build(dtype=dtype)
    resets = {event["step"] for event in facts["events"]}
    readings = {key: [] for key in sensors}
    for t in range(len(arrays["link_pos"])):
        if t in resets:
            sim.reset()
        for body, link in ((pad, 0), (ball, 1)):
            position, spin = arrays["link_pos"][t, 0, link], arrays["link_cd_ang"][t, 0, link]
            velocity = arrays["link_cd_vel"][t, 0, link] + np.cross(
                spin, position - arrays["link_root_COM"][t, 0, link]
            )
            if body is ball and not arrays["n_contacts"][t, 0]:
                position = FAR
            turned = arrays["link_quat"][t, 0, link]
            sim.set_pose(body, position=position, quaternion=turned, linear_velocity=velocity, angular_velocity=spin)
        sim.step()
        for key, sensor in sensors.items():
            readings[key].append(sensor.read())
    return readings


def parts(name: str, key: str, dtype: str):
    """Pairs (ours, theirs) of a sensor's reading over all steps."""
    arrays, ours = recorded(name)[0], replayed(name, dtype)[key]
    if f"{key}__out" in arrays:
        return [(np.array(ours), arrays[f"{key}__out"])]
    return [(np.array([getattr(r, part) for r in ours]), arrays[f"{key}__{part}"]) for part in ("force", "torque")]


@pytest.mark.parametrize("dtype", TOLERANCE)
@pytest.mark.parametrize("name, key", [(name, key) for name, keys in CASES.items() for key in keys])
def test_reads_what_the_reference_reads(name, key, dtype):
    for ours, theirs in parts(name, key, dtype):
        if theirs.dtype == bool:
            assert theirs.any() and not theirs.all()
            np.testing.assert_array_equal(ours, theirs)
            continue
        largest = np.abs(theirs).max()
        assert largest > 0
        assert np.abs(ours - theirs).max() <= TOLERANCE[dtype] * largest


@pytest.mark.parametrize("dtype", TOLERANCE)
@pytest.mark.parametrize("key", ROUNDED)
def test_rounded_readings_are_equal_but_for_halves(key, dtype):
    """A reading on a half may fall on the other side: then it is one step of the quantiser off, and that is rare."""
    quantum = recorded("c13")[1]["sensors"][key]["options"]["resolution"]
    for ours, theirs in parts("c13", key, dtype):
        off = np.abs(ours - theirs)
        wrong = off > TOLERANCE[dtype] * np.abs(theirs).max()
        assert wrong.mean() < 0.01
        np.testing.assert_allclose(off[wrong], quantum, rtol=1e-4)


def test_history_of_the_truth_is_not_delayed():
    facts = recorded("c13")[1]
    scene = tt.Scene(dt=1e-3)
    pad = scene.add_body(tt.Box(size=(0.08, 0.08, 0.02)), fixed=True)
    ball = scene.add_body(tt.Sphere(radius=0.02))
    positions = facts["sensors"]["hist"]["options"]["probe_local_pos"]
    given = {"positions": positions, "radius": 0.003, "history_length": 3, "delay": 2e-3}
    skin = scene.add_sensor(from_flat(tt.ContactDepthProbe, given), link=pad)
    sim = scene.build()
    for k in range(8):
        sim.set_pose(ball, position=(0, 0, 0.029 - 1e-4 * k))
        sim.step()
    measured, truth = skin.read(), skin.read_ground_truth()
    assert measured.shape == truth.shape == (3, 4, 4)
    np.testing.assert_array_equal(measured[0], truth[2])
    with pytest.raises(ValueError, match="shortest"):
        sim.step(dt=1e-4)
    sim.step(dt=5e-3)
    assert (skin.read()[0] == truth[0]).all()
    assert (np.diff(truth[:, 1, 1]) < 0).all(), "newest first, and the ball goes down"


def test_setters_of_a_sensor_in_a_batch():
    scene = tt.Scene()
    pad = scene.add_body(tt.Box(size=(0.08, 0.08, 0.02)), fixed=True)
    scene.add_body(tt.Sphere(radius=0.01), position=(0.0, 0.0, 1.0))
    skin = scene.add_sensor(tt.ContactDepthProbe(adjustable=("bias", "noise", "dead", "gain", "resolution")), link=pad)
    with pytest.raises(tt.TactemuError, match="build"):
        skin.set_bias(1.0)
    sim = scene.build(n_envs=4)
    skin.set_bias(0.5, envs=[1, 3])
    skin.set_noise(0.1, envs=[3])
    skin.set_dead(0, value=7.0, envs=[2])
    sim.step()
    reading = skin.read().ravel()
    np.testing.assert_allclose(reading[:3], [0.0, 0.5, 7.0])
    assert reading[3] != 0.5
    skin.set_gain(2.0)
    skin.set_resolution(1.0)
    sim.step()
    assert skin.read().ravel()[1] == 0.0  # half to even
