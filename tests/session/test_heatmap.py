"""Pictures of taxels: each where it lies, brighter where the force is larger."""

import numpy as np
import pytest
from rich.console import Console

import firmware_protocols as fp
from tactemu.session.heatmap import SHADES, draw, draw_all, flattened, taxel_magnitudes


def rows(text) -> list[str]:
    return text.plain.split("\n")


def test_a_grid_is_drawn_row_by_row():
    layout = fp.grid_layout(3, 4, 0.002)
    values = np.zeros(12)
    values[6] = 2.0
    values[11] = 1.0
    picture = rows(draw(layout, values, 2.0))
    assert [len(row) for row in picture] == [8, 8, 8]
    assert picture[1][4:6] == SHADES[-1] * 2
    assert picture[2][6:8] not in (SHADES[0] * 2, SHADES[-1] * 2)
    assert picture[0] == SHADES[0] * 8


def test_a_free_layout_is_drawn_by_position():
    layout = fp.create("anyskin").layout
    picture = rows(draw(layout, np.array([0, 0, 1.0, 0, 0]), 1.0))
    assert picture[1][4:6] == SHADES[-1] * 2, "chip 2 is to the right"
    assert [row.strip(" ") != "" for row in picture] == [True] * 3


@pytest.mark.parametrize(
    ("device", "name", "size"),
    [("fulai_glove", "palm", (3, 14)), ("brainco_revo3", "thumb pad", (10, 6)), ("ghand5", "index", (7, 5))],
)
def test_a_free_patch_is_drawn_at_its_own_pitch(device, name, size):
    """Other patches of the device may be finer: at their pitch, rows and columns would stay empty."""
    layout = fp.create(device).layout
    (patch,) = (each for each in layout.patches if each.name == name)
    picture = rows(draw(layout, np.ones(len(layout)), 1.0, patch=patch))
    assert (len(picture), len(picture[0]) // 2) == size


def test_seen_from_outside_right_is_right():
    """A patch that faces down, seen from below: x still to the right, so y turns round."""
    positions, normals = np.array([(0.01, 0.02, 0.0)]), np.array([(0.0, 0.0, -1.0)])
    np.testing.assert_allclose(flattened(positions, normals), [(0.01, -0.02)])


@pytest.mark.parametrize(
    ("senses", "values", "number"),
    [
        ("force", [(0.3, 0.4, -2.0)], 2.0),
        ("pressure", [5.0], 5.0),
        ("displacement", [(3e-3, 0.0, 4e-3)], 5e-3),
        ("touch", [True], 1.0),
    ],
)
def test_what_is_felt_is_one_number(senses, values, number):
    layout = fp.grid_layout(1, 1, 0.002)
    np.testing.assert_allclose(taxel_magnitudes(layout, senses, np.array(values)), [number])


def test_nothing_felt_is_no_division_by_zero():
    layout = fp.grid_layout(1, 2, 0.002)
    assert draw(layout, np.zeros(2), 0.0).plain == SHADES[0] * 4


def printed(layout, values, width, height) -> list[str]:
    console = Console(width=width)
    with console.capture() as capture:
        console.print(draw_all(layout, values, 1.0, width, height))
    return capture.get().splitlines()


@pytest.mark.parametrize(("width", "height"), [(76, 14), (36, 14), (76, 5), (200, 60)])
@pytest.mark.parametrize("name", ["inspire_rh56dftp", "linker_hand_l6", "flexitac", "icub_skin"])
def test_all_patches_fit_the_room_and_the_strongest_taxel_is_seen(name, width, height):
    layout = fp.create(name).layout
    values = np.zeros(len(layout))
    values[3] = 1.0
    lines = printed(layout, values, width, height)
    assert len(lines) <= height and max(map(len, lines)) <= width
    assert SHADES[-1] in "".join(lines)
    if height >= 14:
        assert all(patch.name in "".join(lines) for patch in layout.patches if len(layout.patches) > 1)


def test_a_large_pad_is_pooled_not_cut():
    layout = fp.grid_layout(96, 200, 0.002)
    values = np.zeros(96 * 200)
    values[-1] = 1.0
    lines = printed(layout, values, 76, 14)
    assert 7 <= len(lines) <= 14 and lines[-1].rstrip().endswith(SHADES[-1] * 2)


def test_what_does_not_fit_at_all_is_counted():
    layout = fp.create("inspire_rh56dftp").layout
    lines = printed(layout, np.zeros(len(layout)), 36, 3)
    assert len(lines) <= 3 and lines[-1].endswith(" more patches")
