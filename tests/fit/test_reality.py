"""`python -m benchmarks reality`: levels of fidelity against a real skin."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks import reality
from tactemu.base.errors import TactemuError

EXCERPTS = Path(__file__).parents[1] / "data" / "real"


def test_more_of_the_material_predicts_a_real_press_better(monkeypatch, tmp_path):
    monkeypatch.setattr(reality, "LEVELS", {"L2 springs, ray": reality.LEVELS["L2 springs, ray"]})
    page = tmp_path / "reality.md"
    level, own = reality.run(lambda text: None, EXCERPTS, page)
    assert own["laws"] < level["laws"] < level["plain"] < 10
    assert "| L2 springs, ray |" in page.read_text()


def test_springs_under_a_flat_face_are_a_line():
    depths, readings, cost = reality.level_curve("L2 springs, ray")
    assert readings == pytest.approx(depths / depths[-1], abs=0.02) and cost > 0
    assert np.diff(reality.level_curve("L4 layer")[1]).min() > 0


def test_without_recordings_it_says_which_it_needs(tmp_path):
    (tmp_path / "eflesh").mkdir()
    with pytest.raises(TactemuError, match="two recordings"):
        reality.run(print, tmp_path)
