"""A skin on a MuJoCo body feels MuJoCo's geoms: as the same scene posed by hand, and as mechanics demands."""

import numpy as np
import pytest

import tactemu as tt
from tactemu.base.errors import SceneError

mujoco = pytest.importorskip("mujoco")

PRESS = """
<mujoco>
  <option timestep="0.001" gravity="0 0 -9.81"/>
  <asset><mesh name="tetra" vertex="0 0 0  0.02 0 0  0 0.02 0  0 0 0.02"/></asset>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 0.1" pos="0 0 -1"/>
    <body name="pad" pos="0.1 0.2 0.3" euler="10 20 30">
      <joint name="turn" type="hinge" axis="0 0 1"/>
      <geom name="top" type="box" size="0.02 0.02 0.01" pos="0 0 0.005" contype="0" conaffinity="1" mass="1"/>
    </body>
    <body name="ball" pos="0 0 2">
      <freejoint/>
      <geom name="ball" type="sphere" size="0.01" mass="0.1"/>
    </body>
    <body name="extras" pos="0 0 3">
      <freejoint/>
      <geom name="rod" type="capsule" size="0.005 0.02"/>
      <geom name="can" type="cylinder" size="0.005 0.02" pos="0.1 0 0"/>
      <geom name="egg" type="ellipsoid" size="0.01 0.02 0.015" pos="0.2 0 0"/>
      <geom name="stone" type="mesh" mesh="tetra" pos="0.3 0 0"/>
    </body>
  </worldbody>
</mujoco>
"""
LINE = np.stack([np.linspace(-8e-3, 8e-3, 5), np.zeros(5), np.full(5, 0.01)], -1)


def rotate(q, v):
    t = 2 * np.cross(q[1:], v)
    return v + q[0] * t + np.cross(q[1:], t)


@pytest.fixture
def model():
    return mujoco.MjModel.from_xml_string(PRESS)


def test_reads_what_the_same_scene_posed_by_hand_reads(model):
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    q, at = np.array(data.geom("top").xmat), data.geom("top").xpos.copy()
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, q)
    ball = model.joint(1).qposadr[0]
    data.qpos[ball : ball + 3] = at + rotate(quaternion, np.array([1e-3, 0, 0.019]))
    speed = model.joint(1).dofadr[0]
    data.qvel[speed : speed + 6] = (0.3, -0.2, 0.1, 1.0, 2.0, 3.0)
    data.qvel[0] = 2.0

    scene = tt.Scene()
    source = tt.MujocoSource(scene, model)
    options = {"positions": LINE, "radius": 1e-3, "normal_damping": 5.0}
    skin = scene.add_sensor(tt.KinematicTaxel(**options), link=source.geom("top"))
    sim = scene.build()
    source.update(sim, data)
    sim.step()

    by_hand = tt.Scene()
    pad, sphere = by_hand.add_body(name="pad"), by_hand.add_body(tt.Sphere(radius=0.01))
    expected = by_hand.add_sensor(tt.KinematicTaxel(**options), link=pad)
    other = by_hand.build()
    axis = rotate(np.array(data.xquat[model.body("pad").id]), np.array([0, 0, 1.0]))
    lever = at - data.body("pad").xpos
    other.set_pose(
        pad, position=at, quaternion=quaternion, angular_velocity=2 * axis, linear_velocity=np.cross(2 * axis, lever)
    )
    local = data.qpos[ball + 3 : ball + 7]
    other.set_pose(
        sphere,
        position=data.qpos[ball : ball + 3],
        quaternion=local,
        linear_velocity=(0.3, -0.2, 0.1),
        angular_velocity=rotate(local, np.array([1.0, 2.0, 3.0])),
    )
    other.step()
    assert np.abs(skin.read().force).max() > 1
    for ours, theirs in zip(skin.read(), expected.read()):
        assert np.abs(ours - theirs).max() < 1e-5 * np.abs(theirs).max()


def test_poses_are_those_after_the_step(model):
    data = mujoco.MjData(model)
    data.qvel[model.joint(1).dofadr[0] + 2] = -5.0
    scene = tt.Scene(dt=model.opt.timestep)
    source = tt.MujocoSource(scene, model, geoms=["top", "ball"])
    scene.add_sensor(tt.ContactDepthProbe(), link=source.geom("top"))
    sim = scene.build()
    mujoco.mj_step(model, data)
    stale = data.geom("ball").xpos.copy()
    source.update(sim, data)
    at = sim._world.download()[0, source.geom("ball").index, :3]
    assert at == pytest.approx(data.qpos[model.joint(1).qposadr[0] :][:3]) and at[2] < stale[2] - 4e-3


