"""A press has the same names and the same speed in a scene, live, and on the command line; a pose is set likewise."""

import dataclasses
import inspect

import numpy as np
import pytest

import tactemu as tt
from tactemu.base.errors import TactemuError
from tactemu.control.control_commands import CONTROL_COMMANDS, ControlCommands
from tactemu.sensors.simulation import Simulation
from tactemu.session.serving import Served

OWN = {"self", "taxel", "body", "skin", "wait"}
"""The arguments of a live press that name what presses where."""


def test_a_live_press_takes_names_of_the_motion():
    fields = {field.name: field.default for field in dataclasses.fields(tt.Press)}
    live = inspect.signature(Served.press).parameters
    assert live.keys() - OWN == {"depth", "approach", "speed", "dwell"} <= fields.keys()
    assert live["approach"].default == fields["approach"]
    assert live["speed"].default == fields["speed"] == inspect.signature(Served.release).parameters["speed"].default
    positional = [name for name, each in live.items() if each.kind is each.POSITIONAL_OR_KEYWORD]
    assert positional == ["self", "depth"]


def test_the_command_line_and_the_socket_have_the_same_names(monkeypatch, capsys):
    from tactemu.cli import control

    assert CONTROL_COMMANDS["press"].arguments.keys() >= {"depth", "approach", "speed", "dwell"}
    with pytest.raises(SystemExit):
        control.main(["press", "--help"])
    help_text = capsys.readouterr().out
    assert (
        all(f"--{name}" in help_text for name in ("depth", "approach", "speed", "dwell")) and "--for" not in help_text
    )


def touched(dev, step_s=1e-3):
    """Times [s] at which the only taxel is pressed, until it no longer is."""
    times, t = [], 0.0
    while not times or t - times[-1] < 0.05:
        t = dev.step(seconds=step_s)
        if dev.sample().ideal[0, 2] < 0:
            times.append(t)
        assert t < 10
    return times


def test_approach_speed_and_dwell_are_those_of_the_motion(tmp_path):
    """The same press, by a motion and by hand: the skin is touched for as long."""
    scene = "[[body]]\nname = 'pad'\nshape = 'frame'\nfixed = true\n"
    ball = "[[body]]\nname = 'ball'\nshape = 'sphere'\nradius = 0.01\nposition = [0.0, 0.0, 0.012]\n"
    skin = "[[skin]]\ndevice = 'anyskin'\nlink = 'pad'\nrate_hz = 1000\n"
    motion = "motion = { kind = 'press', approach = 0.002, depth = 0.001, speed = 0.02, dwell = 0.1 }\n"
    (tmp_path / "moved.toml").write_text(scene + ball + motion + skin)
    (tmp_path / "held.toml").write_text(scene + ball + skin)
    with tt.serve(tmp_path / "moved.toml", "memory:", clock="lockstep") as dev:
        moved = touched(dev)
    with tt.serve(tmp_path / "held.toml", "memory:", clock="lockstep") as dev:
        dev.press(depth=1e-3, approach=2e-3, speed=0.02, dwell=0.1, taxel=0)
        held = touched(dev)
    assert held[-1] - held[0] == pytest.approx(0.1 + 2 * 1e-3 / 0.02, abs=3e-3)
    assert held[-1] - held[0] == pytest.approx(moved[-1] - moved[0], abs=3e-3)


def test_a_pose_is_set_by_name_live_as_in_a_simulation():
    live = inspect.signature(ControlCommands.set_pose).parameters
    simulated = inspect.signature(Simulation.set_pose).parameters
    assert live.keys() <= simulated.keys()
    assert {each.kind for each in (live["position"], simulated["position"])} == {inspect.Parameter.KEYWORD_ONLY}
    with tt.serve("anyskin", "memory:", clock="lockstep") as dev:
        dev.set_pose("ball", position=np.array([0, 0, 0.03]), quaternion=(0.6, 0.8, 0, 0))
        dev.step(seconds=1e-3)
        turned = dev.state()["bodies"]["ball"]["quaternion"]
        dev.set_pose("ball", quaternion=(1, 0, 0, 0))
        dev.set_pose("ball", quaternion=(0.8, 0, 0, 0.6), order="xyzw")
        dev.step(seconds=1e-3)
        assert dev.state()["bodies"]["ball"]["quaternion"] == turned == pytest.approx([0.6, 0.8, 0, 0])
        dev.move(quaternion=(0, 0, 0, 1), order="xyzw", body="ball", wait=False)
        with pytest.raises(TactemuError, match="order must be one of wxyz, xyzw"):
            dev.set_pose("ball", quaternion=(1, 0, 0, 0), order="zyx")
        with pytest.raises(TypeError, match="positional"):
            dev.set_pose("ball", (0, 0, 0.03))
