"""The colours: all are told apart and read by colour-blind eyes, on a light and on a dark page, and have one owner."""

import itertools
import re

import numpy as np
import pytest

from tactemu.base import style
from tests.cli.command import ROOT

EYES = {
    "usual": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.3039]],
}
"""What these eyes see of linear RGB, after Machado, Oliveira and Fernandes (2009), at full severity."""
OWNERS = {"tactemu/base/style.py", "firmware_protocols/layouts.py"}


def linear(colour: str) -> np.ndarray:
    """Of sRGB, as light adds up."""
    share = style.rgb(colour)
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def oklab(colour: str, eyes: str) -> np.ndarray:
    """Lightness (0 to 100) and two axes of colour as these eyes see them; a distance of 2 is just seen."""
    light = np.clip(np.array(EYES[eyes]) @ linear(colour), 0, 1)
    cones = [
        [0.41222147, 0.53633254, 0.05144599],
        [0.2119035, 0.68069955, 0.10739696],
        [0.08830246, 0.28171884, 0.62997870],
    ]
    axes = [
        [0.21045426, 0.79361779, -0.00407205],
        [1.9779985, -2.42859221, 0.4505937],
        [0.02590404, 0.78277177, -0.80867577],
    ]
    return 100 * np.array(axes) @ np.cbrt(np.array(cones) @ light)


def contrast(a: str, b: str) -> float:
    """As WCAG defines it: 1 to 21."""
    dark, bright = sorted(float(linear(each) @ [0.2126, 0.7152, 0.0722]) for each in (a, b))
    return (bright + 0.05) / (dark + 0.05)


def apart(a: str, b: str, eyes: str) -> float:
    return float(np.linalg.norm(oklab(a, eyes) - oklab(b, eyes)))


@pytest.mark.parametrize("eyes", EYES)
def test_colours_of_data_are_told_apart(eyes):
    for a, b in itertools.combinations(style.SERIES, 2):
        assert apart(a, b, eyes) > 7.5, (a, b)
    for theme in zip(*style.THEMES.values()):
        named = dict(zip(style.THEMES, theme))
        assert apart(named["good"], named["bad"], eyes) > 7.5  # each also has its sign


@pytest.mark.parametrize("eyes", EYES)
def test_the_scale_of_readings_only_gets_lighter(eyes):
    lightness = [oklab(colour, eyes)[0] for colour in style.RAMP]
    steps = np.diff(lightness)
    assert (steps > 2.5).all() and steps.max() < 11
    assert min(apart(style.NAN, colour, eyes) for colour in style.RAMP) > 7.5


@pytest.mark.parametrize("theme", [0, 1])
def test_all_is_seen_on_the_page(theme):
    named = {name: pair[theme] for name, pair in style.THEMES.items()}
    for ground in ("page", "panel"):
        for text in ("text", "muted", "link", "good", "odd", "bad"):
            assert contrast(named[text], named[ground]) >= 4.5, (text, ground)
        for colour in style.SERIES:
            assert contrast(colour, named[ground]) >= 2.7, (colour, ground)
    assert contrast(named["text"], named["mark"]) >= 4.5


def test_colours_are_between_those_of_the_scale():
    shown = style.colours(np.array([-1.0, 0.0, 1.0, 2.0, np.inf, np.nan]))
    lowest, largest = style.RAMP[0], style.RAMP[-1]
    assert (shown == [style.rgb(each) for each in (lowest, lowest, largest, largest, largest, style.NAN)]).all()
    assert style.colours(np.zeros((2, 3))).shape == (2, 3, 3)


def test_a_picture_follows_its_page():
    drawn = f'<svg><path stroke="{style.BLUE}"/><text fill="{style.LIGHT["text"]}">a</text><path fill="#123456"/></svg>'
    assert re.findall(r'="([^"]*)"', style.themed(drawn)) == ["var(--series-1)", "var(--text)", "#123456"]


def test_no_other_file_has_colours_or_rules():
    for path in [*(ROOT / "tactemu").rglob("*.py"), *(ROOT / "benchmarks").rglob("*.py"), ROOT / "docs/site/hooks.py"]:
        name = path.relative_to(ROOT).as_posix()
        if name not in OWNERS:
            found = re.findall(
                r"[\"' :=]#(?:[0-9a-fA-F]{3}|[0-9a-fA-F]{6})\b|<style>[^{.]|\brgba?\((?!0,0,0,0)\d", path.read_text()
            )
            assert not found, (name, found)
