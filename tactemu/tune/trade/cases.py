"""The contacts of `tactemu bench trade`: eight objects at four depths, pressed, slid and rolled.

Each case is run at :data:`OFFSETS`, places less than a taxel apart: errors depend on how a contact lies on the grid,
and may vanish by chance at one place.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from tactemu.geometry import rotation
from tactemu.geometry.shapes.box import Box
from tactemu.geometry.shapes.cylinder import Cylinder
from tactemu.geometry.shapes.mesh import Mesh
from tactemu.geometry.shapes.sphere import Sphere
from tactemu.plan.plan import Dtype
from tactemu.scene.scene import Scene
from tactemu.sensors.layer.elastic_layer_taxel import ElasticLayerTaxel

TOP = 0.005
"""Height of the skin's surface [m]."""
DT = 1e-3
DEPTHS = (2e-4, 5e-4, 1e-3)
LIGHT_DEPTH = 5e-5
"""Depth of a light press [m]; a thirtieth to a hundredth of the force of a press of 0.5 mm."""
LIGHTLY_PRESSED = ("sphere", "box", "cylinder", "tilted box", "free form")
"""Objects whose contact is as wide as a taxel even when they are pressed lightly."""
RIM_TILT = np.radians(25.0)
"""Angle by which a cylinder stands aslant on its rim [rad]."""
OFFSETS = ((0, 0), (5, 7), (2, 6), (7, 5))
"""Places of the object at which a case is run, in eighths of a taxel along x and y.

They are distinct modulo a taxel and half a taxel, the cells of oversampling 1 and 2, and modulo a quarter in pairs.
"""
OFFSET_STEPS = 8
"""Number of steps of an offset in a taxel."""
PRESS_STEPS = 2
MOVE_STEPS = 6
"""Number of steps of a slide or a roll. They are larger than the cells of the truth, so that the force of a slide
lacks up to 4 % in it (docs/accuracy.md says how much, and what smaller steps change)."""
SLIDE = 6e-4
"""Distance of a slide and of a roll [m]."""
ROCK = np.radians(3.0)
"""Angle by which objects that cannot roll are rocked instead [rad]."""


@dataclass(frozen=True, kw_only=True)
class TestSkin:
    """The skin that is pressed: a square of taxels on a bonded layer."""

    side: int = 32
    pitch: float = 5e-4
    young_modulus: float = 1e5
    poisson_ratio: float = 0.49
    thickness: float = 4e-3
    friction: float = 0.5

    __test__ = False  # keeps pytest from collecting the class by its name

    def positions(self) -> np.ndarray:
        """Return taxels in the pad's frame [m], ``(side, side, 3)``."""
        x = (np.arange(self.side) - (self.side - 1) / 2) * self.pitch
        return np.stack([*np.meshgrid(x, x[::-1]), np.full((self.side, self.side), TOP)], -1)

    @property
    def layer(self) -> dict[str, Any]:
        """The material of the layer, as options of ElasticLayerTaxel."""
        return {name: getattr(self, name) for name in ElasticLayerTaxel.material}


@dataclass(frozen=True)
class Indenter:
    """A shape and its orientation."""

    shape: Any
    turn: tuple[float, float, float, float]
    """The orientation (w, x, y, z)."""
    lowest: float
    """The height of the origin above the lowest point [m]."""
    rolling_radius: float | None = None
    """The radius on which it rolls [m]; None: it is rocked."""


def _tilted(shape: Any, corners: np.ndarray, vector) -> Indenter:
    turn = rotation.from_rotation_vector(np.asarray(vector, float))
    return Indenter(shape, tuple(turn), -float(rotation.rotate(turn, corners)[:, 2].min()))


def _box_corners(size) -> np.ndarray:
    return np.array(list(np.ndindex(2, 2, 2)), float) @ np.diag(size) - np.asarray(size) / 2


def _on_its_rim(radius: float, length: float) -> Indenter:
    """Return a cylinder that stands aslant, on one point of its rim."""
    turn = rotation.from_rotation_vector(np.array([0.0, RIM_TILT, 0.0]))
    lowest = radius * np.sin(RIM_TILT) + 0.5 * length * np.cos(RIM_TILT)
    return Indenter(Cylinder(radius=radius, length=length), tuple(turn), float(lowest))


def _wedge() -> tuple[np.ndarray, np.ndarray]:
    """Return a prism with an edge of 30 degrees along y, 8 mm long, pointing down."""
    half, height, length = 6e-3 * np.tan(np.radians(15)), 6e-3, 8e-3
    triangle = np.array([[0, 0], [half, height], [-half, height]])
    vertices = np.array([[x, y, z] for y in (-length / 2, length / 2) for x, z in triangle])
    faces = [[0, 1, 2], [3, 5, 4], [0, 3, 4], [0, 4, 1], [1, 4, 5], [1, 5, 2], [2, 5, 3], [2, 3, 0]]
    return vertices, np.array(faces)


def _pebble() -> tuple[np.ndarray, np.ndarray]:
    """Return a free form: a ball of 5 mm with bumps of a few tenths of a millimetre."""
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=5, radius=1.0)
    p = np.asarray(ball.vertices)
    bumps = 0.06 * np.sin(5 * p[:, 0] + 1) * np.cos(4 * p[:, 1]) + 0.04 * np.sin(7 * p[:, 2] - 2 * p[:, 0])
    return p * (5e-3 * (1 + bumps))[:, None], np.asarray(ball.faces)


