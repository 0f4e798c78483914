"""A value of a wrong type is refused where it is given: when a model, a transducer or a shape is made."""

import dataclasses
import typing
from typing import Any

import numpy as np
import pytest

import tactemu as tt
from tactemu.geometry.shapes.registry import SHAPES, shape_class
from tactemu.sensors.models import MODELS, model_class
from tactemu.transducers.material import Material
from tactemu.transducers.registry import TRANSDUCERS, transducer_class

GROUPS = (tt.ImperfectionOptions, tt.ElectronicsOptions, tt.DrawOptions)
NEEDED: dict[str, dict[str, Any]] = {
    "sphere": {"radius": 0.01},
    "box": {"size": (0.01, 0.01, 0.01)},
    "cylinder": {"radius": 0.01, "length": 0.01},
    "capsule": {"radius": 0.01, "length": 0.01},
    "mesh": {"source": "part.stl"},
    "voxel_grid": {"values": np.ones((2, 2, 2)), "origin": (0, 0, 0), "cell": 0.01},
}
"""The options that a shape needs."""
CLASSES: dict[str, tuple[type, dict[str, Any]]] = {
    **{name: (model_class(name), {}) for name in MODELS},
    **{group.__name__: (group, {}) for group in GROUPS},
    **{name: (shape_class(name), NEEDED.get(name, {})) for name in SHAPES},
    **{name: (transducer_class(name), {}) for name in TRANSDUCERS},
}
OPTIONS = [
    (name, each.name)
    for name, (made, _needed) in CLASSES.items()
    for each in dataclasses.fields(made)
    if each.init and typing.Any not in typing.get_args(typing.get_type_hints(made)[each.name])
]


py: Any = tt
"""The package for calls that a type checker would refuse."""


class Odd:
    """A value that no option takes."""


@pytest.mark.parametrize(("name", "option"), OPTIONS)
def test_no_option_takes_an_object_of_another_kind(name, option):
    made, needed = CLASSES[name]
    with pytest.raises(tt.SceneError, match=rf"{made.__name__}: {option} must be .*, got <"):
        made(**{**needed, option: Odd()})


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: py.KinematicTaxel(normal_stiffness="a"),
            "KinematicTaxel: normal_stiffness must be a number >= 0, got the text 'a'",
        ),
        (lambda: py.KinematicTaxel(normal_stiffness=-1), "KinematicTaxel: normal_stiffness must be >= 0, got -1"),
        (
            lambda: py.KinematicTaxel(clamp_adhesion=1),
            "KinematicTaxel: clamp_adhesion must be true or false, got 1",
        ),
        (lambda: py.KinematicTaxel(convention="mujoco"), "convention must be one of skin, genesis, got 'mujoco'"),
        (lambda: py.KinematicTaxel(electronics=0.1), "electronics must be of type ElectronicsOptions, got 0.1"),
        (lambda: py.ProximityTaxel(n_sample_points=1.5), "n_sample_points must be a whole number, got 1.5"),
        (lambda: py.ProximityTaxel(n_sample_points=["a"]), "n_sample_points must be numbers, got ['a']"),
        (
            lambda: py.ElectronicsOptions(noise="loud"),
            "ElectronicsOptions: noise must be a number, got the text 'loud'",
        ),
        (lambda: py.ElectronicsOptions(noise=["loud"]), "ElectronicsOptions: noise must be numbers, got ['loud']"),
        (lambda: py.ElectronicsOptions(scan_order="spiral"), "scan_order must be one of taxel, row, column"),
        (lambda: Material(last=1e-3), "Material: last must be after first"),
        (lambda: py.Box(size=(1, 2)), "Box: size must be 3 numbers, got (1, 2)"),
        (lambda: py.Sphere(radius="1 mm"), "Sphere: radius must be a number > 0 m, got the text '1 mm'"),
        (lambda: py.Mesh(source="part.stl", scale="mm"), "Mesh: scale must be a number, got the text 'mm'"),
    ],
)
def test_a_wrong_value_is_told_with_what_was_expected(make, message):
    with pytest.raises(tt.SceneError) as error:
        make()
    assert message in str(error.value)


def test_what_a_type_allows_is_taken():
    body = tt.Scene().add_body(None)
    for given in (
        {"gain": 1.0}, {"gain": np.ones(4)}, {"gain": [1, 2]}, {"gain_range": None}
    ):  # fmt: skip
        py.ImperfectionOptions(**given)
    for bodies in (None, 0, "ball", body, [0, "ball", body], (), np.array([0, 1])):
        py.KinematicTaxel(sense=bodies)
    tt.ProximityTaxel(points=[np.zeros((3, 3)), [(0, 0, 0)]])
    tt.ElectronicsOptions(scan_order=[0, 1, 2, 3], history_length=3)
    tt.KinematicTaxel(adjustable=["noise"])
    tt.Mesh(source=(np.zeros((3, 3)), np.zeros((1, 3), int)), scale=(1e-3, 1e-3, 1e-3))


def test_the_checks_are_those_of_the_constructor_alone(monkeypatch):
    """Neither build nor step checks the types again."""
    scene = tt.Scene()
    pad = scene.add_body(None)
    scene.add_sensor(tt.KinematicTaxel(), link=pad)
    calls = []
    monkeypatch.setattr("tactemu.base.option_groups.check_declared", lambda *given: calls.append(given))
    sim = scene.build()
    assert [type(options).__name__ for _where, options in calls] == ["ChainOptions"]
    sim.step(10)
    assert len(calls) == 1
