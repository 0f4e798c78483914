"""Recorded readings in place of physics: skins of a scene whose readings come from a truth log."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from firmware_protocols import Device
from firmware_protocols.senses import VECTORS
from tactemu.base.errors import SceneError, TactemuError, no_such
from tactemu.scene.placement import AMBIENT
from tactemu.truth import read_log


class RecordedReadings:
    """The readings of one device in a truth log, which replace physics.

    Between two samples the earlier one holds; before the first sample, the first.

    Args:
        path: a truth log (``tactemu run --truth FILE``).
        device: the device of the samples; optional if the log has only one.

    Raises:
        TactemuError: the file is no truth log, or has no samples of this device.
    """

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ("times_ns", "_measured", "_ideal")

    imperfections = None
    """Always ``None``: the recording contains the imperfections of its sensor."""
    wrench = None
    """Always ``None``: the wrench follows from the forces."""

    def __init__(self, path: str | Path, device: str = ""):
        log = read_log(path)
        names = sorted(name for name, skin in log.items() if len(skin.t_ns))
        if not device and len(names) == 1:
            device = names[0]
        if device not in names:
            several = f"it has samples of {', '.join(names) or 'no skin'}; name one with `readings_of`"
            raise TactemuError(f"{path}: {no_such('skin', device, names) if device else several}")
        skin = log[device]
        if object in (skin.measured.dtype, skin.ideal.dtype):
            raise TactemuError(f"{path}: the samples of {device!r} do not all have one shape")
        self.times_ns = skin.t_ns
        self._measured, self._ideal = np.asarray(skin.measured, float), np.asarray(skin.ideal, float)
        self._now = 0

    def advance_to(self, t_ns: int) -> None:
        """Select the sample of this time."""
        self._now = max(0, int(np.searchsorted(self.times_ns, t_ns, side="right")) - 1)

    def ambient(self, name: str, t_ns: int, link: str = "") -> Any:
        """Return room temperature and gravity at rest, since a truth log does not record them."""
        return AMBIENT[name]

    def quantity(self, name: str, ground_truth: bool = False) -> np.ndarray:
        """Return the recorded reading of the present time, of whatever quantity; shape ``(n_taxels[, 3])``."""
        return (self._ideal if ground_truth else self._measured)[self._now]


def recorded_readings(path: Path, of: str | None, skin: str, device: Device) -> RecordedReadings:
    """Return the samples of one device in a truth log, as a source for ``device``.

    Raises:
        TactemuError: the file is no truth log, or its samples do not fit the device.
    """
    readings = RecordedReadings(path, of or "")
    quantity = device.contact[0]
    first = readings.quantity(quantity)
    vector = quantity in VECTORS
    expected = (len(device.layout), 3) if vector else (len(device.layout),)
    if first.shape != expected:
        raise SceneError(
            f"skin {skin!r}: readings: {path} holds readings of shape {first.shape}; "
            f"{device.name} senses {quantity}, shape {expected}"
        )
    return readings


class Playback:
    """The recordings of some skins together with the simulation of the others, if any, as one simulation."""

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ()

    def __init__(self, simulation: Any, recordings: Sequence[RecordedReadings]):
        self.simulation, self.recordings = simulation, recordings
        self.time_ns = 0
        """The present time."""

    @property
    def dt_ns(self) -> int:
        """Length of a simulation step; 0 where nothing is simulated."""
        return self.simulation.dt_ns if self.simulation is not None else 0

    @property
    def plan(self) -> Any:
        """The plan of a simulation step; ``None`` where nothing is simulated."""
        return self.simulation.plan if self.simulation is not None else None

    def advance_to(self, t_ns: int, max_steps: int | None = None) -> bool:
        """Bring recordings and simulation to ``t_ns``; return True if a simulation step was stretched."""
        for recording in self.recordings:
            recording.advance_to(t_ns)
        self.time_ns = t_ns
        if self.simulation is None:
            return False
        stretched = self.simulation.advance_to(t_ns, max_steps)
        self.time_ns = self.simulation.time_ns
        return stretched
