"""Schedules: each event at its time, in the truth log, and over when it says."""

import numpy as np
import pytest

from tactemu.base.clock import VirtualClock
from tactemu.base.errors import SceneError
from tactemu.emulator.assembly import assemble
from tactemu.emulator.options import AssemblyOptions
from tactemu.emulator.scenario import faults_of
from tactemu.scene.events import Event, timed_fault
from tactemu.scene.file import default_scene, parse
from tactemu.session.serving import serve
from tactemu.truth import Truth
from tests.scenes import ball, pad

SCENE = (
    pad()
    + ball(0.02, [0, 0, 0.019])
    + """
[[skin]]
device = "anyskin"
link = "pad"
port = "memory:"
"""
)


def run(events: str, seconds: float = 1.0) -> Truth:
    """The truth of a ball held 1 mm deep in chip 0, with a schedule."""
    emulator = assemble(parse(SCENE + events)).emulator
    emulator.clock = VirtualClock()
    with emulator:
        emulator.run(seconds)
    return emulator.truth


def measured(truth: Truth, taxel: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and normal force [N] of one taxel."""
    return (
        np.array([s.t_ns for s in truth.samples if s.t_ns]) / 1e9,
        np.array([s.measured[taxel][2] for s in truth.samples if s.t_ns]),
    )


def test_a_taxel_dies_and_is_revived():
    truth = run("[[scenario]]\nat = 0.3\nuntil = 0.6\ndead = [0]\nvalue = 7.0\n")
    t, force = measured(truth)
    np.testing.assert_array_equal(force == 7.0, (t > 0.3) & (t <= 0.6))
    assert force[0] == pytest.approx(-1.0, abs=1e-5)
    assert truth.injected == {"dead": 1, "revived": 1}
    assert {s.ideal[0][2] for s in truth.samples if s.t_ns} == {force[0]}, "the truth does not die"


def test_an_option_changes_and_changes_back():
    truth = run("[[scenario]]\nat = 0.5\nuntil = 0.7\nset = { bias = 0.25 }\n")
    t, force = measured(truth)
    np.testing.assert_allclose(force, np.where((t > 0.5) & (t <= 0.7), -0.75, -1.0), atol=1e-5)


def test_a_device_hangs_and_goes_on():
    truth = run("[[scenario]]\nat = 0.4\nuntil = 0.6\nhang = true\n")
    t, _ = measured(truth)
    assert not ((t > 0.4) & (t < 0.6)).any()
    assert (t < 0.4).sum() == 39 and (t >= 0.6).sum() == 40
    assert truth.injected == {"hang": 1}


def test_a_device_restarts():
    truth = run("[[scenario]]\nat = 0.405\nreset = true\n")
    t, _ = measured(truth)
    assert truth.injected == {"reset": 1}
    np.testing.assert_allclose(t[t > 0.405][:2], (0.415, 0.425), atol=1e-9, err_msg="it counts from its restart")


def test_without_events_no_stage_is_built():
    bare = assemble(parse(SCENE)).simulation.plan.stages
    more = assemble(parse(SCENE + "[[scenario]]\nat = 1\nset = { noise = 0.1 }\n")).simulation.plan.stages
    assert len(more) > len(bare)


def test_faults_get_the_time_of_their_event():
    events = [
        Event(at=3, fault="unplug for 0.5s"),
        Event(at=5, until=6, fault="truncate 5%"),
        Event(at=1.5, fault="drop 1%", skin="other"),
    ]
    assert [str(fault) for fault in faults_of(events, ["anyskin"])] == [
        "unplug at 3000000000ns for 0.5s",
        "truncate 5% from 5000000000ns to 6000000000ns",
    ]
    assert str(faults_of(events, ["other"])[-1]) == "drop 1% from 1500000000ns"


@pytest.mark.parametrize(
    ("event", "says"),
    [
        ("at = 1\ndead = [9]", r"^scene: scenario\[0\]: dead: expected taxels 0\.\.4 of 'anyskin', got \[9\]"),
        ("at = 1\nhang = true", "give its end with `until`"),
        ("at = 1\nset = { nois = 1.0 }", "'nois' cannot change; did you mean 'noise'"),
        ('at = 1\nfault = "drop 1% from 2s"', "time as the event's `at`"),
        ('at = 1\nuntil = 2\nfault = "unplug for 1s"', "not both"),
    ],
)
def test_mistakes_are_found_before_anything_runs(event, says):
    with pytest.raises(SceneError, match=says):
        assemble(parse(f"{SCENE}[[scenario]]\n{event}\n"))


def test_events_from_python_and_by_hand():
    with serve("anyskin", "memory:", scenario=[Event(at=0.0, dead=(1,), value=3.0)], adjustable=["bias"]) as dev:
        dev.wait(0.1)
        assert dev.sample().measured[1][2] == 3.0
        dev.inject_event(set={"bias": 0.5})
        dev.wait(0.1)
        np.testing.assert_allclose(dev.sample().measured[0], 0.5)
        with pytest.raises(SceneError, match="unknown key 'ded'; did you mean 'dead'"):
            dev.inject_event(ded=[1])
        assert dev.truth.injected == {"dead": 1, "set": 1}


NOTHING = "the event does nothing; give it `fault`, `set`, `dead`, `hang` or `reset`"


@pytest.mark.parametrize(
    ("event", "says"),
    [
        ({}, NOTHING),
        ({"at": 1.0, "until": 2.0}, NOTHING),
        ({"dead": ()}, NOTHING),
        ({"at": 2.0, "until": 2.0, "reset": True}, "until: expected a time after at = 2.0 s, got 2.0"),
        ({"value": 1.0, "reset": True}, "value: it is the reading of the taxels in `dead`"),
        ({"taxels": (1,), "dead": (1,)}, "taxels: they are those whose options `set` changes"),
        ({"hang": True}, "hang: give its end with `until`"),
        ({"fault": "unplg"}, "event: fault: 'unplg': unknown kind 'unplg'; did you mean 'unplug'?"),
        ({"fault": "drop 1% from 2s"}, "give its time as the event's `at` and `until`"),
        ({"at": -1, "reset": True}, "event: at: "),
    ],
)
def test_an_event_that_does_not_do_what_it_says_is_refused_when_it_is_made(event, says):
    with pytest.raises(SceneError) as error:
        Event(**event)
    assert str(error.value).startswith("event: ") and says in str(error.value)


def test_an_event_may_do_several_things():
    Event(at=1, until=2, fault="drop 1%", set={"noise": 0.1}, taxels=(0,), dead=(1,), value=0.0, hang=True, reset=True)
    assert str(timed_fault(Event(at=1, fault="drop 1%"), now_s=2.0)) == "drop 1% from 3000000000ns"


def test_a_range_that_was_none_is_none_again_afterwards():
    event = Event(at=0.0, until=0.05, set={"saturation_range": (0.0, 0.1), "bias": 1.0})
    emulator = assemble(default_scene("anyskin"), AssemblyOptions(port="memory:", scenario=[event])).emulator
    emulator.clock = VirtualClock()
    with emulator:
        emulator.run(0.04)
        assert emulator.truth.latest("anyskin").measured.max() == pytest.approx(0.1)
        emulator.run(0.04)
        assert not emulator.truth.latest("anyskin").measured.any()
