"""The base class of transducers, and how to write one.

A transducer is a frozen dataclass of options, one file, derived from :class:`Transducer`, with one line in
:mod:`tactemu.transducers.registry`. Several follow one another: each receives the signal of the one before, the first
that of the sensor model. They come after the memory of the material and before the electronics: noise, resolution and
saturation of the sensor are then in the unit of the last one.

``compile`` allocates with ``site.context`` and returns the array that it fills and its stages, as a sensor model does.
It is called for the ground truth and for the measured branch, unless the two are the same.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
import warp as wp

from tactemu.base.option_groups import Options
from tactemu.plan.plan import Context, Stage

Channels = Literal["scalar", "force", "displacement"]


@dataclass(frozen=True, kw_only=True)
class SignalType:
    """The quantity in an array ``(n_envs, n_taxels, channels)``, with its unit and number of channels."""

    quantity: str
    """The quantity's name, as in :data:`firmware_protocols.device.Quantity`."""
    unit: str
    """The SI unit."""
    vector: bool
    """True for a vector of three channels, false for one number."""

    @property
    def n_channels(self) -> int:
        """The number of channels of one taxel."""
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
    """The skin on its link, for which a transducer is compiled."""

    name: str
    """Name of the sensor."""
    context: Context
    """The scene's context, which allocates arrays and records launches."""
    positions: np.ndarray
    """Positions of the taxels in the link's frame [m], ``(n, 3)``."""
    normals: np.ndarray
    """Unit normals of the taxels, out of the skin, in the link's frame, ``(n, 3)``."""
    layout: tuple[int, ...]
    """Layout of the taxels, ``(n,)`` or ``(rows, cols)``."""
    areas: np.ndarray
    """Areas of the taxels [m²], ``(n,)``."""
    link: int
    """Index of the link among the bodies."""
    world: wp.array
    """World poses of all bodies, ``(n_envs, n_bodies, 13)``: see :mod:`tactemu.sensors.poses`."""
    pose: wp.array
    """Poses of the bodies in the link's frame, transforms ``(n_envs, n_bodies)``."""
    bodies: Mapping[str, int]
    """Indices of the bodies, by name."""

    def zeros(self, channels: int) -> wp.array:
        """Return a new array ``(n_envs, n_taxels, channels)`` that is part of the state."""
        return self.context.zeros((self.context.n_envs, len(self.positions), channels), self.context.real)

    def constant(self, values: np.ndarray, dtype: type | None = None) -> wp.array:
        """Return an array on the device that never changes."""
        return wp.array(values, dtype=dtype or self.context.real, device=self.context.device)


@dataclass(frozen=True, kw_only=True)
class Transducer(Options):
    """The options of one transducer, in SI units, with vectors in the frame of the link."""

    memories: ClassVar[tuple[str, ...]] = ()
    """The options, 0 if off, by which its reading depends on the course of the load."""
    takes: ClassVar[tuple[str, ...]]
    """The quantities that it accepts, best first."""
    valid: ClassVar[str] = ""
    """The conditions under which its readings are meaningful."""
    source: ClassVar[str] = ""
    """The source of its equations."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check(type(self).__name__)

    def check(self, where: str) -> None:
        """Check the options beyond type and finiteness, as the class needs.

        Raises:
            SceneError: an option has a meaningless value.
        """

    @abstractmethod
    def gives(self, taken: SignalType) -> SignalType:
        """Return the type of the transducer's signal for an input of type ``taken``."""

    @abstractmethod
    def compile(self, site: TransducerSite, x: wp.array, taken: SignalType) -> tuple[wp.array, Sequence[Stage]]:
        """Return the array that the transducer fills and its stages; ``x`` is ``(n_envs, n_taxels, channels)``."""
