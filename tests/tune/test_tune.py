"""`tactemu tune`: it measures a scene, keeps the rate, and changes nothing in the file but what it chose."""

import tomllib
from pathlib import Path

import pytest

from tactemu.base.errors import SceneError
from tactemu.emulator.assembly import assemble
from tactemu.emulator.options import AssemblyOptions
from tactemu.scene.file import load, parse
from tactemu.sensors.sensor_model import Setting
from tactemu.tune.choice import ALIKE, Measured, Pace, as_dict, pick, report_choice
from tactemu.tune.cost import MAX_CPU_SHARE, Cost, measure_loop
from tactemu.tune.errors import ERRORS, Comparison, Criterion
from tactemu.tune.settings import settings_for, skin_with
from tactemu.tune.tuner import Tuner, run_tune
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
options = { noise = 0.01, normal_stiffness = 300.0, radius = 0.002 }
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


def test_writing_reads_toml_as_toml():
    """Heads in texts and comments are none, tables of lists stay apart, and dotted keys are options."""
    text = 'about = """\n[[skin]]\n"""\n[[skin]]\noptions.noise = 1\nfaults = [\n  "drop 1%", # [[skin]]\n]\n'
    text += '[skin.clock]\nmissed = 0.1\n[[body]]\nname = "ball"\n'
    data = tomllib.loads(set_skin(text, 0, "a", {"bias": (1.0, 2.0)}, "float64"))
    skin = {"faults": ["drop 1%"], "model": "a", "options": {"bias": [1.0, 2.0]}, "clock": {"missed": 0.1}}
    assert data == {"about": "[[skin]]\n", "skin": [skin], "body": [{"name": "ball"}], "scene": {"dtype": "float64"}}
    with pytest.raises(SceneError, match="1 \\[\\[skin\\]\\] tables"):
        set_skin(text, 1, "a", {})


def test_a_setting_keeps_imperfections_and_drops_what_the_model_lacks():
    skin = parse(SCENE).tables.skin[0]
    layer = skin_with(next(s for s in settings_for("force") if s.model == LAYER), skin)
    assert layer.options["noise"] == 0.01 and "normal_stiffness" not in layer.options
    assert settings_for("force")[0].name == "kinematic_taxel, nearest surface"
    springs = skin_with(next(s for s in settings_for("force") if s.model == "kinematic_taxel"), skin, gain=2.0)
    assert springs.options["normal_damping"] == 2.0 and springs.options["noise"] == 0.01


TAXELS = Criterion(("taxels",))


def measured(name, step_us, error, rate_hz=100.0, *, late_us=None, sample_us=10.0):
    cost = Cost(step_us, late_us or 1.2 * step_us, sample_us)
    return Measured(Setting(name, model=LAYER), cost, Pace(rate_hz, 1e-3), error, 1.0)


def picked(rate_hz):
    """Of settings from 10 µs to 11 ms a step, each better than the one before."""
    entries = [measured(f"{step_us}", step_us, 1 / step_us, rate_hz) for step_us in (10, 50, 200, 500, 11_000)]
    return pick("skin", "truth", Pace(rate_hz, 1e-3), None, entries, TAXELS)


def test_the_most_accurate_that_fits_is_picked_with_both_neighbours():
    entries = [measured("a", 10, 0.5), measured("b", 50, 0.1), measured("c", 60, 0.098), measured("d", 900, 0.01)]
    choice = pick("skin", "truth", Pace(100.0, 1e-3), None, entries, TAXELS)
    assert choice.keeps_rate and choice.chosen.setting.name == "b"  # as good as c, and cheaper
    assert choice.cheaper.setting.name == "a" and choice.finer.setting.name == "d"
    slow = [measured(e.setting.name, 800, e.error, 1e5) for e in entries]
    late = pick("skin", "truth", Pace(1e5, 1e-3), None, slow, TAXELS)
    assert not late.keeps_rate and late.chosen.setting.name == "d"  # all are as fast


