"""`tactemu tune`: it measures a scene, keeps the rate, and changes nothing in the file but what it chose."""

import tomllib
from pathlib import Path

import pytest

from tactemu.errors import SceneError
from tactemu.scene.file import load, parse
from tactemu.tune.settings import Setting, settings_for
from tactemu.tune.tuner import Measured, _pick, run_tune
from tactemu.tune.writing import set_skin

LAYER = "elastic_layer_taxel"

SCENE = """# my hand
[scene]
dt = 0.002  # two milliseconds

[[body]]
name = "pad"
shape = "frame"
fixed = true

[[body]]
name = "ball"
shape = "sphere"
radius = 0.006
position = [0.0, 0.0, 0.0065]
motion = { kind = "press", direction = [0, 0, -1], approach = 0.0005, depth = 0.0005, speed = 0.002, repeat = 0 }

[[skin]]
device = "xela_uskin"  # the device
link = "pad"
options = { noise = 0.01, normal_stiffness = 300.0, probe_radius = 0.002 }
position = [
  0.0, 0.0,
  0.0,
]
port = "memory:"

[[skin]]
device = "xela_uskin"
name = "other"
link = "pad"
[skin.options]
bias = 0.5
"""


def test_writing_changes_the_chosen_keys_only():
    text = set_skin(SCENE, 0, LAYER, {"iterations": 4, "noise": 0.01, "young_modulus": 1e5, "coupled": True}, "float64")
    data = tomllib.loads(text)
    assert data["skin"][0]["model"] == LAYER
    assert data["skin"][0]["options"] == {"iterations": 4, "noise": 0.01, "young_modulus": 1e5, "coupled": True}
    assert data["scene"] == {"dt": 0.002, "dtype": "float64"}
    before = tomllib.loads(SCENE)
    assert data["body"] == before["body"] and data["skin"][1] == before["skin"][1]
    assert data["skin"][0]["port"] == "memory:"
    for comment in ("# my hand", "# two milliseconds", "# the device"):
        assert comment in text
    parse(text)


def test_writing_replaces_a_table_of_options():
    data = tomllib.loads(set_skin(SCENE, 1, "kinematic_taxel", {"bias": 0.5, "normal_stiffness": 12.5}))
    assert data["skin"][1]["options"] == {"bias": 0.5, "normal_stiffness": 12.5}
    assert data["skin"][0] == tomllib.loads(SCENE)["skin"][0]
    assert set_skin(set_skin(SCENE, 1, "a", {}), 1, "a", {}) == set_skin(SCENE, 1, "a", {})


def test_a_setting_keeps_imperfections_and_drops_what_the_model_lacks():
    skin = parse(SCENE).tables.skin[0]
    layer = next(s for s in settings_for("force") if s.model == LAYER).skin(skin)
    assert layer.options["noise"] == 0.01 and "normal_stiffness" not in layer.options
    assert settings_for("force")[0].name == "kinematic_taxel, nearest surface"
    springs = next(s for s in settings_for("force") if s.model == "kinematic_taxel").skin(skin, gain=2.0)
    assert springs.options["normal_damping"] == 2.0 and springs.options["noise"] == 0.01


def measured(name, cost, error):
    return Measured(Setting(name, LAYER), cost, 1.2 * cost, error, 1.0)


def test_the_most_accurate_that_fits_is_picked_with_both_neighbours():
    entries = [measured("a", 10, 0.5), measured("b", 50, 0.1), measured("c", 60, 0.098), measured("d", 500, 0.01)]
    choice = _pick("skin", "truth", 100.0, entries)
    assert choice.keeps_rate and choice.chosen.setting.name == "b"  # as good as c, and cheaper
    assert choice.cheaper.setting.name == "a" and choice.finer.setting.name == "d"
    late = _pick("skin", "truth", 5.0, entries)
    assert not late.keeps_rate and late.chosen.setting.name == "a" and late.cheaper is None


@pytest.mark.parametrize(("rate", "error"), [(0.0, "taxels"), (100.0, "nonsense")])
def test_wrong_wishes_are_refused(rate, error):
    with pytest.raises(SceneError, match="--"):
        run_tune("anyskin", rate, error=error)


def test_a_scene_is_tuned_and_written(tmp_path):
    file = Path(tmp_path) / "hand.toml"
    first = SCENE.split('[[skin]]\ndevice = "xela_uskin"\nname')[0]
    file.write_text(first)
    lines = []
    (choice,) = run_tune(str(file), 20.0, report=lines.append, seconds=1.0)
    assert choice.keeps_rate and choice.chosen.late_us <= choice.budget_us
    layers = {m.setting.name: m.error for m in choice.all if m.setting.model == LAYER}
    springs = min(m.error for m in choice.all if m.setting.model == "kinematic_taxel")
    assert choice.chosen.setting.model == LAYER and choice.chosen.error == pytest.approx(min(layers.values()), rel=0.06)
    assert choice.chosen.error < 0.5 * springs
    skin = load(str(file)).tables.skin[0]
    assert skin.model_ == LAYER and skin.options["noise"] == 0.01
    assert any("chosen" in line for line in lines)


def test_a_scene_without_contact_is_refused(tmp_path):
    file = Path(tmp_path) / "hand.toml"
    file.write_text(SCENE.split("motion")[0] + '\n[[skin]]\ndevice = "xela_uskin"\nlink = "pad"\n')
    with pytest.raises(SceneError, match="nothing touches"):
        run_tune(str(file), 20.0, report=lambda _text: None, seconds=0.1)
