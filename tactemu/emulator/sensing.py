"""The readings of a device's senses, from the readings of its skin and the ambient quantities."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from firmware_protocols import Device, Sense
from firmware_protocols.device import CONTACT, VECTORS
from tactemu.scene.placement import AMBIENT, JoinedImperfections

if TYPE_CHECKING:
    from tactemu.imperfections import Imperfections


class SkinReadings(Protocol):
    """The readings of one skin: of a placed sensor, a recording, or the user's function."""

    def quantity(self, name: str, ground_truth: bool = False) -> np.ndarray:
        """Return the latest reading of environment 0, shape ``(n_taxels,)`` or ``(n_taxels, 3)``, SI, device's
        frame.
        """
        ...

    def ambient(self, name: str, t_ns: int, link: str = "") -> Any:
        """Return ``temperature``, ``acceleration`` or ``angular_velocity`` of a link of the device; "" is the first."""
        ...

    @property
    def wrench(self) -> np.ndarray | None:
        """Force and torque [N, Nm], shape ``(6,)``; ``None``: they follow from the taxels' forces."""
        ...

    @property
    def imperfections(self) -> Imperfections | JoinedImperfections | None:
        """The imperfections of the readings; ``None`` for a recording."""
        ...


class SenseReader:
    """The senses of a device on a skin: a :class:`~tactemu.emulator.channel.Source`.

    Args:
        skin: the readings of the taxels, in the order of the device's layout.
        device: the device, whose motors measure their loads, too.
    """

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ("_layout", "_device")

    def __init__(self, skin: SkinReadings, device: Device):
        self.skin = skin
        self._layout, self._device = device.layout, device
        self._ambient: tuple[int, dict[str | tuple[str, str], np.ndarray]] = (-1, {})
        """The ambient quantities at a time, by quantity and link; and the readings of their senses, by key."""

    @property
    def imperfections(self) -> Imperfections | JoinedImperfections | None:
        """The imperfections of the readings, which can change while it runs; ``None`` for a recording."""
        return self.skin.imperfections

    def sense(self, sense: Sense, t_ns: int, ground_truth: bool = False) -> np.ndarray:
        """Return the reading of one sense now; shapes as in :data:`firmware_protocols.device.Quantity`."""
        if sense.quantity in CONTACT:
            return self.skin.quantity(sense.quantity, ground_truth)
        at: Any = sense.at
        match sense.quantity:
            case "wrench" if (wrench := self.skin.wrench) is not None:
                return np.broadcast_to(wrench, (len(at), 6))
            case "wrench":
                return resultant(self._layout.positions, self.skin.quantity("force", ground_truth), at.positions)
            case "vibration":
                push = self._layout.push(self.skin.quantity("force", ground_truth)).sum()
                return np.full(len(at), push / self._layout.areas.sum())
            case "load":  # the torques of an engine's joints on the motors
                motors = self._device.drives
                return np.zeros(len(at)) if motors is None or not motors.is_in_engine else motors.loads()
            case quantity:
                if self._ambient[0] != t_ns:  # read once for all conversions of one time
                    self._ambient = (t_ns, {})
                found = self._ambient[1]
                if sense.key not in found:
                    if len(at.links) == 1:
                        value = self._at(t_ns, quantity, at.links[0])
                        found[sense.key] = np.broadcast_to(value, (len(at), *value.shape))
                    else:
                        values = [self._at(t_ns, quantity, patch.link) for patch in at.patches]
                        found[sense.key] = np.repeat(values, [len(patch) for patch in at.patches], axis=0)
                return found[sense.key]

    def _at(self, t_ns: int, quantity: str, link: str) -> np.ndarray:
        found = self._ambient[1]
        if (quantity, link) not in found:
            found[quantity, link] = np.asarray(self.skin.ambient(quantity, t_ns, link), float)
        return found[quantity, link]


class NullSource:
    """The readings of a device without taxels."""

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ()
    imperfections = None
    wrench = None

    def quantity(self, name: str, ground_truth: bool = False) -> np.ndarray:
        """Return an empty array, shape ``(0, 3)`` or ``(0,)``."""
        return np.zeros((0, 3) if name in VECTORS else 0)

    def ambient(self, name: str, t_ns: int, link: str = "") -> Any:
        """Return room temperature, or the motion of a link at rest."""
        return AMBIENT[name]


def resultant(positions: np.ndarray, forces: np.ndarray, about: np.ndarray) -> np.ndarray:
    """Return force and torque [N, Nm], shape ``(n, 6)``, of forces ``(m, 3)`` at ``positions`` about each of n
    points.
    """
    arms = positions[None] - np.asarray(about)[:, None]
    torques = np.cross(arms, forces[None]).sum(axis=1)
    return np.concatenate([np.broadcast_to(forces.sum(axis=0), torques.shape), torques], axis=-1)
