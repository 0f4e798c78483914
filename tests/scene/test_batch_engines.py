"""Simulators of many environments: poses and velocities judged by MuJoCo's own kinematics, steps by its own steps."""

from pathlib import Path

import numpy as np
import pytest
import warp as wp

import tactemu as tt
from tactemu.base.errors import PoseError, SceneError
from tactemu.scene.engine_tables import MujocoWarpTable, NewtonTable
from tests.scene.engine_models import BUILT, DROP, ENGINES, FINGER, NEEDS_ENGINES

mujoco = pytest.importorskip("mujoco")
pytestmark = NEEDS_ENGINES

HAND = Path(__file__).parents[2] / "examples" / "hands" / "ability_hand_motors.xml"
MOTORS = {"index": 1.4, "middle": 1.4, "ring": 1.4, "pinky": 1.4, "thumb_flexor": 1.0, "thumb_rotator": -0.2}
N_ENVS = 3
LINE = np.stack([np.linspace(-8e-3, 8e-3, 5), np.zeros(5), np.full(5, 0.0)], -1)
BODIES = "palm", "tip", "ball"


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "finger.xml"
    path.write_text(FINGER)
    return path


@pytest.fixture
def drop(tmp_path):
    path = tmp_path / "drop.xml"
    path.write_text(DROP)
    return path


def states(model) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities of all joints, different in each environment."""
    rng = np.random.default_rng(0)
    qpos = model.qpos0 + 0.3 * rng.normal(size=(N_ENVS, model.nq))
    for start in (3, 11):
        qpos[:, start : start + 4] /= np.linalg.norm(qpos[:, start : start + 4], axis=1, keepdims=True)
    return qpos, rng.normal(size=(N_ENVS, model.nv))


def truth(model) -> np.ndarray:
    """Pose, velocity and turning of each geom in each environment, by finite differences of MuJoCo's kinematics."""
    data, h = mujoco.MjData(model), 1e-5
    geoms = [model.geom(name).id for name in BODIES]
    rows = np.zeros((N_ENVS, len(geoms), 13))
    for e, (qpos, qvel) in enumerate(zip(*states(model))):
        places, turns = [], []
        for time in (-h, 0.0, h):
            data.qpos[:] = qpos
            mujoco.mj_integratePos(model, data.qpos, qvel, time)
            mujoco.mj_kinematics(model, data)
            places.append(data.geom_xpos[geoms].copy())
            turns.append(data.geom_xmat[geoms].reshape(-1, 3, 3).copy())
        rows[e, :, :3], rows[e, :, 7:10] = places[1], (places[2] - places[0]) / (2 * h)
        spin = (turns[2] - turns[0]) / (2 * h) @ turns[1].transpose(0, 2, 1)
        rows[e, :, 10:] = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], -1)
        for k, turn in enumerate(turns[1]):
            mujoco.mju_mat2Quat(rows[e, k, 3:7], turn.reshape(-1))
    return rows


def compare(sim, carriers, model) -> None:
    found, expected = sim.pose_array.numpy()[:, [body.index for body in carriers]], truth(model)
    np.testing.assert_allclose(found[..., :3], expected[..., :3], atol=2e-6)
    same = np.abs((found[..., 3:7] * expected[..., 3:7]).sum(-1))
    np.testing.assert_allclose(same, 1.0, atol=1e-6)
    np.testing.assert_allclose(found[..., 7:], expected[..., 7:], atol=3e-5)


@pytest.fixture(autouse=True)
def on_the_cpu():
    """Have engines that take Warp's default device use the simulation's, on a machine with a GPU, too."""
    with wp.ScopedDevice("cpu"):
        yield


def test_poses_of_mujoco_warp(file):
    import mujoco_warp

    model = mujoco.MjModel.from_xml_path(str(file))
    scene = tt.Scene()
    source = tt.MujocoSource(scene, model)
    carriers = [source.geom(name) for name in BODIES]
    scene.add_sensor(tt.KinematicTaxel(positions=LINE, normal_damping=1.0), link=carriers[0])
    sim = scene.build(N_ENVS)
    data = mujoco_warp.make_data(model, nworld=N_ENVS)
    for array, values in zip((data.qpos, data.qvel), states(model)):
        array.assign(values.astype(np.float32))
    on_device = mujoco_warp.put_model(model)
    for refresh in (mujoco_warp.kinematics, mujoco_warp.com_pos, mujoco_warp.com_vel):
        refresh(on_device, data)
    source.bind(sim, data)
    sim.step()
    compare(sim, carriers, model)


