"""The trade's own logic: metrics, gains, resuming, and one small run through every level."""

import json

import numpy as np
import pytest

from tactemu.base.errors import TactemuError
from tactemu.sensors.layer.elastic_layer_taxel import ElasticLayerTaxel
from tactemu.sensors.sensor_model import Setting
from tactemu.tune.trade import cases as trade_cases
from tactemu.tune.trade import trade
from tactemu.tune.trade.cases import Case, TestSkin, all_cases, build, indenters
from tactemu.tune.trade.errors import Observation, errors, fit_gains, observe, together
from tactemu.tune.trade.picture import draw, places
from tactemu.tune.trade.report import read_table, summarise
from tactemu.tune.trade.settings import ladder, make_model
from tactemu.tune.trade.trade import TradeOptions
from tactemu.tune.trade.truth import Truths, fine_skin

SKIN = TestSkin(side=16, pitch=1e-3)
POSITIONS = SKIN.positions()[..., :2].reshape(-1, 2)


def observation(scale=1.0):
    r = np.linalg.norm(POSITIONS, axis=1)
    pressure = scale * np.maximum(0, 1 - (r / 4e-3) ** 2)
    return Observation(pressure, np.array([0.1, 0]) * scale, pressure > 0, pressure * 1e-7, POSITIONS * 1e-3 * scale)


def test_errors_of_the_truth_are_zero_and_of_a_scaled_one_its_scale():
    truth = observation()
    for value in errors(truth, truth, POSITIONS, SKIN.pitch**2, 0.5).values():
        assert value == pytest.approx(0.0, abs=1e-12)
    found = errors(observation(1.1), truth, POSITIONS, SKIN.pitch**2, 0.5)
    assert found["normal force"] == pytest.approx(0.1) and found["pressure"] == pytest.approx(0.1)
    assert found["centre"] == pytest.approx(0.0, abs=1e-9) and found["overlap of areas"] == 0.0


def test_gains_undo_a_scale():
    got, truth = observation(0.25), observation()
    gains = fit_gains(got, truth, ("pressure", "drag", "sink", "shift"))
    assert got.scaled(gains).pressure == pytest.approx(truth.pressure)
    assert gains["drag"] == pytest.approx(4.0) and gains["shift"] == pytest.approx(4.0)


OBJECTS = ["sphere", "box", "box edge", "cylinder", "tilted box", "thin wedge", "free form", "rim"]


def test_every_object_is_tried():
    assert OBJECTS == list(indenters())


@pytest.mark.parametrize("name", OBJECTS)
def test_every_object_touches_with_its_lowest_point_in_the_middle(name):
    """At a depth of 0.5 mm the deepest taxel is nearly that deep; on the wedge, 0.125 mm beside its edge, hardly."""
    setting = next(setting for setting in ladder() if setting.name == "L1 depth, ray")
    skin = TestSkin(side=48, pitch=2.5e-4)
    case = Case(name, 5e-4, "press")
    sim, body, sensor = build(skin, case, make_model(setting, skin))
    for pose in case.poses():
        sim.set_pose(body, **pose)
        sim.step()
    depth = observe(sensor.read(), skin.pitch**2).sink
    assert (3e-5 if name == "thin wedge" else 3.5e-4) < depth.max() < 5.1e-4


def test_all_levels_in_one_small_run(tmp_path, monkeypatch):
    cases = [Case("sphere", 5e-4, "press"), Case("box", 5e-4, "press"), Case("sphere", 5e-4, "slide")]
    names = ("L0 touch", "L1 depth", "L2 springs, ray", "L3 markers, thickness", "L4 4 iterations")
    monkeypatch.setattr(trade, "TestSkin", lambda: SKIN)
    monkeypatch.setattr(trade, "all_cases", lambda quick: cases)
    monkeypatch.setattr(trade, "ladder", lambda: [setting for setting in ladder() if setting.name in names])
    monkeypatch.setattr(trade, "checks", lambda cells: [])
    monkeypatch.setattr(trade, "Truths", lambda skin, factor, folder: Truths(skin, 8, folder))
    lines = []
    found = trade.run_trade(lines.append, out=tmp_path, options=TradeOptions(quick=True))
    assert json.loads((tmp_path / "trade.json").read_text())["summary"] == found["summary"]
    rows = {row["name"]: row["metrics"] for row in found["summary"]}
    assert "pressure" not in rows["L0 touch"] and "overlap of areas" in rows["L0 touch"]
    assert rows["L4 4 iterations"]["total force"]["median"] < 0.1
    assert rows["L4 4 iterations"]["pressure"]["median"] < rows["L2 springs, ray"]["pressure"]["median"]
    assert all(row["step_us"] > 0 and row["memory_bytes"] > 0 for row in found["summary"])

    def refuse(*_args):
        raise AssertionError("measured again")

    monkeypatch.setattr(trade, "_play", refuse)
    monkeypatch.setattr(Truths, "_solve", refuse)
    again = trade.run_trade(lines.append, out=tmp_path, options=TradeOptions(quick=True))
    for one, other in zip(again["settings"], found["settings"]):
        for case, metrics in other["errors"].items():
            for metric, values in metrics.items():
                assert one["errors"][case][metric] == pytest.approx(values, rel=1e-5, abs=1e-6)
    page = tmp_path / "page.md"
    page.write_text("# Page\n\n" + (tmp_path / "trade.md").read_text().split("cases:\n\n")[1])
    monkeypatch.setattr(trade, "measure_costs", refuse)
    kept = trade.run_trade(lines.append, out=tmp_path, options=TradeOptions(quick=True, times=False, page=page))
    steps = {row["name"]: row["step_us"] for row in kept["summary"]}
    assert steps == {row["name"]: pytest.approx(row["step_us"], abs=0.5) for row in again["summary"]}
    assert [row["name"] for row in read_table(page.read_text())] == list(steps)
    nowhere = TradeOptions(quick=True, times=False, page=tmp_path / "none.md")
    with pytest.raises(TactemuError, match="--no-times"):
        trade.run_trade(lines.append, out=tmp_path, options=nowhere)


