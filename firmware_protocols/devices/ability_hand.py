r"""PSYONIC Ability Hand: thirty touch sensors on five fingertips, and six motors, on one UART.

Wire: 460800 8N1 (or RS-485). The hand speaks only when spoken to: one reply per command. Frames are stuffed as in
PPP: 7E, the bytes with 7D and 7E sent as 7D (x ^ 20), 7E. The last byte before the closing 7E makes the byte sum 0.

    command  offset  bytes  field                 reply 0, 1  offset  bytes  field
             0       1      address, 50                       0       1      header of the command
             1       1      header                            1       24     6 x (position, current | velocity)
             2       12     6 x int16 target                  25      45     30 touch values of 12 bits
             14      1      checksum                          70      1      hot/cold mask
                                                              71      1      checksum
    header   target            scale              reply 2     0       1      header of the command
    1v       position          32767 / 150 deg                1       24     6 x (position, current)
    2v       velocity          32767 / 3000 deg/s             25      12     6 x velocity
    3v       current           620.606079 / A                 37      1      hot/cold mask
    4v       duty              3546 = 100 %                   38      1      checksum
    Av       none: read only
    1D       grip: number, speed; answered as variant 0

v = 0, 1, 2 picks the reply: position and current, position and velocity, all three without touch. All numbers are
int16 little-endian; a velocity in a reply counts 4 x 32767 / 3000 per deg/s. Joints: index, middle, ring, pinky, thumb
flexor, thumb rotator. Touch: six sites each of index, middle, ring, pinky, thumb, packed little-endian, two in three
bytes: v0 = b0 | (b1 & 0F) << 8, v1 = b1 >> 4 | b2 << 4.

    07, 08   Bluetooth on, off; 09 reset: no reply
    DA       int32 register: reply int32 register, int32 value, checksum
    DE       int32 register, int32 value: reply int32 4E11FEA4 (written) or 0, checksum

Force of a touch value D: V = 3.3 D / 4096, R = 33000 / V + 10000, F = 121591 / R + 0.878894 N, and 0 for D = 0. So no
site reads between 0 and 0.88 N, and it saturates at 6.96 N.

A wrong checksum, size or address is dropped without a word. Without a command for 300 ms the hand leaves API control.

Try it: ``tactemu run ability_hand``, then ``AHSerialClient(port=..., baud_rate=460800)``.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence

import numpy as np

from firmware_protocols.device import Command, Device, Layout, Outgoing, Reading, SerialWire, grid_layout
from firmware_protocols.devices.ability_hand_motors import HIGHEST, REST, Mode, Motors
from firmware_protocols.layouts import place, stack

FLAG, ESCAPE, MASK = 0x7E, 0x7D, 0x20
MODES: dict[int, tuple[Mode, float]] = {
    0x10: ("position", 150 / 32767),
    0x20: ("velocity", 3000 / 32767),
    0x30: ("current", 1 / 620.606079),
    0x40: ("duty", 1 / 3546),
}
"""High nibble of the header: what the target is, and its value per count [deg, deg/s, A, 1]."""
READ_ONLY, GRIP, RESET, READ_REGISTER, WRITE_REGISTER = 0xA0, 0x1D, 0x09, 0xDA, 0xDE
BLUETOOTH = (0x07, 0x08)
WRITTEN = 0x4E11FEA4
API_TIMEOUT_NS = 300_000_000
LONGEST_COMMAND = 32

POSITION_COUNTS, CURRENT_COUNTS, VELOCITY_COUNTS = 32767 / 150, 620.606079, 4 * 32767 / 3000

SITES = 6
FINGERTIPS = {
    # name: centre of the pad in the palm's frame [m]
    "index": (0.033, 0.09, 0.0),
    "middle": (0.011, 0.10, 0.0),
    "ring": (-0.011, 0.095, 0.0),
    "pinky": (-0.033, 0.08, 0.0),
    "thumb": (0.06, 0.03, 0.0),
}
GAINS = (3, 4, 1, 21, 0, 10, 1, 1773, 4, 0)
ROTATOR_GAINS = (500, 0, 5, 3, 14, 6, 1, 1773, 8, 0)
REGISTERS = 63


class AbilityHand(Device):
    """The hand, in API mode with byte stuffing on (settings We46 and We47).

    Args:
        address: first byte of the commands that it obeys.
    """

    name = "ability_hand"
    title = "PSYONIC Ability Hand"
    wires = (SerialWire(baud=460800),)
    senses = "force"
    rate_hz = 250.0
    evidence = ("vendor document", "driver")
    sources = (
        "psyonicinc/ability-hand-api@34c9a93 Documentation/ABILITY-HAND-ICD.pdf 3.4.6, 3.5.3",
        "ability-hand 0.2.2 ah_api.py, ah_parser.py l.20-100, ppp_stuffing.py, serial_connection.py l.135-225",
        "ability-hand 0.2.2 ah_examples/write_registers.py, send_misc_msg.py",
    )
    judge = "ability-hand 0.2.2"
    assumed = (
        "places of the six sites: 3 rows x 2 columns at 7 mm on each fingertip, all pads in one plane, normal +z",
        "touch is converted 250 times a second; the ICD calls the constants of its force formula placeholders",
        "motors: one time constant of 0.1 s, 200 deg/s per A, 300 deg/s at full duty, stops at 0 and 100 deg",
        "after 300 ms without a command the joints hold; the hot/cold mask is 0",
        "grip 0 opens, every other closes all fingers; registers 1..63 hold the example's gains, without effect",
    )

    def __init__(self, *, address: int = 0x50):
        super().__init__()
        self.address = address
        pads = [place(grid_layout(3, 2, 0.007, name=name), centre) for name, centre in FINGERTIPS.items()]
        self.layout: Layout = stack(*pads)
        self.power_on(0)

    def power_on(self, t_ns: int) -> Sequence[Outgoing]:
        """Fingers at rest, registers as delivered."""
        self.motors = Motors()
        self.motors.advance(t_ns)
        self.counts = np.zeros(len(self.layout), np.int64)
        self.registers = [*GAINS * 5, *ROTATOR_GAINS, *[0] * (REGISTERS - 60)]
        self._frame = bytearray()
        self._escaped = False
        self._commanded_ns = t_ns
        return ()

    @property
    def commands(self) -> tuple[Command, ...]:
        """Every command of the SDK, each reply variant."""

        def answer(variant: int) -> Callable[[list], bool]:
            size = 39 if variant == 2 else 72
            return lambda frames: len(frames) == 1 and _is_reply(frames[0], size, variant)

        targets = struct.pack("<6h", 6553, 6553, 6553, 6553, 6553, -6553)
        listed = [
            Command(name=f"{mode}, reply {v}", request=self._request(head + v, targets), reply=answer(v))
            for head, (mode, _) in MODES.items()
            for v in (0, 1, 2)
        ]
        listed += [
            Command(name=f"read only, reply {v}", request=self._request(READ_ONLY + v), reply=answer(v))
            for v in (0, 1, 2)
        ]
        return (
            *listed,
            Command(name="grip", request=self._request(GRIP, b"\x01\xff"), reply=answer(0)),
            Command(name="Bluetooth on", request=self._request(BLUETOOTH[0]), reply=None),
            Command(name="Bluetooth off", request=self._request(BLUETOOTH[1]), reply=None),
            Command(
                name="read register",
                request=self._request(READ_REGISTER, struct.pack("<i", 8)),
                reply=[framed(struct.pack("<ii", 8, 1773))],
            ),
            Command(
                name="write register",
                request=self._request(WRITE_REGISTER, struct.pack("<ii", 1, 3)),
                reply=[framed(struct.pack("<i", WRITTEN))],
            ),
            Command(name="reset", request=self._request(RESET), reply=None),
        )

    def _request(self, header: int, payload: bytes = b"") -> bytes:
        return framed(bytes([self.address, header]) + payload)

    def digitize(self, reading: Reading) -> np.ndarray:
        """12-bit touch values, shape ``(30,)``."""
        return touch_counts(self.layout.push(reading.values))

    # -- commands --------------------------------------------------------------------------------------------------

    def receive(self, data: bytes, t_ns: int) -> Sequence[Outgoing]:
        """Stuffed frames in chunks of any size."""
        answers: list[Outgoing] = []
        for byte in data:
            if byte == FLAG:
                answers += self._obey(bytes(self._frame), t_ns)
                self._frame.clear()
                self._escaped = False
            elif byte == ESCAPE:
                self._escaped = True
            elif len(self._frame) < LONGEST_COMMAND:
                self._frame.append(byte ^ MASK if self._escaped else byte)
                self._escaped = False
        return answers

    def _obey(self, frame: bytes, t_ns: int) -> list[bytes]:
        if len(frame) < 3:
            self.counters["skipped_bytes"] += len(frame)
            return []
        if sum(frame) & 0xFF:
            self.counters["bad_checksum"] += 1
            return []
        address, header, payload = frame[0], frame[1], frame[2:-1]
        if address != self.address:
            self.counters["other_address"] += 1
            return []
        answer = self._answer(header, payload, t_ns)
        self.counters["requests" if answer is not None else "unknown_command"] += 1
        return answer or []

    def _answer(self, header: int, payload: bytes, t_ns: int) -> list[bytes] | None:
        """Replies, or ``None`` for a command or size that the hand does not know."""
        self._leave_api_control(t_ns)
        kind, variant, size = header & 0xF0, header & 0x0F, len(payload)
        if kind in MODES and variant <= 2 and size == 12:
            mode, per_count = MODES[kind]
            self.motors.command(mode, np.frombuffer(payload, "<i2") * per_count, t_ns)
            return self._reply(header, t_ns)
        if kind == READ_ONLY and variant <= 2 and size == 0:
            return self._reply(header, t_ns)
        if header == GRIP and size == 2:
            closed = np.where(HIGHEST > 0, 0.6 * HIGHEST, -60.0)
            self.motors.command("position", closed if payload[0] else REST, t_ns)
            return self._reply(header & 0xF0, t_ns)
        if header in BLUETOOTH and size == 0:
            return []
        if header == RESET and size == 0:
            self.power_on(t_ns)
            return []
        if header == READ_REGISTER and size == 4:
            return self._read_register(*struct.unpack("<i", payload))
        if header == WRITE_REGISTER and size == 8:
            return self._write_register(*struct.unpack("<ii", payload))
        return None

    def _leave_api_control(self, t_ns: int) -> None:
        """Hold where the joints were 300 ms after the last command."""
        if t_ns - self._commanded_ns > API_TIMEOUT_NS:
            self.motors.hold(self._commanded_ns + API_TIMEOUT_NS)
        self._commanded_ns = t_ns

    def _read_register(self, register: int) -> list[bytes]:
        if not 1 <= register <= REGISTERS:
            return []
        return [framed(struct.pack("<ii", register, self.registers[register - 1]))]

    def _write_register(self, register: int, value: int) -> list[bytes]:
        known = 1 <= register <= REGISTERS
        if known:
            self.registers[register - 1] = value
        return [framed(struct.pack("<i", WRITTEN if known else 0))]

    def _reply(self, header: int, t_ns: int) -> list[bytes]:
        """The reply that the header's low nibble asks for."""
        self.motors.advance(t_ns)
        variant = header & 0x0F
        positions = _int16(self.motors.positions * POSITION_COUNTS)
        currents = _int16(self.motors.currents * CURRENT_COUNTS)
        velocities = _int16(self.motors.velocities * VELOCITY_COUNTS)
        pairs = np.stack([positions, velocities if variant == 1 else currents], axis=-1)
        rest = velocities.tobytes() if variant == 2 else pack_12_bits(self.counts[self.layout.wire_order])
        return [framed(bytes([header]) + pairs.tobytes() + rest + b"\x00")]


