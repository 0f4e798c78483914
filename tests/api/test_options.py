"""A model has its geometry and physics, and three groups of options that all models have; flat by one function."""

import dataclasses
import inspect
import pydoc

import pytest

import tactemu as tt
from tactemu.base.errors import SceneError
from tactemu.base.option_groups import defaults, from_flat, groups, to_flat
from tactemu.scene.building import build_scene, make_devices
from tactemu.scene.file import parse
from tactemu.sensors.models import MODELS, model_class

CLASSES = [model_class(name) for name in MODELS]
GROUPS = {
    "imperfections": tt.ImperfectionOptions,
    "electronics": tt.ElectronicsOptions,
    "draw": tt.DrawOptions,
}


@pytest.mark.parametrize("model", CLASSES)
def test_help_of_a_model_fits_two_screens(model):
    text = pydoc.plain(pydoc.render_doc(model)).splitlines()
    assert len(text) <= 100, len(text)
    assert not any("noise" in line or "debug_probe_color" in line for line in text)


@pytest.mark.parametrize("model", CLASSES)
def test_a_models_own_options_come_first_and_the_groups_last(model):
    names = list(inspect.signature(model).parameters)
    assert names[-3:] == list(GROUPS) and not set(names) & set(defaults(tt.DrawOptions))
    assert {name: type(default) for name, default in groups(model).items()} == GROUPS


@pytest.mark.parametrize("model", CLASSES)
def test_flat_options_are_those_of_the_groups(model):
    given = {"noise": 0.1, "hysteresis_strength": 0.2, "draw_debug": True, "adjustable": ("bias",)}
    made = from_flat(model, given)
    assert (made.electronics.noise, made.imperfections.hysteresis_strength, made.draw.draw_debug) == (0.1, 0.2, True)
    assert to_flat(made) == defaults(model) | given
    assert from_flat(model, to_flat(made)).electronics == made.electronics


def test_no_two_groups_share_a_name():
    named = [name for group in GROUPS.values() for name in defaults(group)]
    assert len(named) == len(set(named))


def test_a_flat_option_in_python_is_told_its_group():
    with pytest.raises(TypeError, match=r"'noise'; it is one of electronics: electronics=ElectronicsOptions\(noise="):
        tt.KinematicTaxel(noise=0.1)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="has no option 'normal_stiff'; did you mean 'normal_stiffness'"):
        tt.KinematicTaxel(normal_stiff=1.0)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="ElectronicsOptions has no option 'nois'; did you mean 'noise'"):
        tt.ElectronicsOptions(nois=1.0)  # type: ignore[call-arg]


def test_an_unknown_flat_option_is_told_the_nearest():
    with pytest.raises(SceneError, match=r"KinematicTaxel has no 'nose'; did you mean 'noise'\? \(options: "):
        from_flat(tt.KinematicTaxel, {"nose": 0.1})


def test_a_group_shows_what_differs_from_the_defaults():
    assert repr(tt.ElectronicsOptions(noise=0.1, delay=1e-3)) == "ElectronicsOptions(noise=0.1, delay=0.001)"
    assert repr(tt.DrawOptions()) == "DrawOptions()"


def test_an_option_of_a_groups_name_is_refused():
    @dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
    class Noisy(tt.KinematicTaxel):
        noise: float = 0.0

    with pytest.raises(SceneError, match="its option 'noise' is one of electronics; choose another name"):
        from_flat(Noisy, {})


def test_a_models_own_defaults_of_a_group_stay():
    @dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
    class Worn(tt.KinematicTaxel):
        electronics: tt.ElectronicsOptions = tt.ElectronicsOptions(noise=0.1)  # noqa: RUF009

    assert from_flat(Worn, {"bias": 1.0}).electronics == tt.ElectronicsOptions(noise=0.1, bias=1.0)


def test_a_skin_of_a_scene_file_stays_flat():
    text = """
[[body]]
name = "pad"
shape = "frame"
[[skin]]
device = "anyskin"
link = "pad"
options = { noise = 0.1, crosstalk_strength = 0.2, draw_debug = true, adjustable = ["dead"] }
"""
    loaded = parse(text)
    _scene, skins = build_scene(loaded, make_devices(loaded), {"anyskin": ("bias",)})
    model = skins["anyskin"].model
    assert (model.electronics.noise, model.imperfections.crosstalk_strength, model.draw.draw_debug) == (0.1, 0.2, True)
    assert model.adjustable == ("bias", "dead")
    with pytest.raises(SceneError, match="kinematic_taxel has no 'electronics'"):
        loaded = parse(text.replace("noise = 0.1", "electronics = { noise = 0.1 }"))
        build_scene(loaded, make_devices(loaded))


def test_the_options_of_groups_are_checked_when_they_are_made():
    with pytest.raises(SceneError, match="DrawOptions: debug_probe_sphere_opacity must be"):
        tt.DrawOptions(debug_probe_sphere_opacity=2.0)
