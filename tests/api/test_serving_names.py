"""Wrong names in what `serve` is given are told as what they are; a press says why nothing can be pressed."""

import numpy as np
import pytest

import tactemu as tt
from tactemu.base.errors import SceneError, SourceError, TactemuError
from tests.scenes import ball, pad

POSE = ((0.0, 0.0, 0.014), (1.0, 0.0, 0.0, 0.0))
SCENE = pad(0.04, 0.04, 0.002) + ball(0.012, [0.0, 0.0, 0.1]) + "[[skin]]\ndevice = 'anyskin'\nlink = 'pad'\n"
FORCES = np.zeros((5, 3))


@pytest.fixture
def scene(tmp_path):
    """The path of a scene file with a pad that is fixed, and a ball."""
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return path


def of(table):
    """Return a source that returns a table at any time."""
    return lambda t_s: table


WAYS = r"; expected a table of poses by body \(ball\), or of readings by skin \(anyskin\), or of readings by quantity "
WRONG = {
    "a body": ({"bal": POSE}, "no body or skin is called 'bal'; did you mean 'ball'" + r"\?" + WAYS),
    "one of two": ({"ball": POSE, "bal": POSE}, "no body or skin is called 'bal'; did you mean 'ball'"),
    "a fixed body": ({"pad": POSE}, "body 'pad' is fixed, and cannot be posed" + WAYS),
    "a fixed body among others": ({"ball": POSE, "pad": POSE}, "body 'pad' is fixed, and cannot be posed"),
    "a skin": ({"anyskn": FORCES}, "no body or skin is called 'anyskn'; did you mean 'anyskin'"),
    "a quantity": ({"forces": FORCES}, "no body or skin is called 'forces'; did you mean 'force'"),
    "a quantity among others": ({"force": FORCES, "heat": 20.0}, "expected force, temperature .optional"),
    "poses and readings": ({"ball": POSE, "anyskin": FORCES}, "expected a table of one kind: poses by body"),
    "nothing": (
        {},
        "expected a table of poses by body .ball. or of readings by skin .anyskin., got a table of nothing",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_name_of_a_source_is_told_as_what_it_is(scene, case):
    table, said = WRONG[case]
    with pytest.raises(SourceError, match=said), tt.serve(scene, "memory:", source=of(table)) as dev:
        dev.wait(0.05)


def test_with_several_skins_the_message_names_them(tmp_path):
    path = tmp_path / "two.toml"
    path.write_text(SCENE.replace("[[skin]]", "[[skin]]\nname = 'a'") + "[[skin]]\ndevice = 'anyskin'\nlink = 'pad'\n")
    said = r"called 'bal'; did you mean 'ball'\?; expected a table of poses by body \(ball\), or of readings by skin "
    with pytest.raises(SourceError, match=said + r"\(a, anyskin\)$"):
        tt.serve(path, "memory:", source=of({"bal": POSE})).start()


def own_scene():
    """Return a scene of the user's own with a skin for the device."""
    scene = tt.Scene()
    pad = scene.add_body(None, name="own_pad", fixed=True)
    scene.add_body(tt.Sphere(radius=0.01), name="own_ball", position=(0, 0, 1))
    positions = np.zeros((5, 3)) + np.arange(5)[:, None] * (0.005, 0, 0)
    scene.add_sensor(tt.KinematicTaxel(positions=positions, radius=0.002), link=pad)
    return scene


PRESSED = {
    "readings": (lambda: of(FORCES), "skin 'anyskin' has the readings that your source gives; nothing can be pressed"),
    "poses": (lambda: of({"ball": POSE}), "the source moves ball, and nothing else does; move bodies in your own sim"),
    "a scene": (own_scene, "the source moves own_ball, own_pad, and nothing else does"),
}


@pytest.mark.parametrize("case", PRESSED)
def test_a_press_beside_a_source_says_what_is_the_case(scene, case):
    source, said = PRESSED[case]
    with tt.serve(scene, "memory:", source=source()) as dev:
        with pytest.raises(TactemuError, match=said):
            dev.press(depth=1e-3)
        if case == "poses":
            with pytest.raises(TactemuError, match=said):
                dev.press(depth=1e-3, body="ball")


def test_other_wrong_names_are_told():
    with pytest.raises(TypeError, match="unexpected keyword argument 'rate'"):
        tt.serve("anyskin", rate=100)
    with pytest.raises(SceneError, match="clock: expected one of real, lockstep, paced, got 'virtual'"):
        tt.serve("anyskin", clock="virtual")
