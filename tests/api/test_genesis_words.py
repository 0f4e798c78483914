"""Our names, and Genesis's words for them: one table, applied where ``names="genesis"`` is asked for."""

import ast
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tactemu as tt
from tactemu.base.errors import SceneError
from tactemu.base.option_groups import defaults
from tactemu.base.words import GENESIS, in_our_words, quaternion_of_euler
from tactemu.geometry import rotation
from tactemu.scene.building import build_scene, make_devices
from tactemu.scene.file import parse
from tactemu.sensors.sensor_model import SensorModel

ROOT = Path(__file__).parents[2]
GRID = np.stack([*np.meshgrid(np.linspace(-4e-3, 4e-3, 4), np.linspace(-4e-3, 4e-3, 3)), np.full((3, 4), 0.005)], -1)
TURN = quaternion_of_euler((0, 0, 90))


def readings(scene: Any, skin: Any, words: dict[str, str]) -> np.ndarray:
    """Three readings of four environments, set by keywords in these words."""
    sim: Any = scene.build(n_envs=4, seed=3)
    found = []
    for step in range(3):
        pose = {words["quat"]: (1, 0, 0, 0), "position": (0, 0, 0.0145 + 1e-4 * step), words["envs"]: [0, 2]}
        sim.set_pose("ball", **pose)
        sim.step()
        skin.set_bias(0.5, **{words["envs"]: [1]})
        skin.set(words["gain"], 1.5, **{words["envs"]: [2]})
        found.append(np.concatenate(skin.read(), axis=-1))
    sim.reset(**{words["envs"]: [3]})
    return np.array(found)


def test_a_scene_in_genesis_words_reads_the_same():
    ours: Any = tt.Scene(dt=1e-3)
    pad = ours.add_body(tt.Box(size=(0.02, 0.02, 0.01)), fixed=True, position=(0, 0, 0), quaternion=TURN)
    ours.add_body(tt.Sphere(radius=0.01), name="ball", position=(0, 0, 1))
    model = tt.KinematicTaxel(
        positions=GRID, normals=(0, 0, 1), radius=1e-3, position=(1e-3, 0, 0), quaternion=TURN, sense="ball",
        depth_query="sdf", normal_stiffness=400.0, adjustable=("bias", "gain"),
        imperfections=tt.ImperfectionOptions(gain=1.1, radius_noise=1e-5),
        electronics=tt.ElectronicsOptions(noise=1e-3),
    )  # fmt: skip
    skin = ours.add_sensor(model, link=pad, name="skin")
    first = readings(ours, skin, {"quat": "quaternion", "envs": "envs", "gain": "gain"})

    theirs: Any = tt.Scene(dt=1e-3, names="genesis")
    pad = theirs.add_body(tt.Box(size=(0.02, 0.02, 0.01)), fixed=True, pos=(0, 0, 0), euler=(0, 0, 90))
    theirs.add_body(tt.Sphere(radius=0.01), name="ball", pos=(0, 0, 1))
    skin = theirs.add_sensor(
        tt.KinematicTaxel, entity_idx=pad.index, link_idx_local=0, name="skin", probe_local_pos=GRID,
        probe_local_normal=(0, 0, 1), probe_radius=1e-3, pos_offset=(1e-3, 0, 0), euler_offset=(0, 0, 90),
        track_link_idx="ball", contact_depth_query="sdf", normal_stiffness=400.0, adjustable=("bias", "gain"),
        probe_gain=1.1, probe_radius_noise=1e-5, noise=1e-3,
    )  # fmt: skip
    second = readings(theirs, skin, {"quat": "quat", "envs": "envs_idx", "gain": "probe_gain"})
    assert np.abs(first).max() > 0 and np.array_equal(first, second)


def test_a_clone_takes_the_words_of_its_simulation():
    scene: Any = tt.Scene(names="genesis")
    pad = scene.add_body(tt.Box(size=(0.02, 0.02, 0.01)), fixed=True)
    scene.add_body(tt.Sphere(radius=0.01), name="ball")
    scene.add_sensor(tt.ContactDepthProbe, link=pad, probe_radius=1e-3, adjustable=("bias",))
    clone = scene.build(n_envs=2).clone()
    clone.set_pose("ball", pos=(0, 0, 0.5), envs_idx=[1])
    clone.sensors[0].set_bias(0.5, envs_idx=[1])
    clone.step()
    pressed, lifted = clone.sensors[0].read().ravel()
    assert pressed > 0 and lifted == 0.5


