r"""Inspire RH56DFTP: a hand with 1062 tactile points in seventeen matrices, over Modbus RTU or Modbus TCP.

Wire: RS-485, 115200 8N1, Modbus RTU; or Modbus TCP on port 6000. Unit 1, functions 03, 06, 16.

Addresses count *bytes*, not registers: reading n registers at A gives bytes A .. A + 2 n - 1, and the register at A is
byte A (low) and byte A + 1 (high). So two neighbouring matrices of 16-bit values are read by advancing 2 addresses per
register. One driver asks for one register per address and gets, after the matrix, what lies behind it.

    address  content, int16 0..4096, row by row
    3000     little finger: tip 3x3 (+0, 18 bytes), top 12x8 (+18, 192), pad 10x8 (+210, 160)
    3370     ring finger, the same
    3740     middle finger, the same
    4110     index finger, the same
    4480     thumb: tip 3x3, top 12x8 (4498), middle 3x3 (4690), pad 12x8 (4708)
    4900     palm 14x8, until 5123

    address  bytes  content (w: can be written)          address  bytes  content
    1000     1   w  unit (from the next power-up)        1534     12     position, 0..2000
    1002     1   w  line speed (from the next power-up)  1546     12     angle, 0..1000
    1004     1   w  1 clears errors                      1582     12     force [g], -4000..4000
    1005     1   w  1 saves to flash                     1594     12     current [mA], 0..2000
    1006     1   w  1 restores the factory settings      1606     6      error bits
    1009     1   w  1 zeroes the forces                  1612     6      status
    1032     12  w  speed at power-up, 0..1000           1618     6      temperature [deg C]
    1044     12  w  force limit at power-up, 0..1000
    1464     10  w  stored only
    1474     12  w  position to go to, 0..2000, -1: stay
    1486     12  w  angle to go to, 0..1000, -1: stay
    1498     12  w  force limit, 0..3000
    1522     12  w  speed, 0..1000

Six values are little, ring, middle, index, thumb bend, thumb turn. All other addresses below 6000 read zero (drivers
ask for register 0 to see whether the hand is there).

Try it: ``tactemu run inspire_rh56dftp --port tcp:127.0.0.1:6000``, then ``RH56DFTP_TCP(host, 6000).get(...)``.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence

import numpy as np

from firmware_protocols.device import (
    Command,
    Device,
    Layout,
    Outgoing,
    Reading,
    SerialWire,
    TcpWire,
    Wire,
    grid_layout,
)
from firmware_protocols.devices.inspire_registers import MEMORY_END, HandRegisters
from firmware_protocols.layouts import place, stack
from firmware_protocols.modbus import ILLEGAL_ADDRESS, ModbusServer, Refused

TACTILE = 3000
FULL_SCALE = 4096
FINE, COARSE = 0.0015, 0.004
FINGER = (("tip", 3, 3, 0.033), ("top", 12, 8, 0.021), ("pad", 10, 8, 0.0))
THUMB = (("tip", 3, 3, 0.048), ("top", 12, 8, 0.036), ("middle", 3, 3, 0.023), ("pad", 12, 8, 0.01))
"""Matrices along a finger: name, rows, columns, height of the centre above the finger's base [m]."""
FINGERS = {"little": (-0.033, 0.065), "ring": (-0.011, 0.075), "middle": (0.011, 0.08), "index": (0.033, 0.075)}
THUMB_BASE = (0.06, -0.01)


