"""Light and heavy bodies at rest on a skin, and impacts: the taxels' forces sum up to those of MuJoCo's contacts."""

# MuJoCo's functions come from a compiled module that a checker cannot see into.
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false

import logging

import mujoco
import numpy as np
import pytest

from tactemu.engines.mujoco_impacts import impact_s
from tests.hands.closed_loop import made

G = 9.81
SHAPES = {"ball": ("sphere", ".015", 0.015), "box": ("box", ".01 .008 .01", 0.01)}
MODELS = {"springs": 'model = "kinematic_taxel"\n', "layer": 'model = "elastic_layer_taxel"\n'}
STIFF = 'solref="0.002 0.3"'
XML = """<mujoco><option timestep="{timestep}"/><default><geom {contact}/></default><worldbody>
<body name="pad"><geom name="plate" type="box" size=".05 .05 .1" pos="0 0 -.1"/></body>
<body name="thing" pos="{place} {height}"><freejoint/>
<geom name="thing" type="{kind}" size="{size}" mass="{mass}"/></body>
</worldbody></mujoco>"""


def lying(
    folder, mass, shape="ball", model="springs", dt=1e-3, timestep=None, contact="", place="0.002 0.001", more=""
):
    """Return the emulator of a body that touches a flat skin, its engine and its pad."""
    kind, size, height = SHAPES[shape]
    given = {"timestep": timestep or dt, "contact": contact, "place": place, "height": height, "mass": mass}
    (folder / "load.xml").write_text(XML.format(kind=kind, size=size, **given))
    scene = folder / "load.toml"
    engine = '[engine]\nkind = "mujoco"\nfile = "load.xml"\n'
    skin = f'[[skin]]\ndevice = "flexitac"\n{MODELS[model]}link = "pad"\n'
    scene.write_text(f"[scene]\ndt = {dt}\n{more}{engine}{skin}")
    emulator, simulation, engine = made(scene)
    return emulator, simulation, engine, next(iter(engine.pads.values()))


@pytest.mark.parametrize("mass", [1e-4, 1e-2, 1.0, 1e2])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("model", MODELS)
def test_a_body_at_rest_reads_its_weight(model, shape, mass, tmp_path):
    emulator, _, engine, pad = lying(tmp_path, mass, shape, model)
    read, modelled = [], []
    with emulator:
        emulator.run(0.3)
        for _ in range(20):
            emulator.run(1e-3)
            read.append(-pad.sensor.quantity("force", ground_truth=True)[:, 2].astype(float).sum())
            modelled.append(pad._modelled_force())
    np.testing.assert_allclose(read, mass * G, rtol=1e-3)
    if mass < 100:  # float32 resolves a box's depth of 3 nm by 8 %; one factor closes what is left
        np.testing.assert_allclose(modelled, mass * G, rtol=0.1 if mass < 1e-3 else 0.01)
    assert pad.is_overloaded == (mass == 100) and engine.beside_ns == 0


def drop(emulator, engine, pad, dt, seconds=0.02):
    """Return the impulse of the taxels and that of MuJoCo's contacts [N s] in a fall from 1 m."""
    engine.data.qvel[2] = -np.sqrt(2 * G)
    inner, wrench, impulse, step = engine._mujoco, np.zeros(6), [0.0], mujoco.mj_step

    class Counting:
        def __getattr__(self, name):
            return counted if name == "mj_step" else getattr(inner, name)

    def counted(model, data, steps=1):
        for _ in range(steps):
            step(model, data)
            for k in range(data.ncon):
                mujoco.mj_contactForce(model, data, k, wrench)
                impulse[0] += wrench[0] * model.opt.timestep

    engine._mujoco, felt = Counting(), 0.0
    with emulator:
        for _ in range(round(seconds / dt)):
            emulator.run(dt)
            felt += -pad.sensor.quantity("force", ground_truth=True)[:, 2].astype(float).sum() * dt
    return felt, impulse[0]


