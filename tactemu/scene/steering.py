"""Moving a body by hand while the scene runs: a motion whose way ahead can be changed, and how to press with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from tactemu.errors import SceneError
from tactemu.options import number, numbers
from tactemu.scene import rotation
from tactemu.scene.bodies import Body
from tactemu.scene.file import LoadedScene
from tactemu.scene.limits import METRES, MOST_DEPTH_M, MOST_S, SPEEDS
from tactemu.scene.motion import Hold, Keyframes, Motion, Pose
from tactemu.scene.placement import PlacedSkin


@dataclass(frozen=True)
class Leg:
    """Part of a way: be there, ``seconds`` after the leg before."""

    seconds: float
    position: np.ndarray
    """World [m]."""
    quaternion: np.ndarray | None = None
    """World; ``None``: do not turn."""


class Steered(Motion):
    """Holds still until it is told to :meth:`follow` a way, and holds at its end.

    Change it in the thread that steps the simulation.
    """

    kind = "steered"
    not_state: ClassVar[tuple[str, ...]] = ("_home",)

    def __init__(self, position: Sequence[float], quaternion: Sequence[float]):
        self._home = Pose(np.array(position, np.float64), rotation.normalised(quaternion))
        self._way: Motion = Hold()

    def pose(self, t_s: float) -> Pose:
        """Displacement from where the body was placed."""
        return self._way.pose(t_s)

    def world(self, t_s: float) -> Pose:
        """Pose in the world."""
        return self._home.displaced(self._way.pose(t_s))

    def follow(self, start_s: float, legs: Sequence[Leg]) -> float:
        """Go along ``legs`` from wherever the body is at ``start_s`` [s]; returns when it will be there [s]."""
        here = self.pose(start_s)
        times, positions, turns = [start_s], [here.position], [here.quaternion]
        for leg in legs:
            times.append(times[-1] + max(leg.seconds, 1e-6))
            positions.append(np.asarray(leg.position, np.float64) - self._home.position)
            turn = turns[-1]
            if leg.quaternion is not None:
                turn = rotation.multiply(rotation.normalised(leg.quaternion), rotation.conjugate(self._home.quaternion))
            turns.append(turn)
        self._way = Keyframes(times=tuple(times), positions=tuple(positions), quaternions=tuple(turns))  # type: ignore[arg-type]
        return times[-1]


def reach(body: Body, quaternion: np.ndarray, direction: np.ndarray) -> float:
    """How far the surface of a body lies from its origin along a world direction [m] (its support function).

    Raises:
        SceneError: it has no shape, or one whose extent is not known.
    """
    if body.shape is None:
        raise SceneError(f"body {body.name!r}: cannot tell how far it reaches; use move() with a position")
    return body.shape.reach(body.name, rotation.rotate(rotation.conjugate(quaternion), direction))


def pressing_way(
    body: Body, here: Pose, target: np.ndarray, normal: np.ndarray, *, depth: float, clearance: float, speed: float
) -> tuple[list[Leg], np.ndarray]:
    """The way from ``here`` over ``target`` (a point of the skin) to ``depth`` below it, and the place to go back to.

    Args:
        body: what presses; it does not turn.
        here: its world pose.
        target: point of the skin, world [m].
        normal: of the skin there, world.
        depth: how far the body's foremost point goes below the skin [m].
        clearance: gap over the skin at which it travels [m].
        speed: [m/s].
    """
    stand_off = reach(body, here.quaternion, -normal)
    over = target + normal * (stand_off + clearance)
    down = target + normal * (stand_off - depth)
    height = float((here.position - over) @ normal)
    lifted = here.position + normal * max(0.0, -height)
    ways = [lifted, over, down]
    legs, place = [], here.position
    for way in ways:
        distance = float(np.linalg.norm(way - place))
        if distance > 0:
            legs.append(Leg(distance / speed, way))
        place = way
    return legs or [Leg(0.0, down)], over


def steered(loaded: LoadedScene, names: Sequence[str], *, by_hand: bool) -> tuple[LoadedScene, dict[str, Steered]]:
    """The scene with a motion that can be steered for every body that is moved by hand, and these motions.

    Args:
        loaded: as it was read.
        names: of bodies that are, whatever motion they have.
        by_hand: all others are too that carry no skin; else only those without a motion.

    Raises:
        SceneError: no such body, or a fixed one.
    """
    links = {skin.link for skin in loaded.tables.skin}
    links |= {place if isinstance(place, str) else place.body for s in loaded.tables.skin for place in s.links.values()}
    bodies = {body.name: body for body in loaded.tables.body if not body.fixed}
    for name in names:
        if name not in bodies:
            raise SceneError(f"steer: no body {name!r} that could move (there are: {', '.join(bodies) or 'none'})")
    found = {
        name: Steered(body.position, body.quaternion)
        for name, body in bodies.items()
        if name in names or (name not in links and (by_hand or name not in loaded.motions))
    }
    return replace(loaded, motions={**loaded.motions, **found}), found


def nearest_body(motions: Mapping[str, Steered], taxels: PlacedSkin, taxel: int | None, t_s: float) -> str:
    """Of bodies that are moved by hand the one nearest to a taxel at ``t_s``, or (``None``) to any.

    Raises:
        SceneError: no such taxel.
    """

    def distance(name: str) -> float:
        here = motions[name].world(t_s).position
        return float(np.linalg.norm(here - taxels.positions(t_s)[taxels.chosen(taxel, here, t_s)]))

    return min(motions, key=distance)


def check_depth(what: str, depth: float) -> None:
    """Refuse a depth [m] to press that no skin has: millimetres given as metres."""
    number(what, "depth", depth, at_least=-MOST_DEPTH_M, at_most=MOST_DEPTH_M, unit=METRES)


def check_pace(what: str, seconds: float, speed: float) -> None:
    """Refuse a time [s] or a speed [m/s] that is none."""
    number(what, "seconds", seconds, at_least=0, at_most=MOST_S, unit="s")
    number(what, "speed", speed, at_least=SPEEDS[0], at_most=SPEEDS[1], unit="m/s")


def check_place(what: str, **given: Sequence[float] | None) -> None:
    """Refuse positions that are not three numbers, and quaternions that are not four; ``None`` passes."""
    for name, place in given.items():
        width = 4 if name == "quaternion" else 3
        if place is not None and numbers(what, name, place).shape != (width,):
            raise SceneError(f"{what}: {name} must be {width} numbers, got {place!r}")
