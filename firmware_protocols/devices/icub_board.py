"""A board of the iCub skin (MTB, MTB4): the values of its triangles, their compensation, and its messages.

The datasheet of the skin is :mod:`firmware_protocols.devices.icub_skin`.
"""

from dataclasses import dataclass, field
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np

from firmware_protocols import CanFrames, Frame, quantize
from firmware_protocols.devices.icub_triangles import PADS_PER_TRIANGLE, THERMAL_PADS

HEAD = Frame("""
    head, id 100 bbbb tttt (b board, t triangle)
    0    40        head
    1    u1 x 7    pads            0 to 6
""")
TAIL = Frame("""
    tail, id 100 bbbb tttt (b board, t triangle)
    0    C0        tail
    1    u1 x 5    pads            7 to 11
    6    u1        out_of_range    pads 11 to 4, a bit each
    7    u1        ending          out of range, pads 3 to 0; four bits of flags
""")
TRIANGLES_PER_BOARD, CHIPS_PER_BOARD = 16, 17
NO_ACK, NOT_CONNECTED = 1, 2
TO_ALL = 0xF
NEW_CLASS, OLD_CLASS = 4, 3
"""The classes of the identifiers of new and old firmware."""
TYPE_TEMPERATURE, TYPE_PALM_OR_TIP, TYPE_ERGO_HAND, TYPE_TEST, TYPE_TEMPERATURE_V2 = 0, 1, 3, 7, 8
DRIFT_GAINS = {
    TYPE_TEMPERATURE: (70, 96, 83, 38, 38, 70, 0, 45, 77, 164, 0, 77),
    TYPE_PALM_OR_TIP: (0,) * PADS_PER_TRIANGLE,
    TYPE_ERGO_HAND: (58, 91, 39, 23, 35, 90, 0, 38, 68, 115, 0, 86),
    TYPE_TEMPERATURE_V2: (58, 91, 39, 23, 35, 90, 0, 38, 68, 115, 0, 86),
}
"""The gain of each pad by type, in 1/128 of the thermal pad's drift."""
ERGO_WIRE_ORDER = np.array([0, 4, 8, 12, 16, 9, 10, 11, 13, 15, 1, 2, 3, 5, 6, 7])
"""The chip of each triangle of an ergoCub hand, in wire order; 0 to 4 are fingertips, without compensation."""
WIRE_ORDER = np.arange(16)
ABSENT = 0xFFFF
MAX_UNACKNOWLEDGED = 5
BOARD_TYPE = 11
VERSION = (1, 25, 0)
PROTOCOL = (2, 0)
INFORMATION = b"skin".ljust(32, b"\0")
NS_PER_MS = 1_000_000

_MASK = 1 << np.arange(PADS_PER_TRIANGLE)
RAW_AT_REST, MAX_RAW = 0x6000, 0xFFFF
RAW_COUNTS_PER_NEWTON = 600.0
RAW_COUNTS_PER_DEG = 20.0
NO_LOAD_COUNTS, OLD_NO_LOAD_COUNTS = 245, 240
POWER_UP_SHIFT = 2


class Blank(NamedTuple):
    """The frames of some triangles, still without values."""

    frames: CanFrames
    data: np.ndarray
    """The data bytes of head and tail, shape ``(n, 2, 8)``."""
    head_pads: slice
    tail_pads: slice
    out_of_range: slice
    ending: slice


@lru_cache(256)
def _blank(_tables: tuple[str, str], ident: int, enabled: bytes) -> Blank:
    """Return blank frames of the enabled triangles; ``_tables`` makes a changed table a new key of the cache."""
    which = np.flatnonzero(np.frombuffer(enabled, bool))
    head, tail = HEAD.pack(pads=[0] * 7), TAIL.pack(pads=[0] * 5, out_of_range=0, ending=0)
    data = np.frombuffer((head + tail) * len(which), np.uint8).reshape(-1, 2, 8)
    frames = CanFrames.of(np.repeat(ident | which, 2), data.reshape(-1, 8))
    return Blank(frames, data, HEAD.slice_of("pads"), *map(TAIL.slice_of, ("pads", "out_of_range", "ending")))


def _wire_order_of(kind: int) -> np.ndarray:
    """Return the chip of each triangle in wire order."""
    return ERGO_WIRE_ORDER if kind == TYPE_ERGO_HAND else WIRE_ORDER


@cache
def _sent_as(kind: int) -> np.ndarray:
    """Return the number under which each chip of a type is sent, 16 for none, shape ``(17,)``."""
    numbers = np.full(CHIPS_PER_BOARD, TRIANGLES_PER_BOARD)
    numbers[_wire_order_of(kind)] = WIRE_ORDER
    return numbers


