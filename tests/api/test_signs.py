"""Forces and torques of every model act on the skin; ``convention="genesis"`` gives Genesis's signs."""

from typing import Any

import numpy as np
import pytest

import tactemu as tt
from tactemu.datasets.partition import Partition
from tactemu.datasets.spec import DatasetSpec
from tactemu.emulator.assembly import assemble
from tactemu.scene.file import parse
from tactemu.sensors.models import MODELS, model_class
from tactemu.sensors.signs import Convention
from tactemu.transducers.piezoresistive import Piezoresistive
from tests.sensors.genesis_case import Case
from tests.sensors.soft_skin_cases import Case as SoftSkinCase

OF_FORCE = [name for name in MODELS if "force" in model_class(name).layouts]
MIXED = [name for name in OF_FORCE if model_class(name).has_genesis_signs]
MORE_OPTIONS = {"proximity_taxel": {"shear_coupling": 1.0}}
"""Options without which a model reads no shear."""
TOP_M = 0.005
X, Y = np.meshgrid(*[(np.arange(9) - 4) * 2.5e-3] * 2)
PROBES = np.stack([X, Y, np.full_like(X, TOP_M)], -1)
LIFTED_PAD = (0.3, -0.2, 0.1)


def pressed(name: str, *, scene_convention: Convention = "skin", spin=0.0, slide=0.05, **options: Any):
    """Return the reading of a ball that presses onto -z, slides to +x and stops above the middle taxel."""
    scene = tt.Scene(dt=1e-3, convention=scene_convention)
    pad = scene.add_body(tt.Box(size=(0.04, 0.04, 2 * TOP_M)), fixed=True, position=LIFTED_PAD)
    ball = scene.add_body(tt.Sphere(radius=0.01), position=(0, 0, 1))
    given = {**next(iter(model_class(name).examples.values())), **MORE_OPTIONS.get(name, {}), **options}
    skin = scene.add_sensor(model_class(name)(positions=PROBES, **given), link=pad)
    sim = scene.build(dtype="float64")
    for step in range(8):
        turn = spin * 1e-3 * step
        sim.set_pose(
            ball,
            position=np.add(LIFTED_PAD, (slide * 1e-3 * (step - 7), 0, TOP_M + 0.0085)),
            quaternion=(np.cos(turn / 2), 0, 0, np.sin(turn / 2)),
            linear_velocity=(slide, 0, 0),
            angular_velocity=(0, 0, spin),
        )
        sim.step()
    return skin.read()


@pytest.mark.parametrize("name", OF_FORCE)
def test_a_ball_that_presses_down_and_slides_to_x_drags_the_skin_to_x(name):
    force = pressed(name).force
    total = force.sum((0, 1))
    assert total[2] < 0 < total[0]
    assert abs(total[1]) < 1e-3 * total[0]
    assert (force[..., 2] <= 0).all()
    assert pressed(name, slide=-0.05).force.sum((0, 1))[0] == pytest.approx(-total[0], rel=0.05)


@pytest.mark.parametrize("name", OF_FORCE)
def test_a_ball_that_spins_turns_the_skin_the_same_way(name):
    reading = pressed(name, spin=3.0, slide=0.0)
    assert np.cross(PROBES, reading.force).sum((0, 1))[2] > 0
    if hasattr(reading, "torque"):
        assert reading.torque.sum((0, 1))[2] > 0


@pytest.mark.parametrize("name", MIXED)
def test_a_torque_is_that_of_the_force_on_the_skin_and_the_twist(name):
    reading = pressed(name, spin=3.0)
    twist = reading.torque - np.cross(PROBES, reading.force)
    assert np.abs(reading.torque).max() > 1e-3
    felt = np.abs(reading.force).max(-1) > 0
    assert (twist[felt] @ (0, 0, 1) > 0).all()  # about n, which is within 30 degrees of the normal's axis
    level = pressed(name, spin=0.0)
    assert level.torque == pytest.approx(np.cross(PROBES, level.force), abs=1e-12)