class InspireRh56dftp(Device):
    """The hand: tactile matrices, and actuators that follow their commands.

    Args:
        counts_per_newton: tactile counts per newton along a point's normal.
    """

    name = "inspire_rh56dftp"
    title = "Inspire RH56DFTP hand, tactile version"
    wires = (SerialWire(baud=115200), TcpWire(port=6000))
    senses = "force"
    rate_hz = 50.0
    evidence = ("driver",)
    sources = (
        "NaCl-1374/inspire_hand_ws@fc75490 inspire_hand_defaut.py (tactile map)",
        "plusml-rh56dftp 0.1.7 Register/config/configFTP/ftp_registers.py (both maps)",
        "Modbus application protocol V1.1b3; Modbus over serial line V1.02",
    )
    judge = "plusml-rh56dftp 0.1.7 (TCP), pymodbus 3.11 and modbus_tk 1.1.5 (RTU)"
    assumed = (
        "places of the points: all matrices in one plane, normal +z, 1.5 mm pitch on the fingers, 4 mm on the palm",
        "1000 counts/N, converted 50 times a second",
        "registers 1486..1533, 1534..1557 and 1612: as commonly listed for RH56 hands, in no source read here",
        "a full stroke takes 0.8 s at speed 1000; force limits are stored without effect; 200 mA while moving",
        "force of a finger: the sum over its matrices; status 2 there, 1 closing, 0 opening; errors never",
        "writes outside the table: exception 2; values out of range: exception 3; nothing answers above 5999",
        "the line speed register is stored without effect",
    )

    def __init__(self, *, counts_per_newton: float = 1000.0):
        super().__init__()
        self.counts_per_newton = counts_per_newton
        self.layout = _hand()
        self.registers = HandRegisters()
        self._server = ModbusServer(read=self._read, write=self._write, counters=self.counters)
        self._now_ns = 0
        self.power_on(0)

    def plug(self, kind: str) -> Wire:
        """RTU on ``serial``, Modbus TCP on ``tcp``."""
        wire = super().plug(kind)
        self._server.framing = "tcp" if kind == "tcp" else "rtu"
        self._server.reset()
        return wire

    def power_on(self, t_ns: int) -> Sequence[Outgoing]:
        """Saved parameters, hand open."""
        self.registers.power_on(t_ns)
        self._server.unit = self.registers.unit
        self._server.reset()
        self.counts = np.zeros(len(self.layout), np.int64)
        return ()

    def opened(self, t_ns: int) -> Sequence[Outgoing]:
        """A new connection starts with a new request."""
        self._server.reset()
        return ()

    # -- readings --------------------------------------------------------------------------------------------------

    def digitize(self, reading: Reading) -> np.ndarray:
        """Tactile counts 0..4096, shape ``(1062,)``, matrix by matrix, row by row."""
        counts = np.rint(self.counts_per_newton * self.layout.push(reading.values))
        return np.clip(counts, 0, FULL_SCALE).astype(np.int64)

    def sample(self, reading: Reading, t_ns: int) -> Sequence[Outgoing]:
        """Convert; nothing leaves unasked."""
        push = self.layout.push(reading.values)
        by_finger: dict[str, float] = {}
        for patch in self.layout.patches:
            finger = patch.name.split()[0]
            by_finger[finger] = by_finger.get(finger, 0.0) + push[patch.taxels].sum()
        felt = [by_finger[finger] for finger in (*FINGERS, "thumb")]
        self.registers.feel(forces=(*felt, 0.0), temperature=float(np.mean(reading.temperature)))
        return super().sample(reading, t_ns)

    # -- commands --------------------------------------------------------------------------------------------------

    @property
    def commands(self) -> tuple[Command, ...]:
        """Reading each matrix, the registers that drivers touch, and the three exceptions."""

        def registers(count: int) -> Callable[[list], bool]:
            return lambda frames: len(frames) == 1 and frames[0][self._payload + 1] == 2 * count

        def read(name: str, address: int, count: int) -> Command:
            return Command(name=name, request=self._framed(3, address, count), reply=registers(count))

        def echoed(name: str, *fields: int) -> Command:
            return Command(name=name, request=self._framed(*fields), reply=[self._framed(*fields)])

        def refused(name: str, function: int, code: int, *fields: int) -> Command:
            answer = self._server.request(bytes([function | 0x80, code]))
            return Command(name=name, request=self._framed(function, *fields), reply=[answer])

        angles = struct.pack(">BHHB6H", 16, 1486, 6, 12, 1000, 800, 600, 400, 200, 0)
        return (
            *(read(f"touch, {p.name}", address, size // 2) for p, address, size in self.matrices()),
            read("unit", 1000, 1),
            read("presence", 0, 1),
            read("forces", 1582, 6),
            read("angles", 1546, 6),
            echoed("clear errors", 6, 1004, 1),
            echoed("zero the forces", 6, 1009, 1),
            echoed("save", 6, 1005, 1),
            echoed("bend the little finger", 6, 1486, 500),
            Command(
                name="six angles",
                request=self._server.request(angles),
                reply=[self._framed(16, 1486, 6)],
            ),
            refused("read coils: illegal function", 1, 1, 0, 8),
            refused("read beyond the map: illegal address", 3, 2, 5999, 1),
            refused("write a reading: illegal address", 6, 2, 3000, 1),
            refused("read too much: illegal value", 3, 3, 3000, 126),
            refused("angle out of range: illegal value", 6, 3, 1486, 1001),
        )

    @property
    def _payload(self) -> int:
        """Offset of the function code in a frame."""
        return 7 if self.wire.kind == "tcp" else 1

    def _framed(self, function: int, *fields: int) -> bytes:
        return self._server.request(struct.pack(f">B{len(fields)}H", function, *fields))

    def matrices(self):
        """Patch, address and size [bytes] of every matrix."""
        for patch in self.layout.patches:
            yield patch, TACTILE + 2 * patch.start, 2 * patch.rows * patch.cols

    def receive(self, data: bytes, t_ns: int) -> Sequence[Outgoing]:
        """Modbus requests in chunks of any size."""
        self._now_ns = t_ns
        return self._server.receive(data, t_ns)

    def _read(self, address: int, count: int) -> list[int]:
        if address + 2 * count > MEMORY_END:
            raise Refused(ILLEGAL_ADDRESS)
        memory = self.registers.snapshot(self._now_ns)
        touch = self.counts[self.layout.wire_order].astype("<i2").tobytes()
        memory[TACTILE : TACTILE + len(touch)] = touch
        return list(struct.unpack_from(f"<{count}H", memory, address))

    def _write(self, address: int, registers: list[int]) -> None:
        self.registers.write(address, struct.pack(f"<{len(registers)}H", *registers), self._now_ns)


def _hand() -> Layout:
    """All matrices in wire order; x across the hand, y along the fingers, z out of the palm."""
    pads = []
    for finger, base in (*FINGERS.items(), ("thumb", THUMB_BASE)):
        for name, rows, cols, height in THUMB if finger == "thumb" else FINGER:
            pad = grid_layout(rows, cols, FINE, name=f"{finger} {name}")
            pads.append(place(pad, (base[0], base[1] + height, 0.0)))
    pads.append(grid_layout(14, 8, COARSE, name="palm"))
    return stack(*pads)