@pytest.mark.parametrize(
    ("geom", "point", "depth"),
    [
        ("rod", (0, 0, 0.024), 1e-3 + 1e-3),
        ("can", (0, 0, 0.021), 0.0),
        ("can", (0, 0, 0.0195), 1e-3 + 0.5e-3),
        ("egg", (0, 0.019, 0), 1e-3 + 1e-3),
        ("floor", (0, 0, -0.01), 1e-3 + 10e-3),
    ],
)
def test_every_kind_of_geom_has_its_shape(model, geom, point, depth):
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    scene = tt.Scene()
    source = tt.MujocoSource(scene, model)
    link = scene.add_body(name="probe")
    probe = scene.add_sensor(
        tt.ContactDepthProbe(positions=[[0, 0, 0]], radius=1e-3, sense=source.geom(geom)),
        link=link,
    )
    sim = scene.build()
    source.update(sim, data)
    turn = data.geom(geom).xmat.reshape(3, 3)
    sim.set_pose(link, position=data.geom(geom).xpos + turn @ np.array(point))
    sim.step()
    assert probe.read()[0] == pytest.approx(depth, abs=2e-5)


def test_a_mesh_lies_where_mujoco_has_it(model):
    """MuJoCo moves a mesh's frame to its centre; its corner must still be where the file has it."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    scene = tt.Scene()
    source = tt.MujocoSource(scene, model)
    link = scene.add_body(name="probe")
    stone = source.geom("stone")
    probe = scene.add_sensor(tt.ContactDepthProbe(positions=[[0, 0, 0]], radius=1e-3, sense=stone), link=link)
    sim = scene.build()
    source.update(sim, data)
    corner = data.body("extras").xpos + np.array([0.3, 0, 0])
    for point, depth in (((0, 0, 0), 1e-3), ((0.005, 0.005, -0.0005), 0.5e-3), ((0.004, 0.004, 0.004), 5e-3)):
        sim.set_pose(link, position=corner + np.array(point))
        sim.step()
        assert probe.read()[0] == pytest.approx(depth, abs=2e-6)


def test_a_ball_at_rest_on_the_pad_presses_down():
    xml = """
    <mujoco><option timestep="0.002"/><worldbody>
      <geom name="pad" type="box" size="0.02 0.02 0.01"/>
      <body pos="0 0 0.0205"><freejoint/><geom name="ball" type="sphere" size="0.01" mass="0.05"/></body>
    </worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    scene = tt.Scene(dt=model.opt.timestep)
    source = tt.MujocoSource(scene, model)
    grid = np.stack([*np.meshgrid(np.linspace(-4e-3, 4e-3, 9), np.linspace(-4e-3, 4e-3, 9)), np.full((9, 9), 0.01)], -1)
    model_options = {"positions": grid, "radius": 2e-4, "normal_damping": 0.0}
    skin = scene.add_sensor(tt.KinematicTaxel(**model_options, shear_scalar=0.0), link=source.geom("pad"))
    sim = scene.build()
    for _ in range(400):
        mujoco.mj_step(model, data)
        source.update(sim, data)
        sim.step()
    force = skin.read().force
    assert force[4, 4, 2] < 0 and force[..., 2].min() == force[4, 4, 2]
    assert force[0, 0, 2] == 0
    assert data.ncon == 1 and np.abs(force.sum((0, 1))[:2]).max() < 1e-3 * -force[4, 4, 2]


def test_one_data_per_environment(model):
    datas = [mujoco.MjData(model) for _ in range(3)]
    scene = tt.Scene()
    source = tt.MujocoSource(scene, model, geoms=["ball"])
    link = source.link("pad")
    skin = scene.add_sensor(tt.ContactDepthProbe(positions=[[0, 0, 0]], radius=1e-3), link=link)
    sim = scene.build(3)
    ball = model.joint(1).qposadr[0]
    for depth, data in zip((0.0, 1e-3, 2e-3), datas):
        mujoco.mj_forward(model, data)
        data.qpos[ball : ball + 3] = data.body("pad").xpos + np.array([0, 0, 0.01 - depth])
    source.update(sim, datas)
    sim.step()
    assert skin.read()[:, 0] == pytest.approx([1e-3, 2e-3, 3e-3], abs=1e-8)
    assert source.geoms_of("pad") == [] and source.geoms_of("ball") == [source.geom("ball")]
    with pytest.raises(SceneError, match="expected 1 or 3 MjData, got 2"):
        source.update(sim, datas[:2])


def test_unknown_names_are_answered_with_those_there_are(model):
    source = tt.MujocoSource(tt.Scene(), model, geoms=["ball"])
    with pytest.raises(
        SceneError, match=r"the MuJoCo model has no geom 'bal'; did you mean 'ball'\? \(geoms: floor, top, ball"
    ):
        source.geom("bal")
    with pytest.raises(SceneError, match=r"'top' is not in the scene \(geoms: ball"):
        source.geom("top")
    with pytest.raises(SceneError, match="no body 'palm'"):
        source.link("palm")