@pytest.mark.parametrize("name", MIXED)
def test_the_convention_is_the_models_else_the_scenes(name):
    skin, genesis = pressed(name), pressed(name, convention="genesis")
    assert not np.allclose(skin.force, genesis.force)
    for given, expected in (
        (pressed(name, scene_convention="genesis"), genesis),
        (pressed(name, scene_convention="genesis", convention="skin"), skin),
        (pressed(name, convention="skin"), skin),
    ):
        assert np.array_equal(given.force, expected.force) and np.array_equal(given.torque, expected.torque)


@pytest.mark.parametrize("name", [name for name in OF_FORCE if name not in MIXED])
def test_a_model_that_genesis_lacks_has_one_convention(name):
    assert np.array_equal(pressed(name).force, pressed(name, convention="genesis").force)


GENESIS_CASES = {
    "springs of a box": (Case("c03_contact"), ("lin", "hertz")),
    "springs of another box": (Case("c10_contact"), ("kin",)),
}


@pytest.mark.parametrize("name", GENESIS_CASES)
def test_the_recorded_springs_of_genesis_differ_in_the_sign_of_shear_and_twist_alone(name):
    case, keys = GENESIS_CASES[name]

    def played(**options):
        readings = case.replay(case.grid(1), keys, "float64", **options)
        return [
            np.concatenate([getattr(reading, part) for reading in readings[key]["_gt"]])
            for key in keys
            for part in ("force", "torque")
        ]

    normal, skin, genesis = (
        played(shear_scalar=0.0, twist_scalar=0.0), played(convention="skin"), played(convention="genesis")
    )  # fmt: skip
    for kept, ours, theirs in zip(normal, skin, genesis):
        assert np.abs(theirs - kept).max() > 0
        assert ours - kept == pytest.approx(kept - theirs, abs=1e-12 * np.abs(theirs).max())


def test_the_recorded_proximity_of_genesis_differs_in_the_sign_of_normal_and_twist_alone():
    case = SoftSkinCase("c12")
    shear = case.play("float64", stiffness=0.0, twist_scalar=0.0)
    skin, genesis = (case.play("float64", convention=convention) for convention in ("skin", "genesis"))
    for name in (name for name in genesis if name.endswith("_gt")):
        assert np.abs(genesis[name] - shear[name]).max() > 0
        assert skin[name] - shear[name] == pytest.approx(
            shear[name] - genesis[name], abs=1e-12 * np.abs(genesis[name]).max()
        )


def test_an_unknown_convention_is_refused():
    with pytest.raises(tt.SceneError, match="Scene: convention must be one of skin, genesis, got 'mujoco'"):
        tt.Scene(convention="mujoco")  # type: ignore[arg-type]


def test_transducers_sense_what_acts_on_the_skin():
    scene = tt.Scene(convention="genesis")
    pad = scene.add_body(None)
    with pytest.raises(tt.SceneError, match="'finger': transducers sense what acts on the skin; leave out convention="):
        scene.add_sensor(tt.KinematicTaxel(), link=pad, name="finger", transducers=[Piezoresistive()])


SCENE = """
[[body]]
name = "pad"
shape = "frame"
[[skin]]
device = "anyskin"
link = "pad"
model = {model!r}
port = "memory:"
"""
OF_THE_SCENE = '[scene]\nconvention = "genesis"\n' + SCENE
OF_THE_SKIN = SCENE + 'options.convention = "genesis"\n'


@pytest.mark.parametrize("name", MIXED)
def test_a_device_measures_what_acts_on_the_skin(name):
    refused = "skin 'anyskin': devices measure what acts on the skin; leave out convention=\"genesis\""
    for scene in (OF_THE_SCENE, OF_THE_SKIN):
        with pytest.raises(tt.SceneError, match=refused):
            assemble(parse(scene.format(model=name)))
        assemble(parse(scene.format(model="elastic_layer_taxel")))


def test_a_dataset_says_that_its_forces_have_the_signs_of_genesis(tmp_path):
    (tmp_path / "pad.toml").write_text(OF_THE_SCENE.format(model="kinematic_taxel"))
    spec = DatasetSpec(target=str(tmp_path / "pad.toml"), envs=2, steps=1, bytes_envs=0)
    meanings = [column.meaning for column in Partition(spec, 0, 2).columns]
    assert len(meanings) == 2 and all("with the signs of Genesis" in meaning for meaning in meanings)