@cache
def indenters() -> dict[str, Indenter]:
    """Return the objects by name."""
    upright = (1.0, 0.0, 0.0, 0.0)
    cube, block = (6e-3, 6e-3, 6e-3), (5e-3, 6e-3, 5e-3)
    wedge, pebble = _wedge(), _pebble()
    lying = rotation.from_rotation_vector(np.array([np.pi / 2, 0, 0]))
    return {
        "sphere": Indenter(Sphere(radius=5e-3), upright, 5e-3, rolling_radius=5e-3),
        "box": Indenter(Box(size=cube), upright, 3e-3),
        "box edge": _tilted(Box(size=block), _box_corners(block), (0, np.pi / 4, 0)),
        "cylinder": Indenter(Cylinder(radius=4e-3, length=8e-3), tuple(lying), 4e-3, rolling_radius=4e-3),
        "tilted box": _tilted(Box(size=cube), _box_corners(cube), (0, np.radians(5), 0)),
        "thin wedge": Indenter(Mesh(source=wedge), upright, 0.0),
        "free form": Indenter(Mesh(source=pebble), upright, -float(pebble[0][:, 2].min())),
        "rim": _on_its_rim(radius=4e-3, length=8e-3),
    }


@dataclass(frozen=True)
class Case:
    """One object, one depth, one motion."""

    object: str
    depth: float
    motion: str
    """``press``, ``slide`` or ``roll``."""

    @property
    def name(self) -> str:
        """The name of the case in tables and files."""
        return f"{self.object}, {self.depth * 1e3:g} mm, {self.motion}"

    def poses(self, fine: int = 1, shift: tuple[float, float] = (0.0, 0.0)) -> Iterator[dict[str, Any]]:
        """Yield the poses of the object, step by step.

        Args:
            fine: the factor by which there are more poses while it slides or rolls.
            shift: the place of the object along x and y [m].
        """
        for pose in self._poses(fine):
            yield pose | {"position": pose["position"] + np.array([*shift, 0.0])}

    def _poses(self, fine: int) -> Iterator[dict[str, Any]]:
        body = indenters()[self.object]
        for k in range(1, PRESS_STEPS + 1):
            height = body.lowest - self.depth * k / PRESS_STEPS
            down = np.array([0, 0, -self.depth / PRESS_STEPS / DT])
            yield self._pose(body, np.array([0, 0, TOP + height]), 0.0, down)
        if self.motion == "press":
            return
        steps = MOVE_STEPS * fine
        speed = SLIDE / MOVE_STEPS / DT
        for k in range(1, steps + 1):
            way = SLIDE * k / steps
            if self.motion == "slide":
                at = np.array([way, 0, TOP + body.lowest - self.depth])
                yield self._pose(body, at, 0.0, np.array([speed, 0, 0]))
            elif body.rolling_radius:
                at = np.array([way, 0, TOP + body.lowest - self.depth])
                yield self._pose(body, at, way / body.rolling_radius, np.array([speed, 0, 0]))
            else:
                angle = ROCK * k / steps
                pivot = np.array([0, 0, TOP - self.depth])
                arm = rotation.rotate(rotation.from_rotation_vector(np.array([0, angle, 0])), (0, 0, body.lowest))
                yield self._pose(body, pivot + arm, angle, np.zeros(3))

    def _pose(self, body: Indenter, position, angle: float, velocity) -> dict[str, np.ndarray]:
        turn = rotation.multiply(rotation.from_rotation_vector(np.array([0, angle, 0])), body.turn)
        spin = np.zeros(3)
        if self.motion == "roll" and angle:
            rate = ROCK / MOVE_STEPS / DT if body.rolling_radius is None else np.linalg.norm(velocity) / body.lowest
            spin = np.array([0, rate, 0])
        return {"position": position, "quaternion": turn, "linear_velocity": velocity, "angular_velocity": spin}


CALIBRATION = Case("sphere", 5e-4, "press")
CALIBRATION_OF_SHEAR = Case("sphere", 5e-4, "slide")
COST = Case("sphere", 5e-4, "slide")
"""The timed case: a warm contact that moves a hundredth of a millimetre in a step."""


def all_cases(quick: bool = False) -> list[Case]:
    """Return every case; the quick choice has each object once, the sphere in all motions, and one light press."""
    names = list(indenters())
    if quick:
        return [Case(name, 5e-4, "press") for name in names] + [
            Case("sphere", 5e-4, "slide"),
            Case("cylinder", 5e-4, "slide"),
            Case("sphere", 5e-4, "roll"),
            Case("sphere", LIGHT_DEPTH, "press"),
        ]
    light = [Case(name, LIGHT_DEPTH, "press") for name in LIGHTLY_PRESSED]
    cases = [Case(name, depth, "press") for name in names for depth in DEPTHS]
    return light + cases + [Case(name, 5e-4, motion) for motion in ("slide", "roll") for name in names]


def build(skin: TestSkin, case: Case, model: Any, dtype: Dtype = "float32", device: str = "cpu"):
    """Build a scene with one skin and the case's object, and return simulation, body and sensor."""
    scene = Scene(dt=DT)
    extent = 2 * skin.side * skin.pitch
    pad = scene.add_body(Box(size=(extent, extent, 2 * TOP)), fixed=True, name="pad")
    body = scene.add_body(indenters()[case.object].shape, name="object", position=(0, 0, 1.0))
    sensor = scene.add_sensor(model, link=pad, name="skin")
    return scene.build(dtype=dtype, device=device), body, sensor
