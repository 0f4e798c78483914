"""Random loads on the taxels of a judged device: each sample differs, so that a reading identifies its sample.

Simulated contact cannot do that: it only pushes, loads few taxels, gives neighbours similar values, and repeats the
unloaded state. Here every taxel takes a new random value at every sample, by seed and time, over the range of its
channels, in both directions where they have two. The forces that this takes are found by probing the device.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Literal

import numpy as np

from firmware_protocols import Device, Reading, calls
from firmware_protocols.check.readings import METRES_PER_NEWTON, reading_of
from firmware_protocols.senses import CONTACT

Mode = Literal["untouched", "random", "steps"]
STEP = 32
"""Number of samples for which ``steps`` holds a value: the filter of a driver settles within them."""
WIDE = 5000
"""Number of counts above which a channel is driven over a tenth of its range: above their rating, sensors set flags."""
_MAX_FORCE_N = 1e7
"""Force at which the probing of a device without any response ends [N]."""
_SETTLING_CONVERSIONS = 12
"""Number of conversions, 0.2 s apart, after which a device's own filter has settled."""
_JUMP_SHARE = 0.1
"""A channel that goes from a tenth of this share of its range beyond this share at twice the force is an angle or a
switch."""
WRENCH = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
_FEW_TAXELS = 2
"""Number of loaded taxels in the samples that load only a few, so that sums over a skin do not saturate."""
_FEW_TAXELS_EVERY = 6
"""One of so many samples loads only a few taxels."""


