"""The public names hide none of Python's under ``import *``, and get and set by pairs of names."""

import builtins
import inspect
import typing

import tactemu as tt
from tactemu.control.control_commands import ControlCommands
from tactemu.sensors.simulation import Simulation


def test_no_public_name_hides_one_of_python():
    assert not {*tt.__all__} & {*typing.__all__, *dir(builtins)}
    assert tt.InTurn.kind == "sequence", "the word of scene files"


def test_parts_of_a_pose_are_given_by_name_everywhere():
    for method in (Simulation.set_pose, ControlCommands.set_pose, tt.Scene.add_body):
        for name in ("position", "quaternion"):
            assert inspect.signature(method).parameters[name].kind is inspect.Parameter.KEYWORD_ONLY, method