def test_our_words_hold_in_a_scene_of_genesis_words():
    scene: Any = tt.Scene(names="genesis")
    pad = scene.add_body(None, name="pad", position=(0, 0, 1))
    skin = scene.add_sensor(tt.ContactDepthProbe(radius=2e-3), link=pad)
    assert pad.position == (0, 0, 1) and skin.model.radius == 2e-3


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda scene: scene.add_body(None, pos=(0, 0, 0)), "'pos'; 'pos' is Genesis's word for 'position'"),
        (lambda scene: scene.add_body(None, positions=(0, 0, 0)), "'positions'; did you mean 'position'"),
        (lambda scene: scene.add_sensor(tt.ContactProbe(), entity_idx=0), "'entity_idx' is Genesis's word for 'link'"),
        (lambda scene: scene.build().set_pose(0, quat=(1, 0, 0, 0)), "'quat' is Genesis's word for 'quaternion'"),
        (lambda scene: scene.build().reset(envs_idx=[0]), "'envs_idx' is Genesis's word for 'envs'"),
        (lambda scene: scene.skin.set_bias(1.0, envs_idx=[0]), "'envs_idx' is Genesis's word for 'envs'"),
        (lambda scene: tt.ContactProbe(probe_local_pos=GRID), "'probe_local_pos' is Genesis's word for 'positions'"),  # type: ignore[call-arg]
        (lambda scene: tt.ContactProbe(probe_gain=2.0), "imperfections=ImperfectionOptions(gain=...)"),  # type: ignore[call-arg]
        (lambda scene: tt.ElectronicsOptions(probe_gain=2.0), "no option 'probe_gain'"),  # type: ignore[call-arg]
    ],
)
def test_without_names_the_message_says_our_word(call, message):
    scene: Any = tt.Scene()
    pad = scene.add_body(None, name="pad")
    scene.skin = scene.add_sensor(tt.ContactDepthProbe(), link=pad)
    with pytest.raises(TypeError, match=re.escape(message)):
        call(scene)


def test_wrong_words_in_a_scene_of_genesis_words():
    scene: Any = tt.Scene(names="genesis")
    pad = scene.add_body(None, name="pad")
    with pytest.raises(TypeError, match=r"Scene.add_body has no argument 'position_'; did you mean 'position'"):
        scene.add_body(None, position_=(0, 0, 0))
    with pytest.raises(SceneError, match="ContactProbe has no 'probe_local_positions'"):
        scene.add_sensor(tt.ContactProbe, link=pad, probe_local_positions=GRID)
    with pytest.raises(SceneError, match="position is given twice, also as 'pos'"):
        scene.add_body(None, pos=(0, 0, 0), position=(0, 0, 0))
    with pytest.raises(SceneError, match=r"euler: expected three angles \[degrees\], got \(1, 2\)"):
        scene.add_body(None, euler=(1, 2))
    with pytest.raises(SceneError, match="euler: angles have no order"):
        scene.add_body(None, euler=(0, 0, 90), order="xyzw")
    with pytest.raises(SceneError, match="link_idx_local: a body has one link, so it can only be 0, got 1"):
        scene.add_sensor(tt.ContactProbe, entity_idx=0, link_idx_local=1)
    with pytest.raises(SceneError, match="Scene: names must be one of tactemu, genesis, got 'mujoco'"):
        tt.Scene(names="mujoco")  # type: ignore[arg-type]


def test_a_class_is_a_model_in_genesis_words_only():
    scene: Any = tt.Scene()
    pad = scene.add_body(None, name="pad")
    with pytest.raises(SceneError, match="expected a sensor such as"):
        scene.add_sensor(tt.ContactProbe, link=pad)


def test_angles_turn_about_fixed_axes():
    for degrees in ((30, 0, 0), (0, -40, 0), (0, 0, 200), (10, 20, 30), (-170, 80, 5)):
        expected = np.eye(3)
        for axis, angle in zip(np.eye(3), np.radians(degrees)):
            expected = rotation.matrix(rotation.from_rotation_vector(axis * angle)) @ expected
        assert np.allclose(rotation.matrix(quaternion_of_euler(degrees)), expected, atol=1e-12)


SCENE = """
[scene]
names = "genesis"
[[body]]
name = "pad"
shape = "frame"
pos = [0.0, 0.0, 0.1]
euler = [0.0, 0.0, 90.0]
[[skin]]
device = "anyskin"
link = "pad"
pos = [0.0, 0.0, 0.01]
options = { probe_radius = 0.002, contact_depth_query = "ray", noise = 0.1, probe_gain = 1.5 }
[[scenario]]
at = 1.0
set = { probe_gain = 0.5 }
"""


def test_a_scene_file_in_genesis_words():
    loaded = parse(SCENE)
    scene, skins = build_scene(loaded, make_devices(loaded))
    model = skins["anyskin"].model
    assert scene.bodies[0].position == (0, 0, 0.1) and np.allclose(scene.bodies[0].quaternion, TURN)
    assert (model.radius, model.depth_query, model.imperfections.gain) == (0.002, "ray", 1.5)
    assert loaded.tables.skin[0].position == (0, 0, 0.01) and loaded.tables.scenario[0].set == {"gain": 0.5}


def test_a_scene_file_without_names_says_our_word():
    plain = SCENE.replace('names = "genesis"', "")
    with pytest.raises(SceneError, match="unknown key 'pos'; 'pos' is Genesis's word for 'position'"):
        parse(plain)
    loaded = parse(re.sub(r"(?m)^(pos|euler) = .*$", "", plain))
    with pytest.raises(SceneError, match="'probe_radius' is Genesis's word for 'radius'"):
        build_scene(loaded, make_devices(loaded))


def test_no_signature_has_a_word_of_genesis():
    words = set(GENESIS) | {"link_idx_local"}
    for path in (ROOT / "tactemu").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.arguments):
                named = {each.arg for each in (*node.posonlyargs, *node.args, *node.kwonlyargs)}
                assert not named & (words - {"pos", "quat"}), path
    assert not set(defaults(SensorModel)) & words


def test_each_word_is_in_the_table_of_the_page():
    page = (ROOT / "docs" / "coming-from.md").read_text(encoding="utf-8")
    for word, ours in GENESIS.items():
        assert re.search(rf"^\|[^|]*`{word}`[^|]*\|[^|]*`{ours}`", page, re.M), word
    assert in_our_words({"draw_debug": True}) == {"draw_debug": True}
