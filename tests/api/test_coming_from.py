"""The conventions at which users of other simulators stumble: each has a row in docs/coming-from.md, or a message."""

import inspect
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tactemu as tt

PAGE = (Path(__file__).parents[2] / "docs" / "coming-from.md").read_text()
SQUARE = np.array([(0.0, 0, 0), (0.01, 0, 0), (0.01, 0.01, 0), (0, 0.01, 0), (0.005, 0.005, 0.01)])
FACES = np.array([(0, 2, 1), (0, 3, 2), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)])
py: Any = tt
"""The package for calls that a type checker would refuse."""


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: py.Box(half_extents=(1, 1, 1)), "Box has no option 'half_extents'; give size=(x, y, z), full extents"),
        (lambda: py.Box(hx=0.1, hy=0.1, hz=0.1), "Box has no option 'hx'; give size=(x, y, z), full extents [m]"),
        (lambda: py.Cylinder(radius=0.01, height=0.1), "no option 'height'; give length=, the full extent along z"),
        (lambda: py.Capsule(radius=0.01, half_height=0.1), "give length=, the full extent of the straight part"),
        (lambda: py.Sphere(diameter=0.1), "Sphere has no option 'diameter'; give radius= [m]"),
        (lambda: py.Mesh(vertices=SQUARE, faces=FACES), "Mesh has no option 'vertices'; give source=(vertices, faces)"),
        (lambda: py.Mesh(file="a.stl"), "Mesh has no option 'file'; give source=, the file"),
        (lambda: py.Sphere(radus=0.1), "Sphere has no option 'radus'; did you mean 'radius'?"),
    ],
)
def test_the_words_of_other_simulators_for_extents_and_meshes_are_answered_with_ours(make, message):
    with pytest.raises(TypeError, match=re.escape(message)):
        make()


def test_extents_are_full():
    assert tt.Box(size=(0.02, 0.04, 0.06)).reach("box", np.array([0, 0, 1.0])) == pytest.approx(0.03)
    assert tt.Cylinder(radius=0.01, length=0.06).reach("rod", np.array([0, 0, 1.0])) == pytest.approx(0.03)
    assert tt.Capsule(radius=0.01, length=0.06).reach("rod", np.array([0, 0, 1.0])) == pytest.approx(0.04)
    assert tt.Mesh(source=(SQUARE, FACES)).reach("part", np.array([0, 0, 1.0])) == pytest.approx(0.01)


def test_quaternions_come_in_either_order():
    scene = tt.Scene()
    half_turn = scene.add_body(tt.Box(size=(0.02, 0.02, 0.02)), quaternion=(0, 0, 0, 1))
    unturned = scene.add_body(tt.Box(size=(0.02, 0.02, 0.02)), quaternion=(0, 0, 0, 1), order="xyzw")
    assert half_turn.quaternion == (0, 0, 0, 1) and unturned.quaternion == (1, 0, 0, 0)
    sim = scene.build()
    sim.set_pose(unturned, quaternion=(0, 0, 0, 1), order="xyzw")
    assert np.allclose(sim.pose(unturned).quaternion, (1, 0, 0, 0))


NAMED = {
    tt.Scene.add_body: ("position", "quaternion", "order", "fixed", "motion"),
    tt.Scene.add_sensor: ("link",),
    tt.Scene.build: ("n_envs", "device"),
    tt.KinematicTaxel: ("positions", "normals", "radius", "position", "quaternion", "sense", "ignore"),
}


@pytest.mark.parametrize("function", NAMED, ids=lambda function: function.__qualname__)
def test_the_page_names_keywords_that_there_are(function):
    assert set(NAMED[function]) <= set(inspect.signature(function).parameters)
    for name in NAMED[function]:
        assert re.search(rf"`[^`]*\b{name}\b[^`]*`", PAGE), name


def test_attributes_that_the_page_names_are_there():
    scene = tt.Scene()
    pad = scene.add_body(tt.Box(size=(0.02, 0.02, 0.02)))
    skin = scene.add_sensor(tt.KinematicTaxel(), link=pad)
    sim = scene.build(2)
    for owner, handle in (("sim", sim), ("skin", skin)):
        for name in set(re.findall(rf"`[^`]*\b{owner}\.(\w+)[^`]*`", PAGE)):
            assert hasattr(handle, name), f"{owner}.{name}"
