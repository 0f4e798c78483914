"""The signs of forces and torques in readings.

In the convention ``skin``, the default, everything that a model reports acts *on the skin*, in the frame of the link,
with the normal of a taxel out of the skin. On a taxel whose normal is +z a press is a force along -z, a body that
slides to +x drags the skin to +x, and a body that spins about +z turns the skin about +z.

In the convention ``genesis`` the sensors that Genesis has too have its signs: some parts of a reading act on the skin,
others on the body that touches it, as the docstring of each model says. Their sums then mean nothing, devices cannot
measure them, and transducers cannot sense them. Models that Genesis lacks have one convention.

Depth is never negative, and displacement is the motion of the skin's markers in the frame of the link, in both.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, Protocol

from tactemu.base.errors import SceneError

Convention = Literal["skin", "genesis"]


class Signed(Protocol):
    """The part of a sensor's handle that tells its signs."""

    @property
    def on_skin(self) -> bool:
        """Do all forces and torques that the model reports act on the skin?"""
        ...


def require_on_skin(sensors: Iterable[Signed], who_senses: str) -> None:
    """Check that all forces and torques act on the skin; ``who_senses`` begins the message: "devices measure".

    Raises:
        SceneError: some act on the body that touches the skin.
    """
    if not all(sensor.on_skin for sensor in sensors):
        raise SceneError(f'{who_senses} what acts on the skin; leave out convention="genesis"')
