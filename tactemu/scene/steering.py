"""Moving a body by hand while the scene runs: a motion whose way ahead can be changed, and how to press with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from tactemu.base.errors import SceneError
from tactemu.geometry import rotation
from tactemu.geometry.bodies import Body
from tactemu.geometry.motion import Hold, Joint, Keyframes, Motion, Placed, Pose
from tactemu.scene.file import LoadedScene
from tactemu.scene.placement import PlacedSkin


@dataclass(frozen=True)
class Waypoint:
    """Part of a way: be there, ``seconds`` after the leg before."""

    seconds: float
    position: np.ndarray
    """World [m]."""
    quaternion: np.ndarray | None = None
    """World; ``None``: do not turn."""


class Steered(Motion):
    """Goes its own way until it is taken: by a way to :meth:`follow`, at whose end it holds, or by a place.

    Change it in the thread that steps the simulation.

    Args:
        position: where the body was placed, world [m].
        quaternion: how.
        own: its motion until it is taken, and after it was given back; ``None``: it holds still.
    """

    kind = "steered"
    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ("_home", "_own", "_held")

    def __init__(self, position: Sequence[float], quaternion: Sequence[float], own: Motion | None = None):
        self._home = Pose(np.array(position, np.float64), rotation.normalised(quaternion))
        self._own: Motion = own or Hold()
        self._held = own is None
        self.way: Motion | None = None
        """What it follows instead of its own motion."""
        self.moved_s = -1.0
        """When it was told to move last [s]."""
        self.back: np.ndarray | None = None
        """Where it is lifted to when it has pressed, world [m]."""

    def extra_state(self) -> dict[str, Motion]:
        """Its own motion, which may have a state."""
        return {"own": self._own}

    @property
    def is_steered(self) -> bool:
        """Whether it is in somebody's hand, and not on its own way."""
        return self._held or self.way is not None

    def pose(self, t_s: float) -> Pose:
        """Return displacement from where the body was placed."""
        return (self.way or self._own).pose(t_s)

    def world(self, t_s: float) -> Pose:
        """Return pose in the world."""
        return self._home.displaced(self.pose(t_s))

    def follow(self, start_s: float, legs: Sequence[Waypoint]) -> float:
        """Go along ``legs`` from wherever the body is at ``start_s`` [s]; returns when it will be there [s].

        Raises:
            SceneError: a leg that takes longer, or leads farther, than a motion may.
        """
        here = self.pose(start_s)
        times, positions, turns = [start_s], [here.position], [here.quaternion]
        for leg in legs:
            times.append(times[-1] + max(leg.seconds, 1e-6))
            positions.append(np.asarray(leg.position, np.float64) - self._home.position)
            turns.append(turns[-1] if leg.quaternion is None else self._turn(leg.quaternion))
        self.way = Keyframes(times=tuple(times), positions=tuple(positions), quaternions=tuple(turns))  # type: ignore[arg-type]
        self.moved_s = start_s
        return times[-1]

    def put(self, t_s: float, position=None, quaternion=None, linear_velocity=None, angular_velocity=None) -> None:
        """Be at a place in the world from ``t_s`` [s] on; what is not given stays as it is then, but at rest."""
        here = self.pose(t_s)
        place = here.position if position is None else np.asarray(position, np.float64) - self._home.position
        turn = here.quaternion if quaternion is None else self._turn(quaternion)
        speeds = (np.zeros(3) if given is None else np.array(given) for given in (linear_velocity, angular_velocity))
        self.way, self.moved_s = Placed(Pose(place, turn, *speeds)), t_s

    def give_back(self) -> None:
        """Go on with its own motion, as if it had never been taken; without one, be where it was placed."""
        self.way, self.back = None, None

    def _turn(self, quaternion: Sequence[float] | np.ndarray) -> np.ndarray:
        """Return the displacement that gives it this orientation in the world."""
        return rotation.multiply(rotation.normalised(quaternion), rotation.conjugate(self._home.quaternion))


def reach(body: Body, quaternion: np.ndarray, direction: np.ndarray) -> float:
    """How far the surface of a body lies from its origin along a world direction [m] (its support function).

    Raises:
        SceneError: it has no shape, or one whose extent is not known.
    """
    if body.shape is None:
        raise SceneError(f"body {body.name!r}: cannot tell how far it reaches; use move() with a position")
    return body.shape.reach(body.name, rotation.rotate(rotation.conjugate(quaternion), direction))


def press_path(
    body: Body, here: Pose, target: np.ndarray, normal: np.ndarray, *, depth: float, clearance: float, speed: float
) -> tuple[list[Waypoint], np.ndarray]:
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
            legs.append(Waypoint(distance / speed, way))
        place = way
    return legs or [Waypoint(0.0, down)], over


def steered(loaded: LoadedScene, names: Sequence[str] = (), *, by_hand: bool = False) -> LoadedScene:
    """Return the scene with a motion that can be steered for every body that may be moved by hand.

    A body that carries a skin, or follows a joint of a device, is one of them only if it is named.

    Args:
        loaded: as it was read.
        names: of bodies that hold still from the start instead of going their own way.
        by_hand: all do; else those without a motion.

    Raises:
        SceneError: no such body, or a fixed one.
    """
    links = {skin.link for skin in loaded.tables.skin}
    links |= {place if isinstance(place, str) else place.body for s in loaded.tables.skin for place in s.links.values()}
    bodies = {body.name: body for body in loaded.tables.body if not body.fixed}
    for name in names:
        if name not in bodies:
            raise SceneError(f"steer: no body {name!r} that could move (there are: {', '.join(bodies) or 'none'})")
    found: dict[str, Motion] = {}
    for name, body in bodies.items():
        own = loaded.motions.get(name)
        if name in names or (name not in links and not isinstance(own, Joint)):
            held = by_hand or name in names
            found[name] = Steered(body.position, body.quaternion, None if held else own)
    return replace(loaded, motions={**loaded.motions, **found})


def nearest_body(motions: Mapping[str, Steered], taxels: PlacedSkin, taxel: int | None, t_s: float) -> str:
    """Of bodies that are moved by hand the one nearest to a taxel at ``t_s``, or (``None``) to any.

    Raises:
        SceneError: no such taxel.
    """

    def distance(name: str) -> float:
        here = motions[name].world(t_s).position
        return float(np.linalg.norm(here - taxels.positions(t_s)[taxels.select_taxel(taxel, here, t_s)]))

    return min(motions, key=distance)