def test_if_no_setting_keeps_the_rate_accuracy_decides_among_those_that_are_as_fast():
    """FlexiTac at 11 kHz: springs cost 6 % less than a layer, whose error is a tenth of theirs."""
    rate = 11_000.0
    costs = {
        "points": (40, 0.87, 83.9),
        "springs": (13, 0.39, 84.0),
        "layer": (40, 0.031, 87.0),
        "x4": (229, 0.01, 120),
    }
    entries = [measured(name, step, error, rate, sample_us=sample) for name, (step, error, sample) in costs.items()]
    entries.append(measured("late", 41, 0.01, rate, late_us=600, sample_us=87.0))  # loses 45 % to slow steps
    choice = pick("skin", "truth", Pace(rate, 1e-3), None, entries, TAXELS)
    assert not choice.keeps_rate and choice.chosen.setting.name == "layer"
    assert choice.cheaper is None and choice.finer.setting.name == "late"
    lines: list[str] = []
    report_choice(choice, lines.append)
    assert any("no setting keeps 11000 Hz here" in line and "--rate 7500" in line for line in lines)
    assert any("most accurate of the 3 fastest: layer" in line for line in lines)


def test_if_the_steps_alone_are_too_much_a_longer_one_is_proposed():
    lines: list[str] = []
    choice = pick("skin", "truth", Pace(10.0, 1e-3), None, [measured("dear", 2_000, 0.1, 10.0)], TAXELS)
    report_choice(choice, lines.append)
    assert any("raise dt to 0.003 s" in line for line in lines)


@pytest.mark.parametrize("step_us", [1.0, 300.0, 690.0])
def test_the_highest_rate_is_kept_and_one_a_quarter_higher_is_not(step_us):
    cost = Cost(step_us, 1.2 * step_us, 10.0)
    highest = cost.highest_rate_hz(1e-3)
    assert cost.keeps_rate(highest, 1e-3) and not cost.keeps_rate(1.25 * highest, 1e-3)
    assert Cost(800.0, 900.0, 10.0).highest_rate_hz(1e-3) == 0


def test_steps_are_paid_by_their_own_rate_however_many_samples_there_are():
    """A step of 11 ms at a time step of 1 ms keeps no rate at all."""
    dear = measured("dear", 11_000, 0.001, 30_000.0)
    assert dear.cpu_share > 11 and not dear.keeps_rate
    assert measured("cheap", 20, 0.1, 30_000.0).cpu_share == pytest.approx(0.02 + 0.3)


