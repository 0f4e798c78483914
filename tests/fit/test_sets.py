"""Laws of real sensors, on recordings of real sensors: each figure is of something that was left out."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from tactemu.base.errors import TactemuError
from tactemu.fit import realism, sets
from tactemu.fit.sets import weiss
from tactemu.fit.sets.aims import halves
from tactemu.fit.skill import Points, guesses, skill_of

EXCERPTS = Path(__file__).parents[1] / "data" / "real"
WHOLE = os.environ.get("TACTEMU_RECORDINGS", "")


def test_presses_of_a_lattice_predict_those_of_another_day():
    eflesh = sets.set_module("eflesh")
    recordings = eflesh.read(EXCERPTS / "eflesh")
    law = eflesh.fit({"normal_1": recordings["normal_1"]})
    points = eflesh.points("loading", recordings["normal_2"])
    error = np.sqrt(np.mean((eflesh.predict(law, "loading", recordings["normal_2"]) - points.y) ** 2))
    assert error < 2.0
    repeated = points.guesses["its own first press"] - points.y
    assert np.sqrt(np.mean(repeated**2)) > 2 * error


def test_two_recordings_cannot_judge_a_law():
    (line,) = realism.left_out("eflesh", sets.set_module("eflesh").read(EXCERPTS / "eflesh"))
    assert (line.skill.count, line.skill.verdict) == (2, "cannot be judged here")
    assert line.aim.most < line.skill.zero


def test_constants_have_a_value_for_each_recording():
    found = {
        (line.set, line.name.split(",")[0]): line.values
        for name in ("anyskin_leap", "fluid_channel")
        for line in realism.constants(name, sets.set_module(name).read(EXCERPTS / name))
    }
    assert found["anyskin_leap", "noise std"] == pytest.approx([5.85, 5.85], rel=0.05)
    assert found["fluid_channel", "force at the end of a hold of 2.4 s"] == pytest.approx([0.93, 0.93], abs=0.03)


def test_the_law_of_weights_is_found_back():
    law = {
        "full_counts": 5e4, "half_g": 700.0, "half_per_k": 0.04, "gain_per_k": -0.01, "per_imprint": 0.08,
        "creep_per_decade": 0.4,
    }  # fmt: skip
    rng = np.random.default_rng(5)
    recordings = {}
    for mass in (200.0, 400.0, 600.0, 900.0):
        for warm in (27.0, 33.0, 50.0):
            total = weiss.predicted_sum(law, mass, warm, np.arange(3)) * np.exp(rng.normal(0, 0.01, 3))
            creep = 0.4 + rng.normal(0, 0.005, 3)
            recordings[f"{mass} {warm}"] = weiss.Weights(mass, np.full(3, warm), total, creep)
    found = weiss.fit(recordings)
    for name, value in law.items():
        assert found[name] == pytest.approx(value, rel=0.1, abs=0.003), name


def test_the_half_on_which_a_law_is_judged_follows_from_its_names_alone():
    given, held = halves([f"speed{speed}_limit{limit}g" for speed in (25, 100) for limit in (100, 500, 1000)])
    assert (len(given), len(held)) == (3, 3)
    assert sorted(held) == ["speed100_limit1000g", "speed100_limit500g", "speed25_limit100g"]
    assert (given, held) == halves([*held, *given, *given]), "the order in which they are found does not count"


def test_a_folder_without_sets_is_refused(tmp_path):
    with pytest.raises(TactemuError, match="no folder of a set"):
        realism.run(data=tmp_path)
    with pytest.raises(TactemuError, match="name a folder"):
        realism.run()


def test_other_recordings_are_predicted_with_the_parameters_of_the_package():
    said = []
    found = realism.run(said.append, held=EXCERPTS)
    (line,) = found["held"]
    assert line["set"] == "eflesh" and line["skill"]["error"] < 5.0
    assert "cannot be judged here" in said[-1]


def law_of(kind, n, seed=3):
    """Errors of a law of a kind and of two guesses, on n recordings of ten points."""
    rng = np.random.default_rng(seed)
    size = {"good": 0.3, "as the mean": 1.0, "worse": 2.0}[kind]
    errors = [rng.normal(0, size, 10) for _ in range(n)]
    return errors, [{"mean": rng.normal(0, 1.0, 10), "line": rng.normal(0, 3.0, 10)} for _ in range(n)]


@pytest.mark.parametrize(
    ("kind", "n", "verdict"),
    [
        ("good", 12, "has skill"),
        ("as the mean", 12, "no skill shown"),
        ("worse", 12, "no skill shown"),
        ("good", 3, "cannot be judged here"),
    ],
)
def test_a_law_is_judged_beside_the_best_guess(kind, n, verdict):
    found = skill_of(*law_of(kind, n))
    assert (found.guess, found.verdict) == ("mean", verdict)
    assert found.skill == pytest.approx({"good": 0.7, "as the mean": 0.0, "worse": -1.0}[kind], abs=0.25)
    assert (found.low < found.skill < found.high) if n >= 4 else np.isnan(found.low)


def test_the_interval_of_a_skill_covers_it_as_often_as_it_says():
    inside = [(found := skill_of(*law_of("as the mean", 12, seed))).low < 0.0 < found.high for seed in range(200)]
    assert 0.85 < np.mean(inside) <= 1.0


def test_guesses_are_the_mean_a_line_and_the_nearest():
    x = np.array([[0.0], [1.0], [2.0]])
    found = guesses([Points(x, 3 + 2 * x[:, 0])], Points(np.array([[1.2], [5.0]]), np.zeros(2), {"own": np.ones(2)}))
    assert found["mean of the given"] == pytest.approx([5, 5])
    assert found["straight line"] == pytest.approx([5.4, 13])
    assert found["nearest of the given"] == pytest.approx([5, 7])
    assert found["own"] == pytest.approx([1, 1])


@pytest.mark.nightly
@pytest.mark.skipif(not WHOLE, reason="whole recordings: set TACTEMU_RECORDINGS to their folder")
def test_the_page_is_what_the_recordings_say(tmp_path):
    page = tmp_path / "realism.md"
    found = realism.run(lambda line: None, data=Path(WHOLE), page=page)
    assert page.read_text() == (Path(__file__).parents[2] / "docs" / "realism.md").read_text()
    assert json.loads(realism.PARAMETERS.read_text()) == realism._rounded(found["fitted"])
    assert all(line["aim"]["most"] < line["skill"]["zero"] for line in found["left out"])
    assert {line["set"] for line in found["left out"] if not line["skill"]["low"] > 0} == {"eflesh"}
