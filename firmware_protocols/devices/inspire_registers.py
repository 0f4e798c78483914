"""The RH56DFTP's memory besides touch: parameters, targets of the six actuators, and what they report.

Byte-addressed; 16-bit values little-endian. See :mod:`firmware_protocols.devices.inspire_rh56dftp` for the table.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from firmware_protocols.modbus import ILLEGAL_ADDRESS, ILLEGAL_VALUE, Refused

ACTUATORS = 6
MEMORY_END = 6000
FULL_STROKE_S = 0.8
MOVING_MA = 200
STANDARD_GRAVITY = 9.80665


@dataclass(frozen=True, kw_only=True)
class Field:
    """Values of one kind: ``count`` of them from ``address``, each of 1 byte (unsigned) or 2 (signed)."""

    address: int
    low: int
    high: int
    default: int = 0
    count: int = ACTUATORS
    width: int = 2

    @property
    def format(self) -> str:
        """For :mod:`struct`."""
        return f"<{self.count}{'h' if self.width == 2 else 'B'}"

    def get(self, memory: bytearray) -> np.ndarray:
        """All values, shape ``(count,)``."""
        return np.array(struct.unpack_from(self.format, memory, self.address))

    def put(self, memory: bytearray, values: Sequence[float] | np.ndarray) -> None:
        """Store values, rounded and kept in range."""
        counts = np.clip(np.rint(values), self.low, self.high).astype(int)
        struct.pack_into(self.format, memory, self.address, *counts.tolist())

    def holds(self, memory: bytearray) -> bool:
        """Whether all its values are in range."""
        return all(self.low <= value <= self.high for value in self.get(memory))


UNIT = Field(address=1000, count=1, width=1, low=1, high=254, default=1)
LINE_SPEED = Field(address=1002, count=1, width=1, low=0, high=3)
CLEAR_ERROR = Field(address=1004, count=1, width=1, low=0, high=1)
SAVE = Field(address=1005, count=1, width=1, low=0, high=1)
RESTORE = Field(address=1006, count=1, width=1, low=0, high=1)
ZERO_FORCE = Field(address=1009, count=1, width=1, low=0, high=1)
DEFAULT_SPEED = Field(address=1032, low=0, high=1000, default=1000)
DEFAULT_FORCE = Field(address=1044, low=0, high=1000, default=500)
POSITION_SET = Field(address=1474, low=-1, high=2000, default=-1)
ANGLE_SET = Field(address=1486, low=-1, high=1000, default=-1)
FORCE_SET = Field(address=1498, low=0, high=3000)
SPEED_SET = Field(address=1522, low=0, high=1000)
POSITION = Field(address=1534, low=0, high=2000)
ANGLE = Field(address=1546, low=0, high=1000)
FORCE = Field(address=1582, low=-4000, high=4000)
CURRENT = Field(address=1594, low=0, high=2000)
STATUS = Field(address=1612, width=1, low=0, high=255)
TEMPERATURE = Field(address=1618, width=1, low=0, high=100)

KEPT = (UNIT, LINE_SPEED, DEFAULT_SPEED, DEFAULT_FORCE)
"""Parameters that the flash keeps."""
ORDERS = (CLEAR_ERROR, SAVE, RESTORE, ZERO_FORCE)
"""Read zero again when obeyed."""
WRITABLE = ((1000, 1060), (1464, 1534))
CHECKED = (*KEPT, *ORDERS, POSITION_SET, ANGLE_SET, FORCE_SET, SPEED_SET)
OPEN, CLOSED_POSITION = 1000, 2000


class HandRegisters:
    """Memory and six actuators. Angle 1000 is open, 0 closed; position = 2000 - 2 angle."""

    def __init__(self):
        self._memory = bytearray(MEMORY_END)
        for field in KEPT:
            field.put(self._memory, [field.default] * field.count)
        self._flash = bytes(self._memory)
        self._forces = np.zeros(ACTUATORS)
        self._zero = np.zeros(ACTUATORS)
        self.power_on(0)

    @property
    def unit(self) -> int:
        """Modbus unit at power-up."""
        return int(UNIT.get(self._memory)[0])

    def power_on(self, t_ns: int) -> None:
        """Parameters from flash, hand open, defaults in force."""
        self._memory = bytearray(self._flash)
        SPEED_SET.put(self._memory, DEFAULT_SPEED.get(self._memory))
        FORCE_SET.put(self._memory, DEFAULT_FORCE.get(self._memory))
        for field in (POSITION_SET, ANGLE_SET):
            field.put(self._memory, [field.default] * ACTUATORS)
        TEMPERATURE.put(self._memory, [25] * ACTUATORS)
        self._angles = np.full(ACTUATORS, float(OPEN))
        self._targets = self._angles.copy()
        self._now_ns = t_ns
        self._zero = np.zeros(ACTUATORS)

    def feel(self, *, forces: Sequence[float], temperature: float) -> None:
        """What the six actuators feel: forces [N], temperature [deg C]."""
        self._forces = np.asarray(forces) / STANDARD_GRAVITY * 1000
        TEMPERATURE.put(self._memory, [temperature] * ACTUATORS)

    def snapshot(self, t_ns: int) -> bytearray:
        """The memory as a read at ``t_ns`` finds it."""
        self._advance(t_ns)
        away = self._targets - self._angles
        put = {
            ANGLE: self._angles,
            POSITION: CLOSED_POSITION - 2 * self._angles,
            FORCE: self._forces - self._zero,
            CURRENT: MOVING_MA * (away != 0),
            STATUS: np.select([away == 0, away < 0], [2, 1], 0),
        }
        for field, values in put.items():
            field.put(self._memory, values)
        return bytearray(self._memory)

    def write(self, address: int, data: bytes, t_ns: int) -> None:
        """Store ``data`` at ``address`` and do what it orders.

        Raises:
            Refused: not writable, or out of range; nothing has changed then.
        """
        end = address + len(data)
        if not any(low <= address and end <= high for low, high in WRITABLE):
            raise Refused(ILLEGAL_ADDRESS)
        memory = bytearray(self._memory)
        memory[address:end] = data
        touched = [f for f in CHECKED if f.address < end and address < f.address + f.count * f.width]
        if not all(field.holds(memory) for field in touched):
            raise Refused(ILLEGAL_VALUE)
        self._advance(t_ns)
        self._memory = memory
        self._aim(touched)
        self._obey()

    def _aim(self, touched: list[Field]) -> None:
        """New targets; -1 leaves an actuator as it is."""
        for field, to_angle in ((POSITION_SET, lambda p: (CLOSED_POSITION - p) / 2), (ANGLE_SET, lambda a: a)):
            if field in touched:
                wanted = field.get(self._memory)
                self._targets = np.where(wanted >= 0, to_angle(wanted), self._targets)

    def _obey(self) -> None:
        """Carry out the orders that read 1, and take them back."""
        given = [field for field in ORDERS if field.get(self._memory)[0]]
        for field in given:
            field.put(self._memory, [0])
        if RESTORE in given:
            for field in KEPT:
                field.put(self._memory, [field.default] * field.count)
        if ZERO_FORCE in given:
            self._zero = self._forces.copy()
        if SAVE in given:
            kept = bytearray(MEMORY_END)
            for field in KEPT:
                field.put(kept, field.get(self._memory))
            self._flash = bytes(kept)

    def _advance(self, t_ns: int) -> None:
        """Each actuator towards its target at its own speed."""
        seconds = max(t_ns - self._now_ns, 0) * 1e-9
        self._now_ns = max(t_ns, self._now_ns)
        reach = SPEED_SET.get(self._memory) / FULL_STROKE_S * seconds
        self._angles = self._angles + np.clip(self._targets - self._angles, -reach, reach)
