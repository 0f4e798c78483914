"""What every sensor model keeps, by the registry alone: a model that is added is found here by its name."""

import inspect
import re
from typing import get_args

import numpy as np
import pytest

import tactemu as tt
from firmware_protocols.senses import TOUCH, Quantity
from tactemu.base.errors import SceneError
from tactemu.base.option_groups import defaults, from_flat
from tactemu.scene.file import parse
from tactemu.sensors.models import MODELS, cheapest, model_class, models_for
from tactemu.sensors.sensor import reading_array
from tactemu.sensors.sensor_model import SensorModel

EXAMPLES = [(name, words) for name in MODELS for words in model_class(name).examples]
SIDE = 9
X, Y = np.meshgrid(*[(np.arange(SIDE) - (SIDE - 1) / 2) * 2.5e-3] * 2)
PROBES = np.stack([X, Y, np.full_like(X, 0.01)], -1)


def options_of(model) -> set[str]:
    return set(defaults(model))


def pressed(name, options, *, depth, speed=(0.05, 0.0, 0.0), seed=0):
    """``(reading as one array, plan)`` of a ball slid into a pad, or held off it for a negative depth."""
    scene = tt.Scene(dt=1e-3)
    pad = scene.add_body(tt.Box(size=(0.04, 0.04, 0.02)), fixed=True, name="pad")
    ball = scene.add_body(tt.Sphere(radius=0.01), name="ball", position=(0, 0, 1))
    skin = scene.add_sensor(from_flat(model_class(name), {"positions": PROBES, **options}), link=pad, name="skin")
    sim = scene.build(seed=seed)
    for step in range(4):
        at = (5e-4 * step, 0, 0.02 - depth)
        sim.set_pose(ball, position=at, linear_velocity=speed, angular_velocity=(0, 0, 1.0))
        sim.step()
    return reading_array(skin).numpy().copy(), sim.plan


@pytest.mark.parametrize("name", MODELS)
def test_it_says_what_it_is(name):
    model = model_class(name)
    assert issubclass(model, SensorModel) and getattr(tt, model.__name__) is model
    assert model.level in range(5) and model.valid and model.source and model.unit
    assert inspect.getmodule(model).__doc__ and model.__doc__
    assert model.layouts and set(model.layouts) <= set(get_args(Quantity))
    named = {*model.strengths, *model.material, *(o for options in model.examples.values() for o in options)}
    named |= {option for q in model.layouts for trial in model.trials(q) for option in trial.options}
    assert named <= options_of(model), named - options_of(model)
    assert all(len(model.trials(quantity)) for quantity in model.layouts)


@pytest.mark.parametrize(("name", "words"), EXAMPLES)
def test_it_feels_what_presses_and_nothing_else(name, words):
    options = model_class(name).examples[words]
    felt, plan = pressed(name, options, depth=1e-3)
    assert np.isfinite(felt).all() and np.abs(felt).max() > 0
    assert np.array_equal(felt, pressed(name, options, depth=1e-3)[0])
    assert not pressed(name, options, depth=-0.02)[0].any()
    for stage in plan.stages:
        for option in re.findall(r"`(\w+)", stage.cheaper):
            assert option in options_of(model_class(name)), stage.cheaper


@pytest.mark.parametrize(("name", "words"), [example for example in EXAMPLES if model_class(example[0]).strengths])
def test_its_strengths_scale_the_whole_reading(name, words):
    model, options = model_class(name), dict(model_class(name).examples[words])
    strong = options | {option: 3.0 * options.get(option, defaults(model)[option]) for option in model.strengths}
    once, thrice = (pressed(name, given, depth=1e-3)[0] for given in (options, strong))
    assert thrice == pytest.approx(3.0 * once, rel=1e-5, abs=1e-6 * float(np.abs(once).max()))


@pytest.mark.parametrize("name", MODELS)
def test_every_setting_of_its_dials_can_be_built(name):
    model = model_class(name)
    for quantity in model.layouts:
        for trial in model.trials(quantity):
            base = next(iter(model.examples.values()))
            assert np.abs(pressed(name, {**base, **trial.options}, depth=1e-3)[0]).max() > 0
    finest = model.finest(SIDE)
    assert finest is None or set(finest.options) <= options_of(model)


def test_every_quantity_of_a_device_has_a_cheapest_model():
    for quantity in TOUCH:
        assert cheapest(quantity) == next(iter(models_for(quantity)))
    assert (cheapest("touch"), cheapest("force")) == ("contact_probe", "kinematic_taxel")


SCENE = """
[[body]]
name = "pad"
shape = "frame"
[[skin]]
device = "anyskin"
link = "pad"
model = {model!r}
"""


def test_a_wrong_name_of_a_model_is_told():
    with pytest.raises(SceneError, match="unknown model 'kinematik_taxel'; did you mean 'kinematic_taxel'"):
        parse(SCENE.format(model="kinematik_taxel"))


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("elastomer_taxel", {"release_threshold": np.nan}, "release_threshold must be a finite number m, got nan"),
        ("elastomer_taxel", {"release_threshold": -np.inf}, "release_threshold must be a finite number m, got -inf"),
        ("elastomer_taxel", {"release_threshold": 1e-3}, "release_threshold must be <= contact_threshold (1e-05 m)"),
        ("elastomer_taxel", {"compressibility": 1.5}, "compressibility must be >= 0 and <= 1, got 1.5"),
        ("contact_probe", {"release_threshold": np.nan}, "release_threshold must be a finite number m, got nan"),
        ("proximity_taxel", {"stiffness": "much"}, "stiffness must be a number >= 0, got the text 'much'"),
        ("kinematic_taxel", {"normal_exponent": 0}, "normal_exponent must be > 0, got 0"),
        ("elastic_layer_taxel", {"iterations": 2.5}, "iterations must be a whole number >= 1 and <= 100000, got 2.5"),
        ("elastic_layer_taxel", {"poisson_ratio": 0.51}, "poisson_ratio must be >= 0 and <= 0.5, got 0.51"),
        ("elastic_layer_taxel", {"young_modulus": np.inf}, "young_modulus must be > 0 Pa, got inf"),
        ("elastic_layer_taxel", {"thickness": np.nan}, "thickness must be > 0 m, got nan"),
    ],
)
def test_a_wrong_option_is_named_as_it_is(name, options, message):
    with pytest.raises(SceneError) as caught:
        pressed(name, options, depth=0.0)
    assert message in str(caught.value)