class ExcitationRange:
    """The range over which a device is driven: the largest push, pull and tangential force on each taxel [N].

    A force-torque sensor is driven by each component of its wrench [N, Nm]: one point of contact cannot move all six
    independently.
    """

    def __init__(self, make: Callable[[], Device]):
        device = make()
        self.device, self.n = device, len(device.layout)
        self._make = make
        layout, quantities = device.layout, {sense.quantity for sense in device.sensed}
        self.axes: dict[str, np.ndarray] = {}
        """Directions: of forces on the taxels, shape ``(n_taxels, 3)``; of a wrench, shape ``(6,)``."""
        if self.n and quantities & {*CONTACT, "vibration"}:
            self.axes |= {"push": -layout.normals, "x": layout.x_axes, "y": layout.y_axes}
        if self.n and "wrench" in quantities:
            self.axes |= dict(zip(WRENCH, np.eye(6)))
        self.limits: dict[str, tuple[float, float]] = {}
        """Least and greatest force or torque by axis [N, Nm]."""
        if self.axes:
            self._rest = self._counts(next(iter(self.axes)), 0.0)
            self.limits = {axis: (-self._limit(axis, -1.0), self._limit(axis, 1.0)) for axis in self.axes}

    def forces(self, shares: np.ndarray) -> np.ndarray:
        """Return forces [N] for shares in [0, 1] of the range of each axis, both of shape ``(n_taxels, 3)``."""
        total = np.zeros((self.n, 3))
        taxels = [axis for axis in self.axes if axis not in WRENCH]
        for k, axis in enumerate(taxels):
            low, high = self.limits[axis]
            total += (low + (high - low) * shares[:, k])[:, None] * self.axes[axis]
        return total

    @property
    def has_wrench(self) -> bool:
        """True if the device senses forces and torques."""
        return WRENCH[0] in self.axes

    @property
    def n_wrenches(self) -> int:
        """The number of points about which it senses them."""
        return sum(len(sense.at or ()) for sense in self.device.sensed if sense.quantity == "wrench")

    def wrench(self, shares: np.ndarray) -> np.ndarray:
        """Return wrenches [N, Nm] for shares in [0, 1] of the range of each component, both of shape ``(n, 6)``."""
        low, high = np.array([self.limits[axis] for axis in WRENCH]).T
        return low + (high - low) * shares

    def _reading(self, stream: str, axis: str = "", amount: float = 0.0) -> Reading:
        """Return the reading of a stream's senses for an amount [N or Nm] along an axis."""
        along = amount * self.axes[axis] if axis else np.zeros(6)
        wrench, forces = (along, np.zeros((self.n, 3))) if along.ndim == 1 else (np.zeros(6), along)
        senses = self.device.senses_of(stream)
        given = {sense.key: wrench for sense in senses if sense.quantity == "wrench"}
        return reading_of(self.device, forces, stream, **given)

    def _counts(self, axis: str, amount: float) -> np.ndarray:
        """Return the settled counts of a new device under an amount on every taxel, after one unloaded conversion."""
        device, counts = self._make(), []
        for stream in device.periods:
            calls.measure(device, self._reading(stream), 0)  # firmware that measures its baseline does so here
            reading, measured = self._reading(stream, axis, amount), None
            for k in range(1, _SETTLING_CONVERSIONS):
                measured = calls.measure(device, reading, 200_000_000 * k)
            counts += flattened(measured)
        return np.concatenate([each.ravel() for each in counts]).astype(float) if counts else np.zeros(0)

    def _limit(self, axis: str, sign: float) -> float:
        """Return the amount along an axis at which the first channel reaches its target range, or stops rising.

        A channel that jumps when the amount is doubled is an angle or a switch, and is ignored.
        """
        room = self._room()

        def shares(amount: float) -> np.ndarray:
            moved = self._counts(axis, sign * amount) - self._rest
            return np.abs(moved) / np.where(moved > 0, room[1], room[0])

        amount, before = 1e-3, np.zeros(len(self._rest))
        measures, switched = np.ones(len(before), bool), 0.0
        while amount < _MAX_FORCE_N:
            now = shares(amount)
            jumps = measures & (now > _JUMP_SHARE) & (before < 0.1 * _JUMP_SHARE)
            measures, switched = measures & ~jumps, switched or amount * jumps.any()
            if (now >= 1.0)[measures].any():
                break
            reached, was = (each.max(initial=0.0, where=measures) for each in (now, before))
            if was > 0.02 and reached <= was:  # no channel rises any further
                return amount / 4
            amount, before = amount * 2, now
        if amount >= _MAX_FORCE_N:
            return switched
        low = amount / 2
        for _ in range(6):
            middle = (low + amount) / 2
            low, amount = (low, middle) if (shares(middle) >= 1.0)[measures].any() else (middle, amount)
        return low

    def _room(self) -> np.ndarray:
        """Return the counts by which each channel may move down and up, shape ``(2, n_channels)``."""
        room = []
        shapes = [each.shape for stream in self.device.periods for each in flattened(self._measured(stream))]
        senses = [sense for stream in self.device.periods for sense in senses_of(self.device, stream)]
        for shape, sense in zip(shapes, senses):
            columns = columns_of(self.device, sense, shape)
            bounds = [[column.low, column.high] if column else [-WIDE, WIDE] for column in columns]
            low, high = np.array(bounds, float).T
            room.append(np.tile(np.stack([low, high]), int(np.prod(shape)) // max(1, len(columns))))
        limits = np.concatenate(room, axis=1)
        share = np.where(limits[1] - limits[0] > WIDE, 0.1, 0.9)
        span = np.stack([self._rest - limits[0], limits[1] - self._rest])
        return np.maximum(span, 1e-3 * (limits[1] - limits[0])) * share

    def _measured(self, stream: str) -> Any:
        return calls.measure(self._make(), self._reading(stream), 0)


def flattened(counts: Any) -> list[np.ndarray]:
    """Return the counts of a conversion, an array for each sense."""
    return [np.asarray(each) for each in counts.values()] if isinstance(counts, Mapping) else [np.asarray(counts)]


def senses_of(device: Device, stream: str) -> list[str]:
    """Return the keys of the senses in the order of :func:`flattened`; "" if the device does not name them."""
    counts = calls.measure(device, reading_of(device, 0.0, stream), 0)
    return list(counts) if isinstance(counts, Mapping) else [""]


def columns_of(device: Device, sense: str, shape: tuple[int, ...]) -> list[Any]:
    """Return the declared columns of a sense's counts, one for each number of a point; None for undeclared ones."""
    width = int(np.prod(shape[1:]))
    own = [column for column in device.columns if not column.shared]
    named, unnamed = ([column for column in own if column.sense == each] for each in (sense, ""))
    return next((list(found) for found in (named, unnamed, own) if len(found) == width), [None] * width)


class Excitation:
    """A source for :func:`tactemu.serve`: random readings of all skins over time [s].

    Args:
        spans: by skin.
        seed: of all random values.
    """

    def __init__(self, spans: Mapping[str, ExcitationRange], seed: int = 0):
        self.spans, self.seed = dict(spans), seed
        self.mode: Mode = "untouched"
        self.hold_ns = 0
        """Time for which ``steps`` holds a value [ns]."""
        self.dead: dict[str, int] = {}
        """Number of the taxel that stays unloaded, by skin."""
        self.overload = 1.0
        """Factor on the forces; above 1 they exceed the range of the channels."""

    def __call__(self, t_s: float) -> dict[str, dict[str, Any]]:
        """Return the quantities on each skin at a time."""
        t_ns = round(t_s * 1e9)
        if self.mode == "steps" and self.hold_ns:
            t_ns -= t_ns % self.hold_ns
        return {name: self._quantities(k, name, t_ns) for k, name in enumerate(self.spans)}

    def _quantities(self, k: int, name: str, t_ns: int) -> dict[str, Any]:
        span, is_untouched = self.spans[name], self.mode == "untouched"
        random = np.random.default_rng((self.seed, k, t_ns))
        if is_untouched:
            forces, wrench = np.zeros((span.n, 3)), np.zeros(6)
            around = (25.0, (0.0, 0.0, 9.80665), (0.0, 0.0, 0.0))
        else:
            forces = self.overload * span.forces(random.random((span.n, 3)))
            around = (random.uniform(10.0, 40.0), random.uniform(-9.0, 9.0, 3), random.uniform(-1.0, 1.0, 3))
            wrench = (
                self.overload * span.wrench(random.random((span.n_wrenches, 6))) if span.has_wrench else np.zeros(6)
            )
            if span.n > 2 * _FEW_TAXELS and not random.integers(_FEW_TAXELS_EVERY):
                forces[random.permutation(span.n)[_FEW_TAXELS:]] = 0.0
        if name in self.dead and span.n:
            forces[self.dead[name] % span.n] = 0.0
        values: dict[str, Any] = {each: _quantity(each, span.device, forces) for each in span.device.contact}
        if span.has_wrench:
            values["wrench"] = wrench
        return values | dict(zip(("temperature", "acceleration", "angular_velocity"), around))


def _quantity(quantity: str, device: Device, forces: np.ndarray) -> np.ndarray:
    layout = device.layout
    match quantity:
        case "force":
            return forces
        case "displacement":
            return METRES_PER_NEWTON * forces
        case "pressure":
            return layout.push(forces) / layout.areas
        case "depth":
            return METRES_PER_NEWTON * layout.push(forces)
        case _:
            return layout.push(forces) > 0
