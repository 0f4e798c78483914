"""The measures of `tactemu tune`: each is right for a known error, and the default follows what a scene shows."""

import dataclasses

import numpy as np
import pytest

from firmware_protocols.devices.anyskin import AnySkin
from firmware_protocols.layouts import Layout, Patch, grid_layout
from firmware_protocols.senses import Sense
from tactemu.tune.errors import ERRORS, Comparison, Criterion, border, neighbours

GRID = grid_layout(16, 16, 1e-3)
X, Y = GRID.positions[:, 0], GRID.positions[:, 1]


def skin(*senses, layout=GRID):
    """Return a device with this skin and these senses."""
    device = AnySkin()
    device.layout, device.senses = layout, senses or ("force",)
    return device


def ball(radius, drag=0.0):
    """Return the forces of a ball pressed in four moments, with a drag to +x relative to its pressure."""
    pressure = np.sqrt(np.maximum(0, 1 - (X**2 + Y**2) / radius**2))
    return np.arange(1, 5)[:, None, None] * pressure[:, None] * np.array([drag, 0.0, -1.0])


def box(drag=0.0):
    """Return the forces of a box, pressed flat."""
    inside = (np.abs(X) < 4e-3) & (np.abs(Y) < 3e-3)
    return np.ones((4, 1, 1)) * inside[:, None] * np.array([drag, 0.0, -1.0])


@pytest.mark.parametrize(
    ("truth", "judged"),
    [
        (ball(6e-3), ("pressure",)),
        (ball(6e-3, drag=0.01), ("pressure",)),
        (ball(6e-3, drag=0.3), ("pressure", "drag")),
        (ball(1e-3), ("pressure", "edges")),
        (box(), ("pressure", "edges")),
        (box(drag=0.3), ("pressure", "drag", "edges")),
    ],
)
def test_the_default_follows_the_scene_and_says_why(truth, judged):
    criterion = Comparison(truth, skin()).criterion()
    assert criterion.measures == judged and set(criterion.reasons) == {"pressure", "drag", "edges"}
    assert ("no body slides" in criterion.reasons["drag"]) == ("drag" not in judged)
    assert ("no edge" in criterion.reasons["edges"]) == ("edges" not in judged)


def test_the_default_follows_what_the_device_reads():
    slide = box(drag=0.3)
    assert Comparison(slide, skin("wrench")).criterion().measures == ("total", "drag")
    assert Comparison(slide, skin("vibration")).criterion().measures == ("total",)
    assert Comparison(slide, skin("force", "wrench")).criterion().measures == ("pressure", "total", "drag", "edges")
    assert Comparison(-slide[..., 2], skin("pressure")).criterion().measures == ("pressure", "edges")
    assert Comparison(slide, skin("displacement")).criterion().measures == ("pressure", "drag")
    assert Comparison(slide, skin("temperature")).criterion().measures == ("pressure", "drag", "edges")


def test_each_measure_sees_its_own_error():
    truth = box(drag=0.3)
    comparison = Comparison(truth, skin())
    assert comparison.measures == tuple(ERRORS) and set(comparison.errors(truth).values()) == {0.0}
    wrong = comparison.errors(truth * [1.2, 1.0, 1.0])
    assert wrong["drag"] == pytest.approx(0.2) and wrong["pressure"] == 0.0 and 0 < wrong["total"] < 0.1
    wrong = comparison.errors(truth * [1.0, 1.0, 1.1])
    assert wrong["pressure"] == pytest.approx(0.1) and wrong["drag"] == pytest.approx(0.0, abs=1e-12)
    inner = (np.abs(X) < 2e-3) & (np.abs(Y) < 1e-3)
    wrong = comparison.errors(truth * np.where(inner, 1.5, 1.0)[:, None])
    assert wrong["edges"] == 0.0 and wrong["pressure"] > 0.1
    beside = (X > 4e-3) & (X < 5e-3) & (np.abs(Y) < 3e-3)
    wrong = comparison.errors(truth + beside[:, None] * np.array([0.0, 0.0, -1.0]))
    assert wrong["edges"] > wrong["pressure"] > 0.1


def test_a_measure_without_a_true_value_is_left_out():
    assert "drag" not in Comparison(ball(6e-3), skin()).measures
    assert "drag" not in Comparison(-ball(6e-3, drag=0.3)[..., 2], skin("pressure")).measures
    everywhere = np.ones((4, len(GRID), 3))
    assert "edges" not in Comparison(everywhere, skin()).measures


def test_drags_of_two_pads_are_not_summed_with_each_other():
    pads = Layout(
        positions=np.concatenate([GRID.positions, GRID.positions + np.array([0.1, 0.0, 0.0])]),
        normals=np.tile(GRID.normals, (2, 1)),
        patches=(GRID.patches[0], dataclasses.replace(GRID.patches[0], name="other", start=len(GRID))),
    )
    apart = np.concatenate([box(drag=0.3), box(drag=-0.3)], axis=1)
    comparison = Comparison(apart, skin(layout=pads))
    assert comparison.drag_share == pytest.approx(0.3)
    assert comparison.errors(apart * [0.0, 1.0, 1.0])["drag"] == pytest.approx(1.0)


def test_the_border_lies_on_both_sides_and_not_at_the_rim_of_the_skin():
    grid = grid_layout(5, 5, 1e-3)
    touched = np.zeros((1, 25), bool)
    touched[0, :15] = True  # three rows of five
    assert np.flatnonzero(border(grid, touched)).tolist() == list(range(10, 20))
    assert len(neighbours(grid)) == 40


def test_neighbours_of_a_free_layout_are_the_nearest_taxels():
    grid = grid_layout(5, 5, 1e-3)
    free = dataclasses.replace(grid, patches=(Patch(name="free", start=0, rows=0, cols=25),))
    assert {tuple(pair) for pair in neighbours(free)} == {tuple(pair) for pair in neighbours(grid)}
    one = dataclasses.replace(grid_layout(1, 1, 1e-3), patches=(Patch(name="free", start=0, rows=0, cols=1),))
    assert not len(neighbours(one))


def test_the_largest_of_the_measures_decides():
    assert Criterion(("pressure", "drag")).error({"pressure": 0.1, "drag": 0.2, "edges": 0.9}) == 0.2


def test_a_sense_with_a_layout_of_its_own_counts():
    device = skin(Sense("wrench", at=grid_layout(1, 1, 1e-3)))
    assert Comparison(box(), device).criterion().measures == ("total",)
