"""Motors, MuJoCo and skins in one loop: forces agree, runs repeat, wild models stay bounded."""

# MuJoCo's functions come from a compiled module that a checker cannot see into.
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false

import functools
import logging

import mujoco
import numpy as np
import pytest

import tactemu as tt
from tactemu.base.clock import LockstepClock, VirtualClock
from tactemu.base.errors import PoseError
from tactemu.truth import Passage, Sample, Truth, entries
from tests.emulator.test_lockstep import go_on
from tests.hands.closed_loop import CLOSED, L6, MS, OPEN, THUMB, frame, grasping, made, replaced
from tests.hands.holding import HANDS, contact_forces, scene_of


@pytest.mark.parametrize("thing", ["ball", "box"])
def test_what_a_pad_feels_is_mujocos_contact_force(thing, tmp_path):
    """In a static grasp, and what holds the object balances; its table is gone."""
    emulator, simulation, engine = made(scene_of(L6, thing, tmp_path))
    with emulator:
        grasping(emulator)
        emulator.run(2.0)
        steady = simulation.bodies[[body.name for body in simulation.bodies].index("table")].motion
        steady.put(2.0, position=(0, 0, -0.3))
        emulator.run(1.0)
        felt = [pad.skin_force() for pad in engine.pads.values()]
        pads = contact_forces(engine, L6.pads)
        counts = emulator.truth.latest("linker_hand_l6").counts.reshape(5, -1).sum(axis=1)
        weight = engine.model.body("object").mass[0] * 9.81
        holding = pads.sum()
        body = engine.model.body("object").id
        total = np.zeros(3)
        wrench = np.zeros(6)
        for k, contact in enumerate(engine.data.contact[: engine.data.ncon]):
            mujoco.mj_contactForce(engine.model, engine.data, k, wrench)
            bodies = [engine.model.geom_bodyid[geom] for geom in contact.geom]
            if body in bodies:
                total += (1 if bodies[1] == body else -1) * (wrench[:3] @ contact.frame.reshape(3, 3))
    assert pads.min() > 0.5
    np.testing.assert_allclose(felt[:2], [pad.force for pad in list(engine.pads.values())[:2]], rtol=1e-3)
    np.testing.assert_allclose(felt[:2], pads, rtol=0.05)
    np.testing.assert_allclose(counts[:2] / 500, pads, rtol=0.06, atol=0.05)
    assert np.abs(total - (0, 0, weight)).max() < 0.05 * holding, "the grasp balances"


LIGHT = """<mujoco><option timestep="{dt}"/><worldbody>
<body name="pad"><geom name="plate" type="box" size=".03 .03 .005" pos="0 0 -.005"/></body>
<body name="ball" pos="{place} .0151"><freejoint/><geom name="ball" type="sphere" size=".015" mass="{mass}"/></body>
</worldbody></mujoco>"""


def lying(folder, mass: float, dt: float = 1e-3, place: str = "0.002 0.001", model: str = "kinematic_taxel"):
    """A ball on a flat skin; its emulator and its pad."""
    (folder / "light.xml").write_text(LIGHT.format(dt=dt, place=place, mass=mass))
    scene = folder / "light.toml"
    engine = '[engine]\nkind = "mujoco"\nfile = "light.xml"\n'
    scene.write_text(f'[scene]\ndt = {dt}\n{engine}[[skin]]\ndevice = "flexitac"\nmodel = "{model}"\nlink = "pad"\n')
    emulator, _, engine = made(scene)
    return emulator, *engine.pads.values()


@pytest.mark.parametrize("place", ["0.002 0.001", "0 0", "0.0013 0.0004"])
@pytest.mark.parametrize("mass", [1e-4, 5e-4, 2e-3, 1.0])
def test_what_is_light_and_lies_still_reads_its_weight(mass, place, tmp_path):
    """A limit cycle of up to 860 times the weight stood here."""
    emulator, pad = lying(tmp_path, mass, place=place)
    felt = []
    with emulator:
        emulator.run(0.3)
        for _ in range(100):
            emulator.run(1e-3)
            felt.append(pad.skin_force())
    np.testing.assert_allclose(felt, mass * 9.81, rtol=0.02)  # float32 poses of a nanometre are 1 % of 0.1 g
    assert np.mean(felt) == pytest.approx(mass * 9.81, rel=0.01)


