"""Start poses of bodies, which differ from environment to environment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from tactemu.base.errors import TactemuError
from tactemu.base.random_streams import generator
from tactemu.datasets.spec import DatasetSpec
from tactemu.geometry import rotation
from tactemu.scene.building import read_engine
from tactemu.scene.file import LoadedScene

if TYPE_CHECKING:
    from tactemu.geometry.motion import Motion, Times
    from tactemu.scene.scene import Scene
    from tactemu.sensors.simulation import Simulation


Start = tuple[np.ndarray, np.ndarray]
"""Position [m] and quaternion (w, x, y, z)."""


class StartPoses:
    """The start poses of a scene's free bodies in each environment; bodies that carry a skin keep theirs.

    Free bodies are those of ``[[body]]`` tables that are not fixed, and those of an engine's model without a joint.

    Args:
        loaded: the scene.
        spec: with the largest shift and turn.

    Raises:
        TactemuError: a shift or turn is asked for, and no body is free.
    """

    def __init__(self, loaded: LoadedScene, spec: DatasetSpec):
        carriers = {skin.link for skin in loaded.tables.skin if skin.link is not None}
        for skin in loaded.tables.skin:
            carriers |= {place if isinstance(place, str) else place.body for place in skin.links.values()}
        self._loaded, self._spec = loaded, spec
        self.tables: dict[str, Start] = {
            body.name: (np.array(body.position), rotation.normalised(body.quaternion))
            for body in loaded.tables.body
            if not body.fixed and body.shape != "frame" and body.name not in carriers
        }
        """Start poses of the bodies of tables, as in the scene."""
        self.engine: dict[str, Start] = {}
        """Start poses of the bodies of an engine's model, as in the model."""
        if (engine := read_engine(loaded)) is not None:
            own = {body.name for body in loaded.tables.body}
            with_skin = {engine.source.root(name) for name in carriers - own}
            self.engine = {name: engine.start_of(name) for name in engine.source.free_bodies if name not in with_skin}
        if self._wanted and not self.names:
            raise TactemuError(
                f"{loaded.source}: no body can start elsewhere: all are fixed, carry a skin, or hang on joints of the "
                "engine's model; give --shift 0 0 0 and no --turn, then environments differ in random numbers only"
            )

    @property
    def names(self) -> list[str]:
        """The names of the bodies that start elsewhere in each environment."""
        return [*self.tables, *self.engine]

    @property
    def of_engine(self) -> dict[str, Start]:
        """Start poses of the engine's bodies, a row for each environment; empty if none is shifted or turned."""
        if not self._wanted:
            return {}
        return {name: self._drawn(f"engine/{name}", start) for name, start in self.engine.items()}

    def drawn(self, name: str) -> Start:
        """Return start position and quaternion of a body of a table, shapes ``(envs, 3)`` and ``(envs, 4)``."""
        return self._drawn(name, self.tables[name])

    def of(self, env: int) -> LoadedScene:
        """Return the scene as it is in one environment."""
        bodies = []
        for body in self._loaded.tables.body:
            if body.name in self.tables:
                position, quaternion = (values[env] for values in self.drawn(body.name))
                body = body.model_copy(update={"position": tuple(position), "quaternion": tuple(quaternion)})
            bodies.append(body)
        tables = self._loaded.tables.model_copy(update={"body": tuple(bodies)})
        return replace(self._loaded, tables=tables, starts=self.of_engine)

    @property
    def _wanted(self) -> bool:
        return any(self._spec.shift_m) or self._spec.turn_rad != 0

    def _drawn(self, stream: str, start: Start) -> Start:
        spec = self._spec
        random = generator(spec.seed, f"dataset/{stream}").uniform(-1.0, 1.0, (spec.envs, 4))
        half = 0.5 * spec.turn_rad * random[:, 3]
        turn = np.zeros((spec.envs, 4))
        turn[:, 0], turn[:, 3] = np.cos(half), np.sin(half)
        return start[0] + random[:, :3] * spec.shift_m, rotation.multiply_many(turn, start[1])


class BodyMotions:
    """A poser of the bodies of a batch: at each step their motion, applied to their start pose in each environment."""

    def __init__(self, scene: Scene, motions: Mapping[str, Motion], starts: StartPoses, first: int, end: int):
        self._motions, self._starts, self._range = motions, starts, slice(first, end)
        self._bodies = [scene.body(name) for name in dict.fromkeys((*motions, *starts.tables))]
        scene.posers.append(self)

    def __call__(self, simulation: Simulation, _times: Times) -> None:
        """Set the poses of the bodies at the simulation's time; no environment is reset alone."""
        if self._bodies:
            rows = [self._rows(body, simulation.time) for body in self._bodies]
            simulation._world.put_all(self._places, np.stack(rows))

    @cached_property
    def _places(self) -> np.ndarray:
        return np.array([body.index for body in self._bodies])

    @cached_property
    def _at(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        n, found = self._range.stop - self._range.start, {}
        for body in self._bodies:
            if body.name in self._starts.tables:
                position, quaternion = self._starts.drawn(body.name)
                found[body.name] = position[self._range], quaternion[self._range]
            else:
                found[body.name] = np.tile(body.position, (n, 1)), np.tile(body.quaternion, (n, 1))
        return found

    def _rows(self, body: Any, t_s: float) -> np.ndarray:
        position, quaternion = self._at[body.name]
        rows = np.zeros((len(position), 13))
        rows[:, :3], rows[:, 3:7] = position, quaternion
        if body.name in self._motions:
            by = self._motions[body.name].pose(t_s)
            rows[:, :3] += by.position
            rows[:, 3:7] = rotation.multiply_many(by.quaternion, quaternion)
            rows[:, 7:10], rows[:, 10:] = by.linear_velocity, by.angular_velocity
        return rows
