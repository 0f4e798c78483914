"""Mistakes in joints, motors and models of a closed loop are reported before a port opens."""

import pytest

from tactemu.base.errors import SceneError
from tactemu.scene import file
from tests.hands.closed_loop import L6, made, replaced
from tests.hands.holding import scene_of

JOINT = 'index = "index",'


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            JOINT,
            'index2 = "index",',
            r"joints: linker_hand_l6 has no motor 'index2'; did you mean 'index'\? \(motors: thumb_flex",
        ),
        (JOINT, 'index = "index2",', r"joints: the model has no joint 'index2'; did you mean 'index'\?"),
        (JOINT, 'index = "middle",', "two motors on joint 'middle'; give it one motor only"),
        (JOINT, 'index = { joint = "index", ratio = 0.0 },', "ratio: expected a number that is not 0"),
        (
            JOINT,
            'index = { joint = "index", ratio = 40.0 },',
            "joint 'index' moves from 0 to 1.6 rad, its motor over 64 rad",
        ),
        ("friction = 0.8", 'friction = "much"', "engine.friction"),
        ("friction = 0.8", "breaks = { ball = 1.0 }", "breaks: no geom 'ball'"),
        ("friction = 0.8", 'on_late = "never"', "engine.on_late"),
        ('device = "linker_hand_l6"', 'device = "anyskin"', "joints: anyskin has no motors that an engine can move"),
        ('body = "index_tip"', 'body = "index_tp"', "no geom or body 'index_tp'; geoms:"),
    ],
)
def test_a_mistake_is_said_before_a_port_opens(old, new, said, tmp_path):
    with pytest.raises(SceneError, match=said):
        made(replaced(tmp_path, old, new))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            'angle="radian"',
            'angle="degree"',
            r"from 0 to 0\.020944 rad, its motor over 1\.2 rad: are these radians in a file of degrees",
        ),
        ('range="0 1.6"/>', 'range="0 90"/>', "from 0 to 90 rad, its motor over 1.6 rad: are these degrees"),
        ("</worldbody>", '</worldbody><actuator><motor name="m" joint="index"/></actuator>', "already has an actuator"),
        ('<joint name="index" range="0 1.6"/>', '<joint name="index" type="ball"/>', "is neither a hinge nor a slide"),
    ],
)
def test_a_mistake_in_the_model_is_said(old, new, said, tmp_path):
    scene = scene_of(L6, "ball", tmp_path)
    model = tmp_path / "linker_l6_ball.xml"
    path = model.read_text().split('"')[1]
    source = open(path).read()
    assert old in source
    if "ball" in new:
        source = source.replace(
            '<joint joint1="index_outer" joint2="index" polycoef="0 0.5 0 0 0" solref="0.005 1"/>', ""
        )
    (tmp_path / "hand.xml").write_text(source.replace(old, new))
    model.write_text(model.read_text().replace(path, str(tmp_path / "hand.xml")))
    with pytest.raises(SceneError, match=said):
        made(scene)


def test_joints_without_an_engine_and_mujoco_missing_are_said(tmp_path, monkeypatch):
    with pytest.raises(SceneError, match=r"joints: they name joints of an engine's model; add an \[engine\]"):
        file.parse(
            '[[body]]\nname = "b"\nshape = "frame"\n[[skin]]\ndevice = "anyskin"\nlink = "b"\njoints = { a = "b" }'
        )
    monkeypatch.setitem(__import__("sys").modules, "mujoco", None)
    with pytest.raises(SceneError, match=r"MuJoCo is not installed: pip install 'tactemu\[mujoco\]'"):
        made(scene_of(L6, "ball", tmp_path))