def test_a_script_gives_the_same_bytes_in_lockstep_and_in_virtual_time(tmp_path):
    logs = []
    for clock in (VirtualClock(), LockstepClock()):
        truth = Truth()
        emulator, _, engine = made(scene_of(L6, "ball", tmp_path), clock, truth)
        with emulator:
            grasping(emulator)
            if isinstance(clock, LockstepClock):
                for k in range(250):
                    go_on(emulator, (k + 1) * 10 * MS)
            else:
                emulator.run(2.5)
                emulator.step()
            where = engine.data.qpos.tobytes()
        logs.append(([frame for _, _, frame in truth.frames], [s.counts.tobytes() for s in truth.samples], where))
    assert logs[0] == logs[1]
    assert max(map(sum, (sample for sample in logs[0][1]))) > 100, "it has touched"
    answers = [answer.data for answer in logs[0][0] if answer.data[0] == 0x01]
    assert 0 < answers[-1][3] < 255 and answers[-1][1] == pytest.approx(THUMB, abs=5), "angles are as the hand is"
    currents = [answer.data for answer in logs[0][0] if answer.data[0] == 0x36]
    assert currents[-1][3] == pytest.approx(25, abs=2), "at its limit"


def test_a_recorded_run_done_again_in_lockstep_gives_the_same_bytes(tmp_path):
    """What the driver said is in the log, with its times."""
    logs = [tmp_path / "first.jsonl", tmp_path / "again.jsonl"]
    for log in logs:
        again = logs[0] if log != logs[0] else None
        scene = scene_of(L6, "ball", tmp_path)
        with tt.serve(scene, "memory:", clock="lockstep", seed=3, truth=log, again=again) as dev:
            if again is None:
                dev.in_loop(lambda: grasping(dev.emulator))
            dev.step(seconds=1.5)
    first, again = ([e for e in entries(log) if isinstance(e, Passage | Sample)] for log in logs)
    said = [[(e.t_ns, e.kind, e.frame) for e in run if isinstance(e, Passage)] for run in (first, again)]
    felt = [[(e.t_ns, e.counts.tobytes()) for e in run if isinstance(e, Sample)] for run in (first, again)]
    assert said[0] == said[1] and felt[0] == felt[1]
    assert {"rx", "tx"} == {kind for _, kind, _ in said[0]} and any(any(counts) for _, counts in felt[0])


@pytest.mark.parametrize(("on_late", "left_out_s"), [("slow", 0.5), ("drop", 0.0)])
def test_a_loop_that_is_late_slows_the_model_or_catches_up(on_late, left_out_s, tmp_path, caplog):
    emulator, simulation, engine = made(replaced(tmp_path, "[engine]\n", f'[engine]\non_late = "{on_late}"\n'))
    with emulator, caplog.at_level(logging.WARNING):
        emulator.run(0.1)
        begun = engine.data.time
        engine.pose(simulation, begun + 0.6)
        assert engine.behind_s == pytest.approx(left_out_s, abs=1e-6)
        assert engine.data.time == pytest.approx(begun + 0.6 - left_out_s, abs=1e-6)
        assert ("does not keep up" in caplog.text) == (on_late == "slow")
        engine.pose(simulation, begun + 2.6)  # more than it catches up with at once
        assert engine.behind_s > 0


@pytest.mark.parametrize("scene", sorted(HANDS.glob("*.toml")), ids=lambda scene: scene.stem)
def test_a_hand_of_the_examples_stands_open(scene):
    """Each model fits its device, and what it is to hold lies on its table."""
    emulator, _, engine = made(scene)
    with emulator:
        emulator.run(0.2)
        assert len(engine.pads) > 1 and not any(pad.skin_force() for pad in engine.pads.values())
        assert np.abs(engine.data.qvel).max() < 0.1