@pytest.mark.parametrize("steps", [1, 4])
@pytest.mark.parametrize("mass", [1e-3, 3e-2, 1.0])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("model", MODELS)
def test_an_impact_has_mujocos_impulse(model, shape, mass, steps, tmp_path):
    dt = 1e-4
    emulator, simulation, engine, pad = lying(tmp_path, mass, shape, model, dt, dt / steps, STIFF)
    assert 10 * dt < impact_s(engine.model, 0, 1) and "impact" not in str(simulation.plan)
    felt, impulse = drop(emulator, engine, pad, dt)
    assert impulse > 1.2 * mass * np.sqrt(2 * G), "it bounces"
    assert felt == pytest.approx(impulse, rel=0.02)


@pytest.mark.parametrize("contact", ["", STIFF, 'solref="0.003 2"', 'solref="-1e6 -300"'])
def test_an_impact_lasts_as_long_as_the_plan_says(contact, tmp_path):
    """The plan names the longest step that resolves it; MuJoCo's force ends then."""
    text = XML.format(timestep=1e-5, contact=contact, place="0 0", height=0.015, kind="sphere", size=".015", mass=0.1)
    model = mujoco.MjModel.from_xml_string(text)
    data, force = mujoco.MjData(model), []
    data.qvel[2], wrench = -0.05, np.zeros(6)
    model.opt.gravity[:] = 0
    for _ in range(20_000):
        mujoco.mj_step(model, data)
        force.append(sum((mujoco.mj_contactForce(model, data, k, wrench), wrench[0])[1] for k in range(data.ncon)))
    took = np.count_nonzero(force) * 1e-5
    assert impact_s(model, 0, 1) == pytest.approx(took, rel=0.25)


def test_the_plan_says_that_steps_are_too_long_for_an_impact(tmp_path):
    emulator, simulation, *_ = lying(tmp_path, 0.1, dt=1e-3, contact=STIFF)
    with emulator:
        assert "an impact of geom 'thing' lasts 1.6 ms: at steps of 1 ms" in str(simulation.plan)
        assert "take dt <= 0.16 ms" in str(simulation.plan)


def test_what_lies_beside_the_taxels_is_counted_and_reported(tmp_path, caplog):
    emulator, _, engine, pad = lying(tmp_path, 0.1, place="0.045 0")
    with emulator, caplog.at_level(logging.WARNING):
        emulator.run(0.3)
        before = engine.beside_ns
        emulator.run(0.1)
        assert engine.beside_ns - before == pytest.approx(0.1 * 0.1 * G, rel=0.01)
    assert pad.skin_force() == 0
    assert caplog.text.count("press beside the taxels of flexitac") == 1


def test_a_skin_that_others_press_too_is_not_scaled(tmp_path):
    """A body of the scene is none of MuJoCo's, and its force is not known."""
    ball = '[[body]]\nname = "other"\nshape = "sphere"\nradius = 0.01\nposition = [0.0, 0.0, 0.0099]\nfixed = true\n'
    emulator, simulation, _, pad = lying(tmp_path, 0.1, place="0 0.3", more=ball)
    with emulator:
        emulator.run(0.01)
        assert pad.skin_force() > 0 and "MuJoCo" not in str(simulation.plan)


@pytest.mark.parametrize("model", MODELS)
def test_a_body_that_slides_goes_on_from_a_saved_state(model, tmp_path):
    """Also the factor on its taxels is that of the step before, which the restored simulation has not computed."""

    def forces(emulator, pad):
        told = []
        for _ in range(20):
            emulator.run(1e-3)
            told.append(pad.sensor.quantity("force", ground_truth=True).copy())
        return np.array(told)

    emulator, _, engine, pad = lying(tmp_path, 0.05, model=model)
    with emulator:
        emulator.run(0.1)
        engine.data.qvel[0] = 0.02
        emulator.run(0.01)
        state = emulator.snapshot()
        whole = forces(emulator, pad)
    other, _, _, pad = lying(tmp_path, 0.05, model=model)
    other.restore(state)
    with other:
        np.testing.assert_array_equal(forces(other, pad), whole)
    assert np.abs(whole.sum(axis=1)[:, 0]).max() > 0.01 or model == "springs"
