"""RDT, the protocol that ATI Net F/T and OnRobot HEX share: records over UDP, readings and calibration over TCP.

The datasheet of both is :mod:`firmware_protocols.devices.ati_net_ft`.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from firmware_protocols import (
    Counts, Device, Frame, LowPass, Packets, Reading, Rollover, Sense, Tcp, Transmissions, Udp, points, quantize, xyz,
)  # fmt: skip

REQUEST = Frame("""
    request
    0     12 34           head
    2     >u2             command
    4     >u4             argument
""")
RECORD = Frame("""
    record
    0     >u4 wrap        sequence   of records since the start, from 1
    4     >u4 wrap        sample     of the converter, also of those that are not sent
    8     >u4             status     0: no fault
    12    >i4 x 6         counts     Fx Fy Fz Tx Ty Tz
""")
READING = Frame("""
    answer to 00 over TCP
    0     12 34           head
    2     >u2             status     ATI: bits 31..16
    4     >i2 x 6 clip    counts     Fx Fy Fz Tx Ty Tz over their scale
""")
CALIBRATION = Frame("""
    answer to 01 over TCP
    0     12 34           head
    2     02              unit       of force, N
    3     03              unit       of torque, Nm
    4     >u4             force      counts per N
    8     >u4             torque     counts per Nm
    12    >u2 x 6         scale      of the counts in an answer to 00
""")
STOP, START = 0x00, 0x02
READ, CALIBRATE = 0, 1
TCP_REQUEST_BYTES = 20
INT32: dict[str, Any] = {"low": -(2**31), "high": 2**31 - 1}
UNTIL_STOPPED = -1
"""The number of records left while a stream has no end."""


class Rdt(Device):
    """The part that both share: start, stop and records; the answers over TCP."""

    kind = "force-torque sensor"
    ports = (Udp(name="rdt", port=49152), Tcp(name="tcp", port=49151, is_plugged=False))
    rollovers = (Rollover(name="sequence", bits=32, state="sequence"),)
    sample_hz: int

    def _power_up(
        self, tool: Sequence[float], per_newton: int, per_newton_metre: int, tcp_scale: Sequence[int], status: int
    ) -> None:
        self.layout = points({"tool": tool})
        self.senses = (Sense("wrench", at=points({"origin": (0.0, 0.0, 0.0)})),)
        self.scale, self.status = np.array([per_newton] * 3 + [per_newton_metre] * 3), status
        self.columns = (
            *xyz("Fx Fy Fz", unit="N", counts_per_unit=per_newton, push=-1, **INT32),
            *xyz("Tx Ty Tz", unit="Nm", counts_per_unit=per_newton_metre, **INT32),
        )
        self.calibration = CALIBRATION.pack(force=per_newton, torque=per_newton_metre, scale=tcp_scale)
        self.tcp_scale = np.array(tcp_scale)
        self.packets = Packets(b"", _tcp_size, counters=self.counters)
        self.low_pass = LowPass()
        self.felt = self.bias = np.zeros((1, 6))
        self.counts = np.zeros((1, 6), np.int64)
        self.left = self.sequence = self.samples_before = 0

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return counts of Fx, Fy, Fz, Tx, Ty, Tz on the tool, less the bias, int32 range, shape ``(1, 6)``."""
        self.felt = self.low_pass(reading["wrench"], t_ns)
        self.counts = self.quantized(self.felt - self.bias)
        return self.counts

    def quantized(self, wrench: np.ndarray) -> np.ndarray:
        """Return the counts of a wrench."""
        return quantize(wrench, self.scale, *INT32.values())

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return one record, between start and stop."""
        if not self.left:
            return ()
        self.left -= self.left > 0
        self.sequence = (self.sequence + 1) & 0xFFFF_FFFF
        return self._sent(
            RECORD.pack(sequence=self.sequence, sample=self._sample(t_ns), status=self._status(), counts=self.counts[0])
        )

    def _sent(self, record: bytes) -> list[bytes]:
        return [record]

    def _sample(self, t_ns: int) -> int:
        return t_ns * self.sample_hz // 1_000_000_000 + self.samples_before

    def _status(self) -> int:
        return self.status

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Obey one datagram, or answer requests over TCP, which arrive in chunks of any size."""
        if port == "tcp":
            return [answer for packet in self.packets.cut(data, t_ns) for answer in self._answer(packet)]
        request = REQUEST.unpack(data)
        if request is None:
            self.counters["bad_request"] += 1
        elif not self._obey(**request):
            self.counters["unknown_command"] += 1
        return ()

    def _obey(self, command: int, argument: int) -> bool:
        """Execute a command; return False if it is unknown."""
        if command == START:
            self.left, self.sequence = argument or UNTIL_STOPPED, 0
        elif command == STOP:
            self.left = 0
        return command in (START, STOP)

    def _answer(self, request: bytes) -> list[bytes]:
        if request[0] == CALIBRATE:
            return [self.calibration]
        if request[0] == READ:
            counts = np.rint(self.counts[0] / self.tcp_scale).astype(np.int64)
            return [READING.pack(status=self._tcp_status(), counts=counts)]
        self.counters["unknown_command"] += 1
        return []

    def _tcp_status(self) -> int:
        return self._status() & 0xFFFF

    def lines(self, dtr: bool, rts: bool, t_ns: int, port: str) -> Transmissions:
        """Drop the incomplete request of a client that comes or goes."""
        if port == "tcp":
            self.packets.reset()
        return ()


def _tcp_size(data: bytes) -> int:
    return TCP_REQUEST_BYTES
