"""What the taxels of a judged device feel: at every sample something else, so that a reading names its sample.

Physics cannot do that: contact only pushes, a press moves few taxels, neighbours are alike, and rest repeats itself.
Here every taxel takes a new random value at every sample, by seed and time, over what its channels can show, both ways
where they go both ways. How much force that takes no device says; it is found out from the device itself.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Literal

import numpy as np

from firmware_protocols import Device, Reading, calls
from firmware_protocols.check.readings import METRES_PER_NEWTON, reading_of

Mode = Literal["rest", "random", "steps"]
STEP = 32
"""Samples for which ``steps`` holds a value: a driver that filters comes to rest within them."""
WIDE = 5000
"""Channels with more counts than this are driven over a tenth of them: beyond their rating sensors raise flags."""
_STRONGEST = 1e7
"""Force at which a device is given up that shows nothing [N]."""
_SETTLE = 12
"""Conversions, a fifth of a second apart, after which a device's own filter has come to rest."""


class Span:
    """How far a device may be driven: the largest push, pull and sideways force on each taxel [N]."""

    def __init__(self, make: Callable[[], Device]):
        device = make()
        self.device, self.n = device, len(device.layout)
        self._make = make
        layout = device.layout
        self.axes = {"push": -layout.normals, "x": layout.x_axes, "y": layout.y_axes}
        """Directions of a force on the skin, shape ``(n_taxels, 3)``."""
        self.limits: dict[str, tuple[float, float]] = {}
        """Least and greatest force by axis [N]."""
        if self.n:
            self._rest = self._counts("push", 0.0)
            self.limits = {axis: (-self._limit(axis, -1.0), self._limit(axis, 1.0)) for axis in self.axes}

    def forces(self, shares: np.ndarray) -> np.ndarray:
        """Forces [N] for shares in [0, 1] of what each axis bears, both of shape ``(n_taxels, 3)``."""
        total = np.zeros((self.n, 3))
        for k, (axis, (low, high)) in enumerate(self.limits.items()):
            total += (low + (high - low) * shares[:, k])[:, None] * self.axes[axis]
        return total

    def _counts(self, axis: str, newtons: float) -> np.ndarray:
        """What a fresh device shows of this force on every taxel, once it has come to rest."""
        device, forces, counts = self._make(), newtons * self.axes[axis], []
        for stream in device.periods:
            reading, felt = reading_of(device, forces, stream), None
            for k in range(_SETTLE):
                felt = calls.feel(device, Reading(reading.values, stream), 200_000_000 * k)
            counts += flattened(felt)
        return np.concatenate([each.ravel() for each in counts]) if counts else np.zeros(0)

    def _limit(self, axis: str, sign: float) -> float:
        """The force along an axis at which the first channel has gone as far as it shall, or the last that it shows."""
        room = self._room()

        def share(newtons: float) -> float:
            moved = self._counts(axis, sign * newtons) - self._rest
            return float(np.max(np.abs(moved) / np.where(moved > 0, room[1], room[0]), initial=0.0))

        newtons, before = 1e-3, 0.0
        while newtons < _STRONGEST and (now := share(newtons)) < 1.0:
            if before > 0.02 and now <= before:  # it shows no more
                return newtons / 4
            newtons, before = newtons * 2, now
        if newtons >= _STRONGEST:
            return 0.0
        low = newtons / 2
        for _ in range(6):
            middle = (low + newtons) / 2
            low, newtons = (low, middle) if share(middle) >= 1.0 else (middle, newtons)
        return low

    def _room(self) -> np.ndarray:
        """By how many counts each channel may move down and up, shape ``(2, n_channels)``."""
        room = []
        shapes = [each.shape for stream in self.device.periods for each in flattened(self._felt(stream))]
        senses = [sense for stream in self.device.periods for sense in senses_of(self.device, stream)]
        for shape, sense in zip(shapes, senses):
            columns = columns_of(self.device, sense, shape)
            bounds = [[column.low, column.high] if column else [-WIDE, WIDE] for column in columns]
            low, high = np.array(bounds, float).T
            room.append(np.tile(np.stack([low, high]), int(np.prod(shape)) // max(1, len(columns))))
        whole = np.concatenate(room, axis=1)
        share = np.where(whole[1] - whole[0] > WIDE, 0.1, 0.9)
        span = np.stack([self._rest - whole[0], whole[1] - self._rest])
        return np.maximum(span, 1e-3 * (whole[1] - whole[0])) * share

    def _felt(self, stream: str) -> Any:
        device = self._make()
        return calls.feel(device, reading_of(device, 0.0, stream), 0)


def flattened(counts: Any) -> list[np.ndarray]:
    """The counts of a conversion, an array for each sense."""
    return [np.asarray(each) for each in counts.values()] if isinstance(counts, Mapping) else [np.asarray(counts)]


def senses_of(device: Device, stream: str) -> list[str]:
    """Keys of the senses in the order of :func:`flattened`; "" where the device does not name them."""
    felt = calls.feel(device, reading_of(device, 0.0, stream), 0)
    return list(felt) if isinstance(felt, Mapping) else [""]


def columns_of(device: Device, sense: str, shape: tuple[int, ...]) -> list[Any]:
    """The declared columns of a sense's counts, one for each number of a point; ``None`` where there is none."""
    width = int(np.prod(shape[1:]))
    own = [column for column in device.columns if column.sense == sense and not column.shared]
    if len(own) != width:
        own = [column for column in device.columns if not column.shared]
    return own if len(own) == width else [None] * width


class Excitation:
    """A source for :func:`tactemu.serve`: readings of all skins over time [s].

    Args:
        spans: by skin.
        seed: of all that is random.
    """

    def __init__(self, spans: Mapping[str, Span], seed: int = 0):
        self.spans, self.seed = dict(spans), seed
        self.mode: Mode = "rest"
        self.hold_ns = 0
        """How long ``steps`` holds a value [ns]."""
        self.dead: dict[str, int] = {}
        """A taxel that feels nothing, by skin."""
        self.beyond = 1.0
        """How far beyond what the channels show the forces go: 1 is not at all."""

    def __call__(self, t_s: float) -> dict[str, dict[str, Any]]:
        """What the skins feel at a time."""
        t_ns = round(t_s * 1e9)
        if self.mode == "steps" and self.hold_ns:
            t_ns -= t_ns % self.hold_ns
        return {name: self._felt(k, name, t_ns) for k, name in enumerate(self.spans)}

    def _felt(self, k: int, name: str, t_ns: int) -> dict[str, Any]:
        span, resting = self.spans[name], self.mode == "rest"
        random = np.random.default_rng((self.seed, k, t_ns))
        if resting:
            forces, around = np.zeros((span.n, 3)), (25.0, (0.0, 0.0, 9.80665), (0.0, 0.0, 0.0))
        else:
            forces = self.beyond * span.forces(random.random((span.n, 3)))
            around = (random.uniform(10.0, 40.0), random.uniform(-9.0, 9.0, 3), random.uniform(-1.0, 1.0, 3))
        if name in self.dead and span.n:
            forces[self.dead[name] % span.n] = 0.0
        felt = {quantity: _quantity(quantity, span.device, forces) for quantity in span.device.contact}
        return felt | dict(zip(("temperature", "acceleration", "angular_velocity"), around))


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