def test_poses_of_newton(file):
    import newton

    builder, worlds = newton.ModelBuilder(), newton.ModelBuilder()
    builder.add_mjcf(str(file))
    worlds.replicate(builder, N_ENVS)
    theirs = worlds.finalize(device="cpu")
    scene = tt.Scene()
    source = tt.NewtonSource(scene, theirs)
    carriers = [source.shape(name) for name in BODIES]
    scene.add_sensor(tt.KinematicTaxel(positions=LINE, normal_damping=1.0), link=carriers[0])
    sim = scene.build(N_ENVS)
    state, model = theirs.state(), mujoco.MjModel.from_xml_path(str(file))
    q, qd = as_newton(model, *states(model))
    theirs.joint_q.assign(q)
    theirs.joint_qd.assign(qd)
    newton.eval_fk(theirs, theirs.joint_q, theirs.joint_qd, state)
    source.bind(sim, state)
    sim.step()
    compare(sim, carriers, model)


def as_newton(model, qpos, qvel) -> tuple[np.ndarray, np.ndarray]:
    """MuJoCo's joints in Newton's convention: quaternions (x, y, z, w); a free joint's velocity is in the world, of the
    centre of mass."""
    q, qd = qpos.copy(), qvel.copy()
    data = mujoco.MjData(model)
    for joint in range(model.njnt):
        if model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE:
            continue
        at, speed = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
        body = model.jnt_bodyid[joint]
        q[:, at + 3 : at + 7] = qpos[:, [at + 4, at + 5, at + 6, at + 3]]
        for e in range(len(qpos)):
            data.qpos[:] = qpos[e]
            mujoco.mj_kinematics(model, data)
            turn = data.xmat[body].reshape(3, 3)
            spin = turn @ qvel[e, speed + 3 : speed + 6]
            qd[e, speed : speed + 3] += np.cross(spin, turn @ model.body_ipos[body])
            qd[e, speed + 3 : speed + 6] = spin
    return q.reshape(-1).astype(np.float32), qd.reshape(-1).astype(np.float32)


def held(drop, kind: str, n_envs: int | None = N_ENVS):
    """A ball that falls on a skin on the floor: ``(engine, sim, skin)``."""
    scene = tt.Scene(dt=4e-3)
    engine = ENGINES[kind](scene, drop)
    model = tt.KinematicTaxel(positions=LINE, radius=5e-3)
    skin = scene.add_sensor(model, link=engine.body_of("floor", "skin"))
    return engine, scene.build(n_envs), skin


@pytest.mark.nightly
@pytest.mark.parametrize("kind", ["mujoco-warp", "newton"])
def test_an_engine_steps_as_mujoco_does(drop, kind):
    model = mujoco.MjModel.from_xml_path(str(drop))
    data = mujoco.MjData(model)
    engine, sim, skin = held(drop, kind)
    ball = next(body for body in engine.bodies if body.name == "ball")
    start = sim.pose_array.numpy()[:, ball.index].copy()
    np.testing.assert_allclose(start[:, :3], [[0, 0, 0.02]] * N_ENVS, atol=1e-6)
    for step in range(100):
        sim.step()
        for _ in range(2):
            mujoco.mj_step(model, data)
        if step in (5, 99):
            mujoco.mj_kinematics(model, data)
            found = sim.pose_array.numpy()[:, ball.index, :3]
            np.testing.assert_allclose(found, [data.geom("ball").xpos] * N_ENVS, atol=2e-5)
    force = skin.read().force
    assert (force[:, 2, 2] < -1.0).all() and (force == force[:1]).all()

    saved = sim.state()
    sim.reset(np.array([False, True, False]))
    sim.step()
    fell = sim.pose_array.numpy()[:, ball.index, 2]
    assert fell[1] > 0.019 and (fell[[0, 2]] < 0.0101).all()
    sim.prepare_restore(saved)()
    sim.step()
    after = sim.pose_array.numpy().copy()
    sim.prepare_restore(saved)()
    sim.step()
    np.testing.assert_array_equal(sim.pose_array.numpy(), after)


