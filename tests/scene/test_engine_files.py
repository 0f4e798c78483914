"""Scene files and models for engines of many environments: keys, time steps, ranges and start poses."""

import numpy as np
import pytest

import tactemu as tt
from tactemu.base.errors import SceneError
from tactemu.engines.engine import MujocoEngine
from tactemu.scene import file as scene_file
from tactemu.scene.building import build_scene, make_devices
from tests.scene.engine_models import BUILT, DROP, ENGINES, FINGER, NEEDS_ENGINES

pytestmark = NEEDS_ENGINES


@pytest.fixture
def drop(tmp_path):
    path = tmp_path / "drop.xml"
    path.write_text(DROP)
    return path


def test_newton_makes_room_for_what_touches(tmp_path):
    """The gap of a geom is what its file says, and not the 0.1 m that Newton takes for its own contacts."""
    path = tmp_path / "gap.xml"
    path.write_text(DROP.replace('type="sphere"', 'type="sphere" gap="0.003"'))
    engine = tt.NewtonEngine(tt.Scene(dt=4e-3), path)
    names = [label.rpartition("/")[2] for label in engine.source.model.shape_label]
    assert dict(zip(names, engine.source.model.shape_gap.numpy())) == pytest.approx({"floor": 0.0, "ball": 0.003})


SCENE = """
[scene]
dt = 0.004
[engine]
kind = "{kind}"
file = "{file}"
{more}
[[skin]]
device = "flexitac"
link = "{link}"
{skin}
"""


@pytest.mark.parametrize("kind", ["mujoco-warp", "newton"])
@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"file": "nothing.xml"}, "nothing.xml"),
        ({"link": "bal"}, "no .*'bal'"),
        ({"more": "felt = 'force'"}, "felt"),
        ({"more": "njmax = 0"}, "njmax"),
        ({"skin": 'joints = { thumb = "bend" }'}, "joints"),
    ],
)
def test_a_file_that_asks_for_what_an_engine_has_not(drop, kind, changes, said):
    values = {"kind": kind, "file": "drop.xml", "link": "ball", "more": "", "skin": ""} | changes
    path = drop.parent / "scene.toml"
    path.write_text(SCENE.format(**values))
    with pytest.raises(SceneError, match=said):
        loaded = scene_file.load(path)
        build_scene(loaded, make_devices(loaded))


def test_a_time_step_that_does_not_fit(drop):
    with pytest.raises(SceneError, match="make dt a multiple"):
        tt.MujocoWarpEngine(tt.Scene(dt=5e-3), drop)


@pytest.mark.parametrize("included", [False, True])
def test_newton_takes_the_time_step_of_the_file(tmp_path, included):
    """Newton's own reader leaves it out."""
    path, option = tmp_path / "slow.xml", '<option timestep="0.003"/>'
    (tmp_path / "option.xml").write_text(f"<mujoco>{option}</mujoco>")
    said = '<include file="option.xml"/>' if included else option
    path.write_text(DROP.replace('<option timestep="0.002"/>', said))
    with pytest.raises(SceneError, match=r"time step of 0\.003 s, the scene's dt is 0\.001 s; make dt a multiple"):
        tt.NewtonEngine(tt.Scene(dt=1e-3), path)
    assert tt.NewtonEngine(tt.Scene(dt=6e-3), path).steps == 2
    path.write_text(DROP.replace('<option timestep="0.002"/>', ""))
    assert tt.NewtonEngine(tt.Scene(dt=5e-3), path).steps == 3, "it says none"


@pytest.mark.parametrize("kind", BUILT)
def test_bodies_are_where_the_model_has_them_before_the_first_step(drop, tmp_path, kind):
    """In memory and in the log of a scene file, also after a reset."""
    scene = drop.with_name("scene.toml")
    skin = 'name = "pad"\ndevice = "flexitac"\nlink = "floor"\nposition = [0.0, 0.0, 0.0]'
    scene.write_text(f'[scene]\ndt = 0.002\n[engine]\nkind = "{kind}"\nfile = "drop.xml"\n[[skin]]\n{skin}\n')
    with tt.serve(scene, port="memory:", clock="lockstep", truth=tmp_path / "log.mcap") as dev:
        dev.step(seconds=0.02)
    first, second = tt.read_log(tmp_path / "log.mcap").bodies["ball"].position[:2]
    np.testing.assert_allclose(first, [0, 0, 0.02], atol=1e-9)
    assert second[2] < first[2]
    of_engine = tt.Scene(dt=0.002)
    source = ENGINES[kind](of_engine, drop).source
    simulation = of_engine.build(2)
    ball = (source.geom("ball") if kind == "mujoco-warp" else source.shape("ball")).index
    for reset in (None, [1]):
        simulation.step()
        simulation.reset(reset)
        heights = simulation.pose_array.numpy()[:, ball, 2]
        assert heights[1] == pytest.approx(0.02, abs=1e-9)
        assert (heights[0] < 0.02 - 1e-9) == (reset is not None)


@pytest.mark.parametrize("kind", ["mujoco", *ENGINES])
def test_a_reversed_range_is_refused(tmp_path, kind):
    path = tmp_path / "reversed.xml"
    joint = '<joint name="bend" type="hinge" axis="0 1 0.3" range="1.6 0"/>'
    text = FINGER.replace('<joint name="bend" type="hinge" axis="0 1 0.3"/>', joint)
    path.write_text(text.replace("<mujoco>", '<mujoco><compiler angle="radian"/>'))
    engine = {"mujoco": MujocoEngine, **ENGINES}[kind]
    with pytest.raises(SceneError, match=r"joint 'bend': range is from 1\.6 to 0; give the lower end first"):
        engine(tt.Scene(dt=0.002), path)
