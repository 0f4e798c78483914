"""What a transducer is, and how to write one.

A transducer is a frozen dataclass of options, one file, derived from :class:`Transducer`, with one line in
:mod:`tactemu.transducers.registry`. Several follow one another: each takes what the one before gives, the first what
the sensor model gives. They stand between the memory of the material and the electronics: noise, resolution and
saturation of the sensor are then in the unit of the last one.

``compile`` allocates with ``site.context`` and returns the array that it fills and its stages, as a sensor model does.
It is called for the ground truth and for the measured branch, unless both are one.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
import warp as wp

from tactemu.base.options import check_declared
from tactemu.plan.plan import Context, Stage

Channels = Literal["scalar", "force", "displacement"]


@dataclass(frozen=True, kw_only=True)
class SignalType:
    """What an array ``(n_envs, n_taxels, channels)`` holds."""

    quantity: str
    """See :data:`firmware_protocols.device.Quantity`."""
    unit: str
    vector: bool

    @property
    def n_channels(self) -> int:
        """Numbers of one taxel."""
        return 3 if self.vector else 1


FORCE = SignalType(quantity="force", unit="N", vector=True)
DISPLACEMENT = SignalType(quantity="displacement", unit="m", vector=True)
PRESSURE = SignalType(quantity="pressure", unit="Pa", vector=False)
DEPTH = SignalType(quantity="depth", unit="m", vector=False)
FIELD = SignalType(quantity="field", unit="T", vector=True)
RESISTANCE = SignalType(quantity="resistance", unit="Ohm", vector=False)
CAPACITANCE = SignalType(quantity="capacitance", unit="F", vector=False)

SIGNAL_TYPES = {
    signal.quantity: signal for signal in (FORCE, DISPLACEMENT, PRESSURE, DEPTH, FIELD, RESISTANCE, CAPACITANCE)
}


@dataclass(frozen=True, kw_only=True)
class TransducerSite:
    """Where a transducer is compiled: the skin on its link."""

    name: str
    """Of the sensor."""
    context: Context
    positions: np.ndarray
    """Of the taxels in the link's frame [m], ``(n, 3)``."""
    normals: np.ndarray
    """Out of the skin, ``(n, 3)``, of unit length."""
    layout: tuple[int, ...]
    """``(n,)`` or ``(rows, cols)``."""
    areas: np.ndarray
    """Of the taxels [m²], ``(n,)``."""
    link: int
    world: wp.array
    """Poses of all bodies, ``(n_envs, n_bodies, 13)``: see :mod:`tactemu.sensors.poses`."""
    pose: wp.array
    """The bodies as the link sees them, transforms ``(n_envs, n_bodies)``."""
    bodies: Mapping[str, int]
    """Their places, by name."""

    def zeros(self, channels: int) -> wp.array:
        """Return a new array ``(n_envs, n_taxels, channels)`` that is part of the state."""
        return self.context.zeros((self.context.n_envs, len(self.positions), channels), self.context.real)

    def constant(self, values: np.ndarray, dtype: type | None = None) -> wp.array:
        """Return an array on the device that never changes."""
        return wp.array(values, dtype=dtype or self.context.real, device=self.context.device)


@dataclass(frozen=True, kw_only=True)
class Transducer(ABC):
    """Options of one transducer. SI units; vectors in the frame of the link."""

    takes: ClassVar[tuple[str, ...]]
    """Quantities that it can begin with, best first."""
    valid: ClassVar[str] = ""
    """Where its readings mean something."""
    source: ClassVar[str] = ""
    """Where its equations come from."""

    def check_all(self, where: str) -> None:
        """Check every option by its declared type, then what the class itself asks of its options.

        Raises:
            SceneError: an option has another type or shape than declared, or no meaning.
        """
        check_declared(where, self)
        self.check(where)

    def check(self, where: str) -> None:
        """Check what the class asks of its options beside being finite.

        Raises:
            SceneError: one has no meaning.
        """

    @abstractmethod
    def gives(self, taken: SignalType) -> SignalType:
        """What comes out when this goes in."""

    @abstractmethod
    def compile(self, site: TransducerSite, x: wp.array, taken: SignalType) -> tuple[wp.array, Sequence[Stage]]:
        """Return the array that it fills and its stages; ``x`` is ``(n_envs, n_taxels, channels)``."""
