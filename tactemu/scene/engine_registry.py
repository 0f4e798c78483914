"""The engines that move bodies of a scene, by the kind that its file names, and their interface."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from firmware_protocols import Device
from tactemu.base.errors import SceneError
from tactemu.scene.engine_tables import ENGINES
from tactemu.scene.file import LoadedScene
from tactemu.scene.schema import JointTable

if TYPE_CHECKING:
    from tactemu.geometry.bodies import Body
    from tactemu.scene.scene import Scene
    from tactemu.sensors.sensor import Sensor

OPENERS: dict[str, str] = {
    # kind: "module:function", imported only when a scene needs it
    "mujoco": "tactemu.engines.engine:open_engine",
    "mujoco-warp": "tactemu.engines.mujoco_warp_engine:open_engine",
    "newton": "tactemu.engines.newton_engine:open_engine",
}
"""The function that opens each engine: given ``(scene, loaded, motors)``, it adds the model's bodies to the scene."""


@dataclass(frozen=True)
class JointMotors:
    """The motors of one device, and the joints of the model that they move."""

    skin: str
    """Name of the device in the scene."""
    device: Device
    joints: Mapping[str, str | JointTable]
    """Joint of the model by the name of the motor."""
    local_ns: Callable[[int], int]
    """The function that returns the device's own time at a time of the scene [ns]."""


class Engine(Protocol):
    """A simulator that moves bodies of a scene."""

    @property
    def bodies(self) -> list[Body]:
        """The bodies that it added to the scene."""
        ...

    def body_of(self, name: str, part: str, /) -> Body:
        """Return the body under a part of a skin, by the geom or body of the model that has this name.

        Raises:
            SceneError: the model has neither.
        """
        ...

    def attach_sensor(self, sensor: Sensor) -> None:
        """Register a sensor on one of its bodies."""

    def ignored_bodies(self, name: str) -> tuple[int, ...]:
        """Return the indices of the scene's bodies that a skin on this geom or body ignores."""
        ...


class FreeBodies(Protocol):
    """The bodies of a model that move freely."""

    @property
    def free_bodies(self) -> Mapping[str, int]:
        """The index of each free body's first number in a row of positions, by name."""
        ...

    def root(self, name: str) -> str:
        """Return the name of the body that carries a geom or body and is carried by none itself."""
        ...


class BatchEngine(Engine, Protocol):
    """An engine that moves the bodies of many environments."""

    @property
    def source(self) -> FreeBodies:
        """The bodies of its model."""
        ...

    def start_of(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return position [m] and quaternion (w, x, y, z) at which the model has a free body start.

        Raises:
            SceneError: the model has no such body.
        """
        ...


def open_engine(scene: Scene, loaded: LoadedScene, motors: Sequence[JointMotors]) -> Any:
    """Open the engine that a scene file names, an :class:`Engine`, and add the bodies of its model to the scene.

    Raises:
        SceneError: the engine or a library that it needs is not installed, or the engine cannot read its model.
    """
    kind = next(name for name, table in ENGINES.items() if isinstance(loaded.tables.engine, table))
    module, _, function = OPENERS[kind].partition(":")
    try:
        opener = getattr(importlib.import_module(module), function)
    except ModuleNotFoundError as error:
        raise SceneError(f"engine: this installation has no engine of kind {kind!r} ({error})") from None
    return opener(scene, loaded, motors)


def refuse_motors(kind: str, motors: Sequence[JointMotors]) -> None:
    """Check that no skin has motors for an engine that moves none.

    Raises:
        SceneError: a skin has joints.
    """
    if motors:
        raise SceneError(
            f'skin {motors[0].skin!r}: joints: an engine of kind {kind!r} moves no motors; use kind "mujoco"'
        )
