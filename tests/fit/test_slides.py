"""The laws of slides over a board and over cotton, on slides that are made of them."""

import numpy as np
import pytest

from tactemu.fit import realism
from tactemu.fit.sets import cpm_finger
from tactemu.fit.sets.aims import folds

PERIOD_S = 0.028


def board(grip, speed, rng, shares=(0.6, 0.1)):
    """Rows of a slide over ridges 20 mm apart: shares of the grip as its line and second harmonic."""
    t = PERIOD_S * np.arange(round(0.15 / (speed * 1e-3) / PERIOD_S))
    phases = rng.uniform(0, 2 * np.pi, 16)
    line = 2 * np.pi * t[:, None] * speed / 20.0
    waves = shares[0] * np.cos(line + phases) + shares[1] * np.cos(2 * line + 0.3 + phases)
    felt = grip * (1 + waves) + rng.normal(0, 2.0, (len(t), 16))
    return np.column_stack([1e3 * t, np.zeros(len(t)), felt])


def cotton(grip, rng):
    noise = np.hypot(1.5, 4.0 / (1 + np.exp(-(grip - 190) / 15)))
    return np.column_stack([1e3 * PERIOD_S * np.arange(800), np.zeros(800), grip + rng.normal(0, noise, (800, 16))])


@pytest.fixture(scope="module")
def slides():
    rng = np.random.default_rng(2)
    rows = {
        f"Board10mm_F{grip}_V-{speed}mmps_0": board(grip, speed, rng)
        for grip in (120, 135, 150)
        for speed in (5, 10, 20, 30)
    }
    rows |= {
        f"BeigeCotton_F{grip}_V-{speed}mmps_{repeat}": cotton(grip, rng)
        for grip in (120, 150, 180, 210, 250)
        for speed in (10, 50)
        for repeat in (0, 1)
    }
    return {name: cpm_finger.slide(name, each) for name, each in rows.items()}


def test_the_parameters_of_board_and_cotton_are_found_back(slides):
    found = cpm_finger.fit(slides)
    assert found["line_shares"] == pytest.approx([0.6, 0.1], rel=0.03)
    assert found["cotton_white"] == pytest.approx(1.5, rel=0.05)
    assert found["cotton_oscillation"] == pytest.approx(4.0, rel=0.1)
    assert found["cotton_onset"] == pytest.approx(190, abs=5)


def test_each_speed_and_each_grip_is_left_out_in_turn_and_counts_as_one(slides):
    lines = {line.aim.key: line.skill for line in realism.left_out("cpm_finger", slides)}
    assert [lines[key].count for key in ("line 1", "line 2", "cotton")] == [4, 4, 5]
    assert lines["line 1"].error < 3.0 and lines["cotton"].low > 0
    names = [name for name in slides if name.startswith("Board")]
    for given, out in folds(names, lambda name: cpm_finger.value_of("speed", name), one_by_one=True):
        assert {cpm_finger.value_of("speed", name) for name in out}.isdisjoint(
            cpm_finger.value_of("speed", name) for name in given
        )


def test_amplitudes_are_those_of_the_waves():
    t = PERIOD_S * np.arange(540)
    felt = 50 + 30 * np.sin(2 * np.pi * 0.5 * t) + 4 * np.cos(2 * np.pi * 1.5 * t + 1)
    found = cpm_finger.harmonics(np.repeat(felt[:, None], 16, axis=1), t, 0.502)
    assert found == pytest.approx([30, 0, 4, 0], abs=0.02)


def test_laws_of_a_material_are_asked_of_it_alone(slides):
    keys = [aim.key for aim in cpm_finger.AIMS]
    of = {name: [key for key in keys if cpm_finger.points(key, slides[name]) is not None] for name in slides}
    assert of["Board10mm_F120_V-5mmps_0"] == ["noise", "line 1", "line 2"]
    assert of["BeigeCotton_F120_V-10mmps_0"] == ["cotton"]
    other = cpm_finger.slide("Denim_F120_V-10mmps_0", cotton(120, np.random.default_rng(0)))
    assert not [key for key in keys if cpm_finger.points(key, other) is not None]
    with pytest.raises(ValueError, match="expected a name"):
        cpm_finger.value_of("grip", "Board10mm")
