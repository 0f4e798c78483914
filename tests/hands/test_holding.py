"""Hands hold by touch, moved by their own SDKs in a process of its own; MuJoCo's contact forces judge it."""

import numpy as np
import pytest

from tests.hands.holding import ALL, OBJECTS, hold, newtons_of, poses

pytestmark = [pytest.mark.driver, pytest.mark.timeout(180)]
L6 = ALL["linker_l6"]


@pytest.mark.parametrize(("thing", "pose"), [("ball", 1), ("box", 0)])
def test_a_linker_hand_holds_at_its_set_force(thing, pose, tmp_path):
    held = hold(L6, thing, poses(10)[pose], tmp_path, settle_s=2.5, hold_s=0.5, late_s=10)
    assert held.right(newtons_of(L6, thing), L6.resolution_n), held


@pytest.mark.nightly
@pytest.mark.timeout(600)
@pytest.mark.parametrize("thing", OBJECTS)
@pytest.mark.parametrize("name", ALL)
def test_a_hand_holds_from_ten_starting_poses(name, thing, tmp_path):
    hand, want = ALL[name], newtons_of(ALL[name], thing)
    held = [hold(hand, thing, pose, tmp_path) for pose in poses(10)]
    assert not [each for each in held if not each.right(want, hand.resolution_n)]


@pytest.mark.nightly
def test_dead_taxels_break_the_egg(tmp_path):
    """The controller feels less than there is, and presses on."""
    whole = hold(L6, "egg", poses(10)[0], tmp_path)
    assert whole.right(1.0, L6.resolution_n), whole
    blind = [taxel for taxel in range(2 * 72) if taxel % 4]
    broken = hold(L6, "egg", np.zeros(3), tmp_path, dead=blind)
    assert broken.broken == ["object"], broken


@pytest.mark.nightly
def test_what_is_held_stays_in_the_hand_when_the_cable_is_pulled(tmp_path):
    """The controller hears nothing any more; the motors go on."""
    held = hold(L6, "ball", poses(10)[0], tmp_path, faults=("unplug at 6s",))
    assert held.right(1.0, L6.resolution_n), held
