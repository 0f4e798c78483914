"""Recorded readings in place of physics: skins of a scene that feel what a truth log says was felt."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

from firmware_protocols import Device
from firmware_protocols.device import VECTORS
from tactemu.errors import SceneError
from tactemu.recordings.recording import RecordedReadings


def recorded(path: Path, of: str | None, skin: str, device: Device) -> RecordedReadings:
    """The samples of one device in a truth log, as a source for ``device``.

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
    """What the loop advances where some skins play recordings: them, and the simulation of the others, if any."""

    not_state: ClassVar[tuple[str, ...]] = ()

    def __init__(self, simulation: Any, recordings: Sequence[RecordedReadings]):
        self.simulation, self.recordings = simulation, recordings
        self.time_ns = 0
        """Time reached."""

    @property
    def dt_ns(self) -> int:
        """Length of a simulation step; 0 where nothing is simulated."""
        return self.simulation.dt_ns if self.simulation is not None else 0

    @property
    def plan(self) -> Any:
        """What a simulation step computes; ``None`` where nothing is simulated."""
        return self.simulation.plan if self.simulation is not None else None

    def advance_to(self, t_ns: int, max_steps: int | None = None) -> bool:
        """Bring everything to ``t_ns``; true if a simulation step was stretched."""
        for recording in self.recordings:
            recording.advance_to(t_ns)
        self.time_ns = t_ns
        if self.simulation is None:
            return False
        stretched = self.simulation.advance_to(t_ns, max_steps)
        self.time_ns = self.simulation.time_ns
        return stretched