@cache
def _settings_of(kind: int) -> np.ndarray:
    """Return the number of the triangle whose settings each chip of a type has, shape ``(17,)``."""
    return np.minimum(_sent_as(kind), TRIANGLES_PER_BOARD - 1)


@cache
def _gain_of(kind: int) -> np.ndarray | None:
    """Return the drift gain of each chip's pads [1/128], shape ``(17, 12)``; None for a type without compensation."""
    if kind not in DRIFT_GAINS:
        return None
    is_compensated = (_sent_as(kind) > 4)[:, None] if kind == TYPE_ERGO_HAND else np.ones((CHIPS_PER_BOARD, 1), bool)
    return np.where(is_compensated, np.array(DRIFT_GAINS[kind]), 0)


@dataclass(eq=False)
class Board:
    """One microcontroller with its triangles, as it powers up: silent, all enabled, calibrated at rest and 25 deg C."""

    address: int
    taxels: np.ndarray
    """The indices of its taxels in the layout, in the order of the pads, triangle by triangle."""
    normals: np.ndarray
    """The normals of these taxels."""
    numbers: np.ndarray
    """The numbers of its triangles."""
    feeling: list[tuple[int, ...]]
    """The pads of each triangle that are taxels."""
    flags: np.ndarray
    """The flags of each triangle: acknowledged, connected."""
    pattern: np.ndarray
    """The amount by which each pad at rest is below its calibration [raw counts]."""
    family: int = NEW_CLASS
    """The class of its identifiers."""
    kind: int = TYPE_TEMPERATURE
    no_load: int = NO_LOAD_COUNTS
    period_ns: int = 50 * NS_PER_MS
    transmitting: bool = False
    raw: np.ndarray = field(init=False)
    """The reading of the converter for every pad, shape ``(17, 12)``."""
    pads: np.ndarray = field(init=False)
    """The value that is sent for every pad, uint8, from the first conversion on."""

    def __post_init__(self):
        n = len(self.flags)
        self.has_flags = bool(self.flags.any())
        self.raw = np.full((CHIPS_PER_BOARD, PADS_PER_TRIANGLE), ABSENT)
        self.shift = np.full(TRIANGLES_PER_BOARD, POWER_UP_SHIFT)
        self.enabled = np.ones(TRIANGLES_PER_BOARD, bool)
        self.unheard, self.calibrates = 0, False
        self.pad_of = np.concatenate([PADS_PER_TRIANGLE * k + np.array(pads) for k, pads in enumerate(self.feeling)])
        self.taxel_of = np.full((n, PADS_PER_TRIANGLE), len(self.pad_of))
        self.taxel_of.ravel()[self.pad_of] = np.arange(len(self.pad_of))
        self.pattern = np.where(self.taxel_of < len(self.pad_of), self.pattern, 0)
        sizes = np.array([len(pads) for pads in self.feeling])
        self.sizes, self.starts = sizes[:, None], np.cumsum(sizes) - sizes
        drifts = RAW_COUNTS_PER_DEG * np.array(DRIFT_GAINS[TYPE_TEMPERATURE]) / 128
        drifts[list(THERMAL_PADS)] = RAW_COUNTS_PER_DEG
        self.per_deg = np.where(self.sizes == PADS_PER_TRIANGLE, RAW_COUNTS_PER_DEG, drifts)
        self.offset = np.full((CHIPS_PER_BOARD, PADS_PER_TRIANGLE), ABSENT)
        self.raw[self.numbers] = np.where(self.flags[:, None] == NOT_CONNECTED, ABSENT, RAW_AT_REST)
        self.offset[self.numbers] = np.where(self.flags[:, None] == NOT_CONNECTED, ABSENT, RAW_AT_REST + self.pattern)

    def convert(self, push: np.ndarray, temperature: np.ndarray) -> np.ndarray:
        """Return the value of every pad of the fitted triangles, uint8, shape ``(n_triangles, 12)``.

        Args:
            push: normal force on each taxel [N].
            temperature: temperature of each taxel [deg C].
        """
        warmth = np.add.reduceat(temperature, self.starts)[:, None] / self.sizes - 25.0
        pushed = np.zeros(len(push) + 1)  # a thermal pad has no push: the last entry
        pushed[:-1] = RAW_COUNTS_PER_NEWTON * push
        fitted = quantize(RAW_AT_REST + self.per_deg * warmth + pushed[self.taxel_of], high=MAX_RAW - 1)
        if self.has_flags:
            fitted[self.flags == NO_ACK], fitted[self.flags == NOT_CONNECTED] = 0, ABSENT
        self.raw[self.numbers] = fitted
        if self.calibrates:
            self.calibrate()
        settings, gain = _settings_of(self.kind), _gain_of(self.kind)
        change = self.raw - self.offset
        if gain is not None:
            thermal = change[:, THERMAL_PADS[:1]]
            change = change - (np.where(thermal > 0, thermal >> 2, -(-thermal >> 2)) * gain >> 5)
        shift = self.shift[settings][:, None]
        self.pads = np.minimum(np.maximum(self.no_load - (change >> shift), 0), 255).astype(np.uint8)
        self.out = (change <= -(255 - self.no_load << shift) * 2) | (change >= (self.no_load << shift) * 2)
        if self.kind == TYPE_TEST:
            self.pads, self.out = (self.raw & 0xFF).astype(np.uint8), np.zeros_like(self.out)
        return self.pads[self.numbers]

    def calibrate(self) -> None:
        """Make the present readings the no load; a chip that does not acknowledge keeps its old one."""
        own, acknowledged = self.numbers, (self.flags != NO_ACK)[:, None]
        fitted = self.raw[own] + np.where(self.flags[:, None] == NOT_CONNECTED, 0, self.pattern)
        self.offset[own] = np.where(acknowledged, fitted, self.offset[own])
        self.calibrates = False

    def frames(self) -> CanFrames:
        """Return head and tail of every enabled triangle."""
        which, ident = self.enabled, self.family << 8 | self.address << 4
        blank = _blank((HEAD.text, TAIL.text), ident, which.tobytes())
        chips = _wire_order_of(self.kind)[which]
        data, pads, raw = blank.data.copy(), self.pads[chips], self.raw[chips]
        mask = self.out[chips, None] @ _MASK
        data[:, 0, blank.head_pads] = pads[:, :7]
        data[:, 1, blank.tail_pads] = pads[:, 7:]
        data[:, 1, blank.out_of_range] = mask >> 4
        flags = np.zeros((len(chips), 1), np.uint8)
        if self.kind != TYPE_TEST:
            unheard = np.logical_or.reduce((raw == 0) & (self.offset[chips] != 0), 1)
            flags[:, 0] = NO_ACK * unheard + NOT_CONNECTED * np.logical_and.reduce(raw == ABSENT, 1)
            self.unheard += np.count_nonzero(unheard)
        if self.unheard >= MAX_UNACKNOWLEDGED:
            self.unheard, self.calibrates = 0, True
        data[:, 1, blank.ending] = (mask & 0xF) << 4 | flags
        return blank.frames.with_data(data.reshape(-1, 8))

    def answers(self, klass: int, data: bytes) -> list[bytes]:
        """Return the answers to a request for version or identity; none for other messages."""
        match klass, tuple(data):
            case 2, [0x1C, *wanted] if self.family == NEW_CLASS:
                major, minor = (*wanted, 0, 0)[:2]
                is_wanted = major == PROTOCOL[0] and minor <= PROTOCOL[1]
                return [bytes([0x1C, BOARD_TYPE, *VERSION, *PROTOCOL, is_wanted])]
            case 7, [0xFF, *_] if self.family == NEW_CLASS:
                return [bytes([0xFF, BOARD_TYPE, *VERSION])]
            case 7, [0x0C, *_] if self.family == NEW_CLASS:
                return [bytes([0x0C, k, *INFORMATION[4 * k :][:4]]) for k in range(8)]
        return []

    def obey(self, data: bytes) -> bool:
        """Obey one message; return False if the board does not know it."""
        match tuple(data):
            case [0x07, (0 | 1) as stop, *_]:
                self.transmitting = not stop
            case [0x4D, kind, period, no_load, *_] if self.family == NEW_CLASS:
                self.kind, self.period_ns, self.no_load = kind, max(period, 1) * NS_PER_MS, no_load
                self.enabled[:] = False
            case [0x50, first, last, shift, enable, _, _, *_] if (
                self.family == NEW_CLASS and first <= last < TRIANGLES_PER_BOARD
            ):
                self.transmitting = False
                self.enabled[first : last + 1], self.shift[first : last + 1] = bool(enable & 1), min(shift, 15)
                self.calibrate()
            case [0x4C, *_]:
                self.period_ns, self.transmitting = 40 * NS_PER_MS, True
                self.enabled[:] = True
                if self.family == NEW_CLASS:
                    self.kind, self.no_load = TYPE_TEMPERATURE, NO_LOAD_COUNTS
                self.calibrate()
            case [0x4E, *_]:
                pass
            case _:
                return False
        return True