def hand(kind: str, device: str = "cpu"):
    """The hand above its ball, which is told to close: ``(engine, sim, skins)``."""
    scene = tt.Scene(dt=4e-3)
    engine = ENGINES[kind](scene, HAND)
    pad = np.stack([*np.meshgrid(np.linspace(-5e-3, 5e-3, 6), np.linspace(-8e-3, 8e-3, 6)), np.full((6, 6), 4e-3)], -1)
    felt = (engine.source.body_of("object").index,)
    model = tt.KinematicTaxel(positions=pad, radius=1.5e-3, normal_stiffness=200.0, sense=felt)
    skins = [scene.add_sensor(model, link=engine.source.body_of(tip)) for tip in ("index_tip", "thumb_tip")]
    sim = scene.build(2, device=device)
    if kind == "newton":
        orders = engine.control.joint_target_q.reshape((2, -1))
        told = orders.numpy()
        told[:, [engine.source.column(joint) for joint in MOTORS]] = list(MOTORS.values())
    else:
        orders, told = engine.data.ctrl, np.tile(np.array(list(MOTORS.values()), np.float32), (2, 1))
    orders.assign(told)
    return engine, sim, skins


@pytest.mark.nightly
def test_a_hand_closes_on_a_ball_alike():
    """With either engine, and as MuJoCo's own steps close it; fingers that meet nothing stop where they are told."""
    model = mujoco.MjModel.from_xml_path(str(HAND))
    data = mujoco.MjData(model)
    data.ctrl[:] = list(MOTORS.values())
    mujoco.mj_step(model, data, 300)
    angles, forces, contacts = {}, {}, {}
    for kind in ENGINES:
        engine, sim, skins = hand(kind)
        columns = [engine.source.column(joint) for joint in MOTORS]
        contacts[kind] = engine.solver.mjw_data if kind == "newton" else engine.data
        for _ in range(150):
            sim.step()
        angles[kind] = engine.positions.numpy()[:, columns].copy()
        forces[kind] = [np.abs(skin.read().force[..., 2]).sum((1, 2)) for skin in skins]
        contacts[kind] = contacts[kind].nacon.numpy()[0]
        for found in angles[kind]:
            np.testing.assert_allclose(found, [data.joint(joint).qpos[0] for joint in MOTORS], atol=4e-3)
            np.testing.assert_allclose(found[1:4], 1.4, atol=4e-3)
    np.testing.assert_allclose(angles["newton"], angles["mujoco-warp"], atol=2e-3)
    np.testing.assert_allclose(forces["newton"], forces["mujoco-warp"], rtol=0.02)
    assert np.min(forces["newton"]) > 1.0
    assert contacts["newton"] == contacts["mujoco-warp"], "pairs that are apart take no room"


@pytest.mark.nightly
@pytest.mark.parametrize("kind", ENGINES)
def test_contacts_for_which_there_is_no_room_are_said(tmp_path, kind, caplog):
    """Once, with what to give more of; nothing is said where there is room."""
    balls = "".join(
        f'<body pos="{0.05 * k} 0 0.02"><freejoint/><geom type="sphere" size=".01" mass=".1"/></body>' for k in range(3)
    )
    path = tmp_path / "balls.xml"
    path.write_text(DROP.replace("</worldbody>", balls + "</worldbody>"))
    table = {"mujoco-warp": MujocoWarpTable, "newton": NewtonTable}[kind]
    for nconmax, njmax, said in ((8, 64, []), (2, 64, ["contacts"]), (8, 6, ["constraints"])):
        scene = tt.Scene(dt=4e-3)
        engine = ENGINES[kind](scene, path, table(kind=kind, file="balls.xml", nconmax=nconmax, njmax=njmax))
        scene.add_sensor(tt.ContactDepthProbe(positions=LINE), link=engine.body_of("floor", "skin"))
        sim = scene.build(2)
        caplog.clear()
        for _ in range(20):
            sim.step()
        sim.check()
        told = [record.getMessage() for record in caplog.records if "engine: " in record.getMessage()]
        assert len(told) == len(said)
        for words, what in zip(told, said):
            option, room = ("nconmax", nconmax) if what == "contacts" else ("njmax", njmax)
            assert f"more {what} at once" in words and f"`{option}`" in words and f"room for {room}" in words


@pytest.mark.nightly
@pytest.mark.parametrize("kind", ["mujoco-warp", "newton"])
def test_an_engine_runs_long_without_a_leak(drop, kind):
    _engine, sim, skin = held(drop, kind)
    memory = []
    for step in range(10_000):
        sim.step()
        if step % 1000 == 999:
            skin.read()
            with open("/proc/self/statm") as file:
                memory.append(int(file.read().split()[1]) * 4096)
    assert memory[-1] - memory[1] < 4e6