def test_an_order_for_a_small_step_is_no_kick(tmp_path):
    """A motor that is where it should be long before the next step of the scene has not moved at its full speed."""
    emulator, _, engine = made(scene_of(L6, "ball", tmp_path))
    write, fastest, dof = emulator.channels[0].wire.transport.driver.write, 0.0, engine.model.joint("index").dofadr[0]
    with emulator:
        emulator.at(10 * MS, functools.partial(write, frame(0x05, *[255] * 6)))
        emulator.at(20 * MS, functools.partial(write, frame(0x01, *[OPEN] * 6)))
        emulator.run(1.5)
        for k in range(20):  # at all times between two steps
            emulator.at(1500 * MS + k * 40_200_000, functools.partial(write, frame(0x01, *[OPEN - 1 - k] * 6)))
        for _ in range(200):
            emulator.run(0.004)
            fastest = max(fastest, abs(engine.data.qvel[dof]))
    step = 1.6 / 255
    assert 0.3 * step / 0.004 < fastest < 0.8 * step / 0.004


URDF = """
<robot name="finger">
  <link name="base">
    <collision><origin xyz="0 0 0.05"/><geometry><box size="0.04 0.04 0.01"/></geometry></collision>
  </link>
  <link name="tip">
    <inertial><mass value="0.05"/><inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><box size="0.009 0.018 0.01"/></geometry></collision>
  </link>
  <joint name="push" type="prismatic">
    <parent link="base"/><child link="tip"/><axis xyz="0 0 1"/><limit lower="0" upper="0.08" effort="100" velocity="1"/>
    <dynamics damping="5"/>
  </joint>
</robot>
"""


def test_a_hand_may_be_a_urdf(tmp_path):
    """A finger pushes against its base, with the force that its firmware allows."""
    (tmp_path / "finger.urdf").write_text(URDF)
    (tmp_path / "finger.toml").write_text(
        '[engine]\nkind = "mujoco"\nfile = "finger.urdf"\n[[skin]]\ndevice = "linker_hand_l6"\nlink = "world"\n'
        "position = [1.0, 0.0, 0.0]\n"
        'joints = { index = { joint = "push", ratio = 0.05 } }\n'
        'links = { index = { body = "tip", position = [0, 0, 0.005] } }'
    )
    emulator, _, engine = made(tmp_path / "finger.toml")
    write = emulator.channels[0].wire.transport.driver.write
    orders = [(0x05, *[128] * 6), (0x02, 255, 255, 25, 255, 255, 255), (0x01, *[OPEN] * 2, CLOSED, *[OPEN] * 3)]
    with emulator:
        for k, data in enumerate(orders):
            emulator.at((k + 1) * 10 * MS, functools.partial(write, frame(*data)))
        emulator.run(2.0)
        felt = list(engine.pads.values())[-1].skin_force()
        motor = float(np.abs(engine.data.actuator_force).max())
    weight = 0.05 * 9.81
    assert motor > 1.0 and felt == pytest.approx(motor - weight, rel=0.02)


def test_a_fork_goes_on_with_the_grasp(tmp_path):
    with tt.serve(scene_of(L6, "ball", tmp_path), port="memory:", clock="lockstep") as dev:
        dev.in_loop(lambda: grasping(dev.emulator))
        dev.step(seconds=1.8)
        with dev.fork("memory:") as other:
            for each in (dev, other):
                each.step(seconds=0.3)
            samples = [each.sample() for each in (dev, other)]
            assert samples[0].counts.any() and samples[0].counts.tobytes() == samples[1].counts.tobytes()


def test_a_restart_lets_go(tmp_path):
    """Motors hold where they are when power comes back, and no longer press."""
    emulator, _, engine = made(scene_of(L6, "ball", tmp_path))
    with emulator:
        grasping(emulator)
        emulator.run(2.0)
        assert contact_forces(engine, L6.pads).min() > 0.5
        emulator.reset()
        emulator.run(0.5)
        assert contact_forces(engine, L6.pads).max() < 0.3


def test_unplugged_the_hand_goes_on_holding(tmp_path):
    emulator, _, engine = made(scene_of(L6, "ball", tmp_path), faults=("unplug at 1.9s",))
    with emulator:
        grasping(emulator)
        emulator.run(3.0)
        assert contact_forces(engine, L6.pads).min() > 0.5