@pytest.mark.parametrize(("late_us", "lost"), [(80, 0.0), (95, 0.1), (400, 3.1), (2000, 1.0)])
def test_samples_behind_a_slow_step_are_lost(late_us, lost):
    """At 10 kHz: of the periods that a step of each millisecond takes, all but the first two."""
    cost = Cost(20.0, late_us, 10.0)
    missed = max(0, (late_us + 10) // 100 - 2) / 10
    assert cost.lost_share(10_000.0, 1e-3) == pytest.approx(min(missed, 1.0))
    assert cost.keeps_rate(10_000.0, 1e-3) == (missed == 0)


def test_the_choice_is_monotone_in_the_rate():
    errors = [picked(rate).chosen.error for rate in (1, 10, 100, 1e3, 3e3, 1e4, 2e4, 3e4, 6e4)]
    assert errors == sorted(errors) and errors[0] < errors[-1]
    assert picked(100).chosen.cpu_share <= MAX_CPU_SHARE and not picked(1e5).keeps_rate and ALIKE > 1


def test_the_limit_of_the_wire_is_found():
    """386 bytes of 10 bits at 2 Mbaud."""
    loaded = load("flexitac")
    slow = measure_loop(loaded, 100.0, "cpu", 0.5)
    assert slow.line_hz is None and slow.skins == 1 and slow.sample_us > 0
    assert measure_loop(loaded, 5_000.0, "cpu", 0.5).line_hz == pytest.approx(2e6 / 3860, rel=0.02)


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
    assert choice.keeps_rate and choice.chosen.cpu_share <= MAX_CPU_SHARE
    layers = {m.setting.name: m.error for m in choice.all if m.setting.model == LAYER}
    springs = min(m.error for m in choice.all if m.setting.model == "kinematic_taxel")
    assert choice.chosen.setting.model == LAYER and choice.chosen.error == pytest.approx(min(layers.values()), rel=0.06)
    assert choice.chosen.error < 0.5 * springs
    skin = load(str(file)).tables.skin[0]
    assert skin.model_ == LAYER and skin.options["noise"] == 0.01
    assert any("chosen" in line for line in lines)
    assert choice.criterion.measures == ("pressure", "edges"), "a ball that few of the 16 taxels touch"
    assert choice.chosen.error == max(choice.chosen.errors[name] for name in choice.criterion.measures)
    assert any("its errors: taxels" in line and "edges" in line for line in lines)
    assert any("    drag: " in line and "not judged, no body slides" in line for line in lines)
    told = as_dict(choice)
    assert told["judged_by"] == ["pressure", "edges"] and set(told["chosen"]["errors"]) < set(ERRORS)


SLIDE = """motion = [
  { kind = "press", approach = 0.0005, depth = 0.0005, speed = 0.01, dwell = 0.1, release = false },
  { kind = "slide", distance = 0.004, speed = 0.005, repeat = 0 },
]"""


def test_a_body_that_slides_is_judged_by_its_drag_too(tmp_path):
    file = Path(tmp_path) / "hand.toml"
    first = SCENE.split('[[skin]]\ndevice = "xela_uskin"\nname')[0]
    press = next(line for line in first.splitlines() if line.startswith("motion"))
    file.write_text(first.replace(press, SLIDE))
    loaded = load(str(file))
    tuner = Tuner(loaded, loaded.tables.skin[0], 20.0, None, 1.0, None)
    truth, _name = tuner._truth(4)
    criterion = Comparison(truth[30:], tuner.device).criterion()
    assert "drag" in criterion.measures and "a body slides" in criterion.reasons["drag"]


def test_an_error_that_the_scene_does_not_show_is_refused(tmp_path):
    file = Path(tmp_path) / "hand.toml"
    file.write_text(SCENE.split('[[skin]]\ndevice = "xela_uskin"\nname')[0])
    with pytest.raises(SceneError, match=r"--error drag: skin 'xela_uskin' has none .* it has taxels, total, worst"):
        run_tune(str(file), 20.0, error="drag", report=lambda _text: None, seconds=1.0)


def test_a_scene_without_contact_is_refused(tmp_path):
    file = Path(tmp_path) / "hand.toml"
    file.write_text(SCENE.split("motion")[0] + '\n[[skin]]\ndevice = "xela_uskin"\nlink = "pad"\n')
    with pytest.raises(SceneError, match="nothing touches"):
        run_tune(str(file), 20.0, report=lambda _text: None, seconds=0.1)


@pytest.mark.parametrize("kind", ["magnetic", "material"])
def test_a_skin_with_a_transducer_is_compared_before_it_and_timed_behind_it(tmp_path, monkeypatch, kind):
    monkeypatch.setattr("tactemu.tune.tuner.settings_for", lambda senses: settings_for(senses)[:1])
    skin = f'[[skin]]\ndevice = "anyskin"\nlink = "pad"\ntransducer = [{{ kind = "{kind}" }}]\n'
    file = Path(tmp_path) / "hand.toml"
    file.write_text(SCENE.split("[[skin]]")[0] + skin)
    (choice,) = run_tune(str(file), 20.0, report=lambda _text: None, seconds=1.0)
    assert choice.chosen.setting.model == "kinematic_taxel" and 0 < choice.chosen.error < 2
    assert load(str(file)).tables.skin[0].transducer == ({"kind": kind},)


@pytest.mark.idle("it runs at the highest rate that was measured to be kept")
def test_a_run_at_the_choice_keeps_its_samples(tmp_path):
    rate_hz = 500.0
    file = Path(tmp_path) / "hand.toml"
    file.write_text(SCENE.split('[[skin]]\ndevice = "xela_uskin"\nname')[0])
    (choice,) = run_tune(str(file), rate_hz, report=print, seconds=1.0)
    assert choice.keeps_rate
    for _ in range(3):  # a machine that somebody else slows down is no property of the choice
        with assemble(load(str(file)), AssemblyOptions(port="memory:", rate_hz=rate_hz)).emulator as emulator:
            emulator.run(2.0)
        statistics = emulator.channels[0].statistics
        if statistics.samples >= 0.98 * 2.0 * rate_hz - 2:
            break
    assert statistics.samples >= 0.98 * (statistics.samples + statistics.missed)
    assert statistics.samples >= 0.98 * 2.0 * rate_hz - 2
