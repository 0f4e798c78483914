"""The interface of engines, which move bodies of a scene, and the joints of their models that devices' motors move."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from pydantic import Field, model_validator

from firmware_protocols import Device
from tactemu.base.units import Number
from tactemu.geometry.bodies import Body, find_body
from tactemu.scene.table import Table

if TYPE_CHECKING:
    from tactemu.sensors.sensor import Sensor


class JointTable(Table):
    """The joint of an engine's model that a motor of the device moves."""

    joint: str = Field(description="name of the joint in the model")
    zero: Number = Field(default=0.0, description="position of the joint when the motor is at 0 [rad, m]")
    ratio: Number = Field(default=1.0, description="travel of the joint per [rad, m] of the motor; may be negative")

    @model_validator(mode="after")
    def _moves(self):
        if self.ratio == 0:
            raise ValueError("ratio: expected a number that is not 0")
        return self


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
    """A simulator that moves bodies of a scene.

    One of your own derives from it: it adds :attr:`bodies` to the scene, and a function that poses them at each step to
    :attr:`tactemu.Scene.posers`.
    """

    bodies: list[Body]
    """The bodies that it added to the scene."""

    def body_of(self, name: str, part: str, /) -> Body:
        """Return the body under a part of a skin, by the geom or body of the model that has this name.

        Raises:
            SceneError: the model has neither.
        """
        return find_body(self.bodies, name)

    def attach_sensor(self, sensor: Sensor) -> None:
        """Register a sensor on one of its bodies."""

    def ignored_bodies(self, name: str) -> tuple[int, ...]:
        """Return the indices of the scene's bodies that a skin on this geom or body ignores."""
        return ()


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