def touch_counts(force: np.ndarray) -> np.ndarray:
    """The touch values that stand for ``force`` [N] in the documented formula, 0..4095."""
    felt = np.maximum(force - 0.878894, 1e-9)
    volts = 33000.0 / np.maximum(121591.0 / felt - 10000.0, 1e-3)
    counts = np.clip(np.rint(volts * 4096 / 3.3), 0, 4095)
    return np.where(force > 0.878894, counts, 0).astype(np.int64)


def pack_12_bits(values: np.ndarray) -> bytes:
    """Pairs of 12-bit values in three bytes, low byte first."""
    even, odd = values[0::2], values[1::2]
    packed = np.stack([even & 0xFF, even >> 8 | (odd & 0x0F) << 4, odd >> 4], axis=-1)
    return packed.astype(np.uint8).tobytes()


def framed(content: bytes) -> bytes:
    """Checksum, stuffing, flags."""
    content += bytes([-sum(content) & 0xFF])
    stuffed = bytearray([FLAG])
    for byte in content:
        stuffed += bytes([ESCAPE, byte ^ MASK]) if byte in (FLAG, ESCAPE) else bytes([byte])
    return bytes(stuffed) + bytes([FLAG])


def _int16(values: np.ndarray) -> np.ndarray:
    return np.asarray(np.clip(np.rint(values), -0x8000, 0x7FFF), dtype="<i2")


def _is_reply(frame: bytes, size: int, variant: int) -> bool:
    """Whether a stuffed frame holds ``size`` bytes with a good checksum and this variant."""
    content = frame[1:-1].replace(b"\x7d\x5e", b"\x7e").replace(b"\x7d\x5d", b"\x7d")
    return (
        frame[0] == frame[-1] == FLAG
        and len(content) == size
        and not sum(content) & 0xFF
        and (content[0] & 0x0F == variant)
    )