@pytest.mark.parametrize("kind", ENGINES)
def test_where_the_numbers_of_a_joint_are(file, kind):
    engine = ENGINES[kind](tt.Scene(dt=4e-3), file)
    source, model = engine.source, mujoco.MjModel.from_xml_path(str(file))
    assert source.column("bend") == model.joint("bend").qposadr[0] == 7
    assert source.free_bodies == {"hand": 0, "ball": 8} and source.column("ball") == 8
    assert [source.root(name) for name in ("tip", "finger", "palm", "ball")] == ["hand", "hand", "hand", "ball"]
    for name, start in (("hand", 0), ("ball", 8)):
        np.testing.assert_allclose(np.concatenate(engine.start_of(name)), model.qpos0[start : start + 7], atol=1e-6)
    with pytest.raises(SceneError, match=r"no joint or free body 'bent'.*bend"):
        source.column("bent")


def test_a_skin_feels_neither_what_moves_with_it_nor_what_its_joint_is_on(tmp_path):
    """As in MuJoCo: bodies without a joint are part of the body that carries them."""
    nail = (
        '<body name="pad"><geom name="pad" size=".01"/><body name="nail"><geom name="nail" size=".01"/></body></body>'
    )
    path = tmp_path / "welded.xml"
    path.write_text(
        FINGER.replace('name="tip" type="capsule"', 'name="bone" type="capsule"').replace(
            "</body>", nail + "</body>", 1
        )
    )
    ignored = {}
    for kind, engine in ENGINES.items():
        scene = tt.Scene(dt=4e-3)
        source = engine(scene, path).source
        ignored[kind] = {
            name: {scene.bodies[k].name for k in source.ignored_bodies(name)} for name in ("nail", "palm", "ball")
        }
    assert ignored["newton"] == ignored["mujoco-warp"]
    assert ignored["newton"]["nail"] == {"palm", "bone", "pad", "nail"} and ignored["newton"]["ball"] == {"ball"}


@pytest.mark.parametrize("kind", BUILT)
def test_bodies_start_where_each_environment_has_them(drop, kind):
    rng = np.random.default_rng(1)
    places, turns = rng.normal(size=(5, 3)), rng.normal(size=(5, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    scene = tt.Scene(dt=4e-3)
    engine = ENGINES[kind](scene, drop)
    engine.starts = {"ball": (places, turns)}
    scene.add_sensor(tt.ContactDepthProbe(positions=LINE), link=engine.body_of("floor", "skin"))
    sim = scene.build(2, first_env=3)
    ball = next(body for body in engine.bodies if body.name == "ball")

    def check():
        found = sim.pose_array.numpy()[:, ball.index]
        np.testing.assert_allclose(found[:, :3], places[3:], atol=1e-6)
        np.testing.assert_allclose(np.abs((found[:, 3:7] * turns[3:]).sum(1)), 1.0, atol=1e-6)

    check()
    began = engine.positions.numpy().copy()
    engine.positions.fill_(0.0)
    sim.reset([1])
    np.testing.assert_array_equal(engine.positions.numpy(), began * [[0], [1]])
    sim.reset()
    np.testing.assert_array_equal(engine.positions.numpy(), began)
    with pytest.raises(SceneError, match=r"up to 5, got \(5, 3\) and \(5, 4\)"):
        scene.build(2, first_env=4)
    engine.starts = {"bal": (places, turns)}
    with pytest.raises(SceneError, match=r"no free body 'bal'; did you mean 'ball'"):
        scene.build(2)


def test_a_model_that_blows_up_is_said(file):
    import mujoco_warp

    model = mujoco.MjModel.from_xml_path(str(file))
    scene = tt.Scene()
    source = tt.MujocoSource(scene, model)
    skin = scene.add_sensor(tt.ContactDepthProbe(positions=LINE), link=source.geom("palm"))
    sim = scene.build(N_ENVS)
    data = mujoco_warp.make_data(model, nworld=N_ENVS)
    source.bind(sim, data)
    sim.step()
    places = data.xpos.numpy()
    places[1, 2] = np.nan
    data.xpos.assign(places)
    with pytest.raises(PoseError, match="'tip'"):
        sim.step()
    depths = skin.read()
    assert np.isnan(depths[1]).all() and np.isfinite(depths[[0, 2]]).all()
