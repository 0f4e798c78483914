"""Bodies that you move by hand while the scene runs: a motion whose path can be changed, and the path of a press."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from tactemu.base.errors import SceneError, no_such
from tactemu.geometry import rotation
from tactemu.geometry.bodies import Body
from tactemu.geometry.motion import Hold, Joint, Keyframes, Motion, Placed, Pose
from tactemu.scene.file import LoadedScene
from tactemu.scene.placement import PlacedSkin

TRAVEL_SPEED_M_S = 0.05
"""Speed at which a body comes to the start of a press and leaves it [m/s], unless it presses faster."""


@dataclass(frozen=True)
class Waypoint:
    """A pose on a path, which the body reaches ``seconds`` after the waypoint before."""

    seconds: float
    """Travel time from the waypoint before [s]."""
    position: np.ndarray
    """World position [m]."""
    quaternion: np.ndarray | None = None
    """World orientation; ``None``: the body does not turn."""


class Steered(Motion):
    """A motion that you replace while the scene runs: by a path to :meth:`follow`, at whose end it stays, or a pose.

    Change it in the thread that steps the simulation.

    Args:
        position: world position at which the body was placed [m].
        quaternion: orientation with which the body was placed.
        own: motion of the body until you replace it, and after :meth:`give_back`; ``None``: the body stands still.
    """

    kind = "steered"
    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ("_home", "_own", "_held")

    def __init__(self, position: Sequence[float], quaternion: Sequence[float], own: Motion | None = None):
        self._home = Pose(np.array(position, np.float64), rotation.normalised(quaternion))
        self._own: Motion = own or Hold()
        self._held = own is None
        self.way: Motion | None = None
        """The motion that replaces its own."""
        self.moved_s = -1.0
        """The time of the last command to move [s]."""
        self.back: np.ndarray | None = None
        """The world positions over which the body is lifted after a press [m], shape ``(2, 3)``: at the start of its
        approach, and clear of the skin."""

    @property
    def is_steered(self) -> bool:
        """True while the body does not follow its own motion."""
        return self._held or self.way is not None

    def pose(self, t_s: float) -> Pose:
        """Return the displacement from the pose at which the body was placed."""
        return (self.way or self._own).pose(t_s)

    def world(self, t_s: float) -> Pose:
        """Return the pose in the world."""
        return self._home.displaced(self.pose(t_s))

    def follow(self, start_s: float, waypoints: Sequence[Waypoint]) -> float:
        """Move along ``waypoints`` from the body's pose at ``start_s`` [s], and return the time of arrival [s].

        Raises:
            SceneError: a waypoint is too far away, or its travel time too long, for a motion.
        """
        here = self.pose(start_s)
        times, positions, turns = [start_s], [here.position], [here.quaternion]
        for waypoint in waypoints:
            times.append(times[-1] + max(waypoint.seconds, 1e-6))
            positions.append(np.asarray(waypoint.position, np.float64) - self._home.position)
            turns.append(turns[-1] if waypoint.quaternion is None else self._turn(waypoint.quaternion))
        self.way = Keyframes(times=tuple(times), positions=tuple(positions), quaternions=tuple(turns))  # type: ignore[arg-type]
        self.moved_s = start_s
        return times[-1]

    def put(self, t_s: float, position=None, quaternion=None, linear_velocity=None, angular_velocity=None) -> None:
        """Put the body at a world pose from ``t_s`` [s] on; a pose component that you omit stays, velocities are 0."""
        here = self.pose(t_s)
        place = here.position if position is None else np.asarray(position, np.float64) - self._home.position
        turn = here.quaternion if quaternion is None else self._turn(quaternion)
        speeds = (np.zeros(3) if given is None else np.array(given) for given in (linear_velocity, angular_velocity))
        self.way, self.moved_s = Placed(Pose(place, turn, *speeds)), t_s

    def give_back(self) -> None:
        """Return the body to its own motion, as if it had never been replaced; without one, to where it was placed."""
        self.way, self.back = None, None

    def _turn(self, quaternion: Sequence[float] | np.ndarray) -> np.ndarray:
        """Return the displacement that gives it this orientation in the world."""
        return rotation.multiply(rotation.normalised(quaternion), rotation.conjugate(self._home.quaternion))


def reach(body: Body, quaternion: np.ndarray, direction: np.ndarray) -> float:
    """Return the extent of a body from its origin along a world direction [m] (the support function).

    Raises:
        SceneError: the body has no shape, or one whose extent is not known.
    """
    if body.shape is None:
        raise SceneError(f"body {body.name!r}: it has no shape, so that it cannot press; use move() with a position")
    return body.shape.reach(body.name, rotation.rotate(rotation.conjugate(quaternion), direction))


def press_path(
    body: Body,
    here: Pose,
    target: np.ndarray,
    normal: np.ndarray,
    *,
    depth: float,
    approach: float,
    clearance: float,
    speed: float,
) -> tuple[list[Waypoint], np.ndarray]:
    """Return the waypoints of a press, and the positions over which the body is lifted afterwards, shape ``(2, 3)``.

    The path leads from ``here`` over ``target`` (a point of the skin) to ``depth`` below it.

    Args:
        body: the body that presses; it does not turn.
        here: world pose of the body.
        target: point of the skin, world [m].
        normal: normal of the skin there, world.
        depth: depth of the body's foremost point below the skin [m].
        approach: free travel before the first touch [m].
        clearance: gap over the skin at which the body travels, if that is more [m].
        speed: speed of the approach and the press [m/s]; the body comes there at :data:`TRAVEL_SPEED_M_S` or faster.
    """
    stand_off = reach(body, here.quaternion, -normal)
    over, start, down = (
        target + normal * (stand_off + gap) for gap in (max(clearance, approach, -depth), max(approach, -depth), -depth)
    )
    height = float((here.position - over) @ normal)
    lifted = here.position + normal * max(0.0, -height)
    path = waypoints_along(here.position, [lifted, over, start], max(speed, TRAVEL_SPEED_M_S))
    return path + (waypoints_along(start, [down], speed) or [Waypoint(0.0, down)]), np.stack([start, over])


def waypoints_along(here: np.ndarray, positions: Sequence[np.ndarray], speed: float) -> list[Waypoint]:
    """Return a waypoint for each position that is not the one before, at a speed [m/s]."""
    waypoints, before = [], here
    for position in positions:
        distance = float(np.linalg.norm(position - before))
        if distance > 0:
            waypoints.append(Waypoint(distance / speed, position))
        before = position
    return waypoints


def lift_path(here: np.ndarray, back: np.ndarray, speed: float) -> list[Waypoint]:
    """Return the waypoints of a body that is lifted from a press: out of the skin at ``speed`` [m/s], then on."""
    start, over = back
    path = waypoints_along(here, [start], speed) + waypoints_along(start, [over], max(speed, TRAVEL_SPEED_M_S))
    return path or [Waypoint(0.0, over)]


def steered(loaded: LoadedScene, names: Sequence[str] = (), *, by_hand: bool = False) -> LoadedScene:
    """Return the scene with a :class:`Steered` motion for every body that you may move by hand.

    A body that carries a skin, or follows a joint of a device, is one of them only if it is named.

    Args:
        loaded: the scene as it was read.
        names: bodies that stand still from the start instead of following their own motion.
        by_hand: all bodies stand still from the start, not only those without a motion.

    Raises:
        SceneError: there is no such body, or it is fixed.
    """
    links = {skin.link for skin in loaded.tables.skin}
    links |= {place if isinstance(place, str) else place.body for s in loaded.tables.skin for place in s.links.values()}
    bodies = {body.name: body for body in loaded.tables.body if not body.fixed}
    for name in names:
        if name not in bodies:
            raise SceneError(f"steer: there is {no_such('movable body', name, bodies, 'bodies')}")
    found: dict[str, Motion] = {}
    for name, body in bodies.items():
        own = loaded.motions.get(name)
        if name in names or (name not in links and not isinstance(own, Joint)):
            held = by_hand or name in names
            found[name] = Steered(body.position, body.quaternion, None if held else own)
    return replace(loaded, motions={**loaded.motions, **found})


def nearest_body(motions: Mapping[str, Steered], taxels: PlacedSkin, taxel: int | None, t_s: float) -> str:
    """Return the name of the steered body nearest to a taxel at ``t_s``, or (``None``) to any taxel.

    Raises:
        SceneError: there is no such taxel.
    """

    def distance(name: str) -> float:
        here = motions[name].world(t_s).position
        return float(np.linalg.norm(here - taxels.positions(t_s)[taxels.select_taxel(taxel, here, t_s)]))

    return min(motions, key=distance)