@pytest.mark.parametrize("limit", [0.3, 50.0])
def test_what_is_pressed_too_hard_breaks(limit, tmp_path, caplog):
    scene = scene_of(L6, "egg", tmp_path)
    scene.write_text(scene.read_text().replace("breaks = { object = 2.5 }", f"breaks = {{ object = {limit} }}"))
    emulator, _, engine = made(scene)
    with emulator, caplog.at_level(logging.WARNING):
        grasping(emulator)
        emulator.run(2.5)
        broken = engine.broken == ["object"]
        assert broken == (limit < 1) == ("engine: object broke under" in caplog.text)
        assert (contact_forces(engine, ["object"]).max() == 0) == broken, "nothing touches what is broken"


WILD = {
    # name: what is changed in the model, in the object, in the script
    "as it is": {},
    "deep overlap": {"object": (' pos="0 0 0.0672"', ' pos="0 -0.02 0.0672"')},
    "1 g": {"object": ('mass="0.03"', 'mass="0.001"')},
    "100 kg": {"object": ('mass="0.03"', 'mass="100"')},
    "instant full close": {"torque": 255, "close_s": 0.04},
    "1 g, full close": {"object": ('mass="0.03"', 'mass="0.001"'), "torque": 255, "close_s": 0.04},
    "100 kg, full close": {"object": ('mass="0.03"', 'mass="100"'), "torque": 255, "close_s": 0.04},
    "unplugged at full close": {"torque": 255, "close_s": 0.04, "faults": ("unplug at 0.5s",)},
    "time step 0.1 ms": {"dt": 0.0001},
    "time step 5 ms": {"dt": 0.005},
    "time step 10 ms, full close": {"dt": 0.01, "torque": 255},
    "time step 20 ms": {"dt": 0.02},
}


EVERY_RUN = ("deep overlap", "1 g, full close", "100 kg", "time step 20 ms")


@pytest.mark.parametrize(
    "name", [name if name in EVERY_RUN else pytest.param(name, marks=pytest.mark.nightly) for name in WILD]
)
def test_wild_configurations_stay_bounded(name, tmp_path):
    """Nothing is NaN, nothing stays deep in another, and no energy comes from nowhere."""
    case = WILD[name]
    scene = scene_of(L6, "ball", tmp_path)
    model = tmp_path / "linker_l6_ball.xml"
    text = model.read_text()
    if "object" in case:
        thing = tmp_path / "object.xml"
        path = text.split('"')[3]
        source = open(path).read()
        assert case["object"][0] in source
        thing.write_text(source.replace(*case["object"]))
        text = text.replace(path, str(thing))
    if "dt" in case:
        text = text.replace("</mujoco>", f'<option timestep="{case["dt"]}"/></mujoco>')
        scene.write_text(scene.read_text().replace("dt = 0.004", f"dt = {max(case['dt'], 0.004)}"))
    model.write_text(text)
    emulator, _, engine = made(scene, faults=case.get("faults", ()))
    data, work, most = engine.data, 0.0, 0.0
    with emulator:
        grasping(emulator, torque=case.get("torque", 25), close_s=case.get("close_s", 0.8))
        for _ in range(100):
            before = engine.data.qpos[:6].copy()
            emulator.run(0.02)
            work += float(np.abs(data.actuator_force).max()) * float(np.abs(data.qpos[:6] - before).sum())
            mujoco.mj_energyVel(engine.model, data)
            most = max(most, data.energy[1])
            assert np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()
    assert most < 1.0 + work, f"{most:.3g} J"
    deepest = -min((contact.dist for contact in data.contact[: data.ncon]), default=0.0)
    assert deepest < 2e-3


def test_a_state_that_is_not_finite_ends_the_run_and_says_so(tmp_path):
    emulator, _, engine = made(scene_of(L6, "ball", tmp_path))
    with emulator:
        emulator.run(0.1)
        engine.data.qvel[engine.model.joint("index").dofadr[0]] = np.nan
        with pytest.raises(PoseError, match=r"MuJoCo's state is not finite at 0\.1.* s \(joints: .*index"):
            emulator.run(0.1)
