"""How environments differ beside their noise: where bodies start."""

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
    from tactemu.geometry.motion import Motion
    from tactemu.scene.scene import Scene
    from tactemu.sensors.simulation import Simulation


Start = tuple[np.ndarray, np.ndarray]
"""Position [m] and quaternion (w, x, y, z)."""


class Starts:
    """Where the free bodies of a scene start in each environment: those that are pressed, not those that feel.

    They are those of ``[[body]]`` tables that are not fixed, and those of an engine's model that hang on no joint.

    Args:
        loaded: the scene.
        order: how far they may be off.

    Raises:
        TactemuError: they shall be off, and there is none.
    """

    def __init__(self, loaded: LoadedScene, order: DatasetSpec):
        carriers = {skin.link for skin in loaded.tables.skin if skin.link is not None}
        for skin in loaded.tables.skin:
            carriers |= {place if isinstance(place, str) else place.body for place in skin.links.values()}
        self._loaded, self._order = loaded, order
        self.tables: dict[str, Start] = {
            body.name: (np.array(body.position), rotation.normalised(body.quaternion))
            for body in loaded.tables.body
            if not body.fixed and body.shape != "frame" and body.name not in carriers
        }
        """Bodies of tables, as the scene has them start."""
        self.engine: dict[str, Start] = {}
        """Bodies of an engine's model, as that has them start."""
        if (engine := read_engine(loaded)) is not None:
            own = {body.name for body in loaded.tables.body}
            feeling = {engine.source.root(name) for name in carriers - own}
            self.engine = {name: engine.start_of(name) for name in engine.source.free_bodies if name not in feeling}
        if self._wanted and not self.names:
            raise TactemuError(
                f"{loaded.source}: no body can start elsewhere: all are fixed, carry a skin, or hang on joints of the "
                "engine's model; give --shift 0 0 0 and no --turn, and environments differ in their random numbers only"
            )

    @property
    def names(self) -> list[str]:
        """Of the bodies that start elsewhere in each environment."""
        return [*self.tables, *self.engine]

    @property
    def of_engine(self) -> dict[str, Start]:
        """Where the engine's bodies start, a row for each environment; empty: as the model says."""
        if not self._wanted:
            return {}
        return {name: self._drawn(f"engine/{name}", start) for name, start in self.engine.items()}

    def drawn(self, name: str) -> Start:
        """Return position and quaternion of a body of a table at the start, ``(envs, 3)`` and ``(envs, 4)``."""
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
        return any(self._order.shift_m) or self._order.turn_rad != 0

    def _drawn(self, stream: str, start: Start) -> Start:
        order = self._order
        random = generator(order.seed, f"dataset/{stream}").uniform(-1.0, 1.0, (order.envs, 4))
        half = 0.5 * order.turn_rad * random[:, 3]
        turn = np.zeros((order.envs, 4))
        turn[:, 0], turn[:, 3] = np.cos(half), np.sin(half)
        return start[0] + random[:, :3] * order.shift_m, rotation.products(turn, start[1])


class Moves:
    """Poses the bodies of a batch at each step: by their motions, from where each environment has them start."""

    def __init__(self, scene: Scene, motions: Mapping[str, Motion], starts: Starts, first: int, end: int):
        self._motions, self._starts, self._range = motions, starts, slice(first, end)
        self._bodies = [scene.body(name) for name in dict.fromkeys((*motions, *starts.tables))]
        scene.posers.append(self)

    def __call__(self, simulation: Simulation, t_s: float) -> None:
        """Pose them as they are at a time [s]."""
        if self._bodies:
            simulation.world.put_all(self._places, np.stack([self._rows(body, t_s) for body in self._bodies]))

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
            rows[:, 3:7] = rotation.products(by.quaternion, quaternion)
            rows[:, 7:10], rows[:, 10:] = by.linear_velocity, by.angular_velocity
        return rows
