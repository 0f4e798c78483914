"""Moving a body by hand while the scene runs: a motion whose way ahead can be changed, and how to press with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactemu.errors import SceneError
from tactemu.scene import rotation
from tactemu.scene.bodies import Body
from tactemu.scene.motion import Hold, Keyframes, Motion, Pose


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