def test_a_rung_is_dominated_by_one_that_is_faster_and_better():
    def setting(name, cost, error):
        summed = {"rms": error, "low": error, "high": error}
        values = {"cost": {"step_us": cost}, "errors": {"box, 0.5 mm, press": {"pressure": summed}}}
        return {"name": name, "level": 2, "calibrated_on": [], **values}

    rows = summarise([setting("slow", 10.0, 0.2), setting("fast", 5.0, 0.1), setting("exact", 20.0, 0.01)])
    assert [row["dominated_by"] for row in rows] == ["fast", None, None]


def test_cases_are_as_many_as_said():
    assert len(all_cases()) == 45 and len(all_cases(quick=True)) == 12
    assert trade_cases.CALIBRATION in all_cases()


def test_a_scene_of_the_user_is_measured_with_every_setting(tmp_path, monkeypatch):
    from tactemu.tune import tuner as tune

    monkeypatch.setattr(tune, "MOMENTS", 16)
    lines = []
    found = trade.run_trade(lines.append, "anyskin", out=tmp_path)
    (skin,) = found["skins"]
    assert len(skin["all"]) >= 4 and all(entry["cost_us"] > 0 for entry in skin["all"])
    assert all(
        {"taxels", "total", "worst", "pressure"} <= set(entry["errors"]) <= set(tune.ERRORS) for entry in skin["all"]
    )
    assert "| µs a sample |" in (tmp_path / "trade.md").read_text()


@pytest.mark.parametrize("case", [Case("box edge", 5e-4, "press"), Case("rim", 5e-4, "slide")])
def test_a_layer_as_fine_as_the_truth_is_the_truth_at_every_place(case):
    """Also the contact area; and the truth that is moved by cells is that of an object that is moved."""
    truths = Truths(SKIN, 8, None).of(case)
    options = {"oversampling": 8, "iterations": 400, "tolerance": 1e-5}
    played = trade._play(SKIN, Setting(name="as fine", model="elastic_layer_taxel", options=options), case, "cpu")
    for seen, truth in zip(played, truths, strict=True):
        found = errors(seen, truth, POSITIONS, SKIN.pitch**2, SKIN.friction)
        assert found["contact area"] == 0.0 and found["overlap of areas"] == 0.0
        assert abs(found["normal force"]) < 1e-3 and found["pressure"] < 1e-3
        assert found["normal motion"] < 1e-3 and found["tangential motion"] < 1e-3


def test_refining_the_grid_is_an_improvement_over_all_places_though_not_at_each():
    """The force on a rim: its error swings through zero with a period of one cell."""
    case, wrong = Case("rim", 5e-4, "press"), []
    truth = Truths(SKIN, 8, None).of(case)
    for split in (1, 2, 4):
        options = {"oversampling": split, "iterations": 100, "tolerance": 1e-5}
        played = trade._play(SKIN, Setting(name="", model="elastic_layer_taxel", options=options), case, "cpu")
        found = [errors(*pair, POSITIONS, SKIN.pitch**2, SKIN.friction) for pair in zip(played, truth)]
        wrong.append(together(found)["normal force"])
    assert wrong[0]["rms"] > 1.5 * wrong[1]["rms"] > 3 * wrong[2]["rms"]
    assert wrong[0]["low"] < 0 < wrong[0]["high"], "at some place it is smaller than with finer cells"


def test_the_force_of_a_slide_lacks_what_finer_steps_have_not_what_finer_cells_have():
    """A ball that slides in full: cells that it reaches within a step bear no traction in it."""
    case, lacking = Case("sphere", 5e-4, "slide"), {}
    for split, steps in ((4, 1), (8, 1), (4, 4), (8, 4)):
        fine = fine_skin(SKIN, split)
        options = {"iterations": 100, "displacement": False}
        sim, body, sensor = build(fine, case, ElasticLayerTaxel(positions=fine.positions(), **fine.layer, **options))
        for pose in case.poses(steps):
            sim.set_pose(body, **pose)
            sim.step()
        force = sensor.read().force.reshape(-1, 3).sum(0)
        lacking[split, steps] = 1 + force[0] / (fine.friction * force[2])
    assert lacking[8, 1] > lacking[4, 1] > 8e-3
    assert max(lacking[4, 4], lacking[8, 4]) < 3e-3


def test_names_in_the_picture_lie_on_no_point_and_on_no_other_name():
    rng = np.random.default_rng(0)
    points = [(float(x), float(y)) for x, y in rng.uniform((0, 0), (300, 60), (19, 2))]
    widths = [60.0] * len(points)
    boxes = [(x + right, y + up) for (x, y), (right, up) in zip(points, places(points, widths))]
    for k, (left, middle) in enumerate(boxes):
        assert not any(left - 1 < x < left + 61 and abs(middle - y) < 4 for x, y in points)
        assert not any(abs(left - a) < 60 and abs(middle - b) < 6.5 for a, b in boxes[:k])


def test_a_picture_of_settings_without_forces_can_be_drawn(tmp_path):
    row = {"name": "L1 depth", "level": 1, "step_us": 10.0, "metrics": {"normal motion": {"median": 0.4}}}
    draw({"summary": [row]}, tmp_path / "trade.svg")
    text = (tmp_path / "trade.svg").read_text()
    assert "L1 depth" in text and "error of the pressure" not in text
