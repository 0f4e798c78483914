"""HAND, the Hand Articulation Neuro-training Device: a force sensor of three axes under each of five fingertips.

Wire: USB HID with reports of 64 bytes and no numbers, PJRC's "Raw HID". The board sends a ``RAW`` report, or in game
mode a ``GAME`` report, with each conversion; the host sends the letters of a command, and may leave out zeros behind.

    command                       answer   about
    63                                     settings: no more reports
    61                                     reports again; gains that were changed are in force
    74                                     changed gains are in force
    73 66, >f4                             rate, above 0.01 to 1000 Hz
    73 6D, u1                              game mode, if not 0
    73 67, i1 i1 i1, >f4                   gain: finger, channel (-1: each), stage; the value
    67 66                         >f4      rate
    67 6D                         u1       game mode
    67 67, i1 i1 i1               >f4      gain
    67 65                         u1       1: the last setting was refused
    67 64                         report   one conversion
    67 76                         >f4 x 5  how far the gauges of a finger disagree; it has those of two fingers only

While reports are sent, only 63 is obeyed. Stages of gain: 0 front, 1 fine, 2 output, 3 their product. The firmware's
limits are as they are: -1 stands for fingers 0 to 3 and channels 0 to 2, and finger 4 is refused.

Evidence: the firmware and its reader, run.

Try it: ``tactemu serve kata_hand --port usbip:``, then ``example_devices/hand.py`` of toon.
"""

import struct
from typing import Annotated

import numpy as np

from firmware_protocols import (
    USB, Column, Counts, CountsPerNewton, Device, Frame, Hid, Option, Packets, Reading, Refused, Request, Rollover,
    Transmissions, command, fact_table, on_fingers, points, quantize,
)  # fmt: skip

REPORT_BYTES = 64
RAW = Frame("""
    raw report, thumb first
    0     >u4 wrap      time         [ms] since the board is ready
    4     00 x 2        deviation    from the period [us]
    6     >u2 x 20      gauges       four of each finger: 0 to 65535 are 0 to 3.3 V
    46    00 x 18       reserved
""")
GAME = Frame("""
    game report, thumb first
    0     >f4 x 15      forces       x, y, z of each finger
    60    00 x 4        reserved
""")
REPORTS = bytes.fromhex("06ABFF 0A0002 A101 7508 1500 26FF00 9540 0901 8102 9540 0902 9102 C0")
MIDDLE, FULL_SCALE, ROOT = 32768, 65535, np.float32(np.sqrt(2.0))
STAGES, MOST = (32.0, 1.0, 9.0, 288.0), (128.0, 1.0, 9.0, 1152.0)
"""Front, fine and output gain and their product: at first, and at most."""
FRONT_GAINS = {4.1: 4.0, 8.1: 8.0, 16.1: 16.0, 23.37: 23.27, 32.1: 32.0, 42.77: 42.67, 64.1: 64.0}
"""The front gain for a product of front and fine gain up to each limit; above them 128."""
FIRMWARE, READER = "aforren1/hand@d0ba3c2", "aforren1/toon@73c4c8f"


class KataHand(Device):
    """Five sensors of four strain gauges, which stream until they are told to listen."""

    name = "kata_hand"
    title = "HAND, forces of five fingertips, USB HID"
    kind = "fingertip"
    rate_hz, boot_s = 100.0, 6.0
    rollovers = (Rollover(name="time", bits=32, step=1000, clock=True),)
    evidence = ("firmware", "driver")
    sources = (f"{FIRMWARE} src, include", f"{READER} example_devices/hand.py")
    judge = READER
    origin = f"{FIRMWARE} readme.md, src/ui.cpp"
    documented_with = ("serial_number",)
    facts = fact_table(f"""
        stated touch: a finger has gauges a, b, c, d of 16 bits; x = (a - b) / sqrt 2, y = (a + b) / sqrt 2, z = c + d @
            {READER} example_devices/hand.py; {FIRMWARE} src/analog.cpp:46-55
        stated touch: calibration brings a gauge at rest to half of 3.3 V @ {FIRMWARE} src/constants.hpp:46
        assumed touch: 3000 counts/N; a push makes z positive; offsets settle at once; a gauge at rest reads {MIDDLE} @
            {FIRMWARE}, all files
        stated identity: USB ids 16C0:0486, names Kata and HAND, HID usage FFAB:0200 @ {FIRMWARE}
            include/usb_desc.h:530-560
        assumed identity: the model lacks the second interface, on which the board prints text @ {FIRMWARE} src/comm.cpp
        stated configuration: the commands, the gains and their limits @ {FIRMWARE} src/ui.cpp, src/settings.cpp
        stated timing: the board measures 6 s after power-up, at 100 Hz; periods are whole microseconds @ {FIRMWARE}
            src/main.cpp:25-35
        assumed timing: the model calibrates at once, and its period deviates by 0 us @ {FIRMWARE}, all files
    """)

    def __init__(
        self,
        *,
        serial_number: Annotated[str, Option("of the board")] = "1234560",
        counts_per_newton: CountsPerNewton = 3000.0,
    ):
        self.layout = on_fingers(points({"force": (0.0, 0.0, 0.0)}))
        self.ports = (Hid(usb=USB(0x16C0, 0x0486, "Kata", "HAND", serial_number), report_descriptor=REPORTS),)
        self.columns = tuple(
            Column(name=name, low=0, high=FULL_SCALE, rest=MIDDLE, push=1 if name in "cd" else 0) for name in "abcd"
        )
        self.packets = Packets(b"", _size, counters=self.counters)
        self.counts_per_newton, self.hertz = counts_per_newton, self.rate_hz
        self.sends, self.is_game, self.error = True, False, 0
        self.gains = np.tile(STAGES, (5, 4, 1))
        self.product = self.gains[:, :, 3].copy()

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return the gauges a, b, c, d of each finger."""
        x, y, z = self.layout.to_taxel_frame(reading["force"]).T
        gauges = np.stack([(x + y) / ROOT, (y - x) / ROOT, -z / 2, -z / 2], axis=-1)
        self.counts = quantize(gauges * self.product / STAGES[3], self.counts_per_newton, 0, FULL_SCALE, MIDDLE)
        return self.counts

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return a report, unless it listens."""
        return [self._report(t_ns // 1_000_000 - round(self.boot_s * 1000))] if self.sends else ()

    def _report(self, time: int) -> bytes:
        gauges = self.layout.on_wire(self.counts)
        if not self.is_game:
            return RAW.pack(time=time, gauges=gauges.ravel())
        a, b, c, d = (gauges.astype(np.float32) / np.float32(FULL_SCALE)).T
        return GAME.pack(forces=np.stack([(a - b) / ROOT, (a + b) / ROOT, c + d], axis=-1).ravel())

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Obey one report, which may be shorter than it is declared."""
        if self.sends and data[:1] != b"c":
            self.counters["ignored"] += 1
            return ()
        return super().receive(data[:REPORT_BYTES].ljust(REPORT_BYTES, b"\0"), t_ns, port)

    def reply(self, request: Request, content: bytes) -> Transmissions:
        """Return the content in a report."""
        return [content.ljust(REPORT_BYTES, b"\0")] if content else ()

    @command("63", pattern=rb"c.{63}")
    def _settings(self, request: Request) -> None:
        self.sends = False

    @command("61", after=("63",), pattern=rb"a.{63}")
    def _acquire(self, request: Request) -> None:
        self._calibrate(request)
        self.sends = True

    @command("74", after=("63",), pattern=rb"t.{63}")
    def _calibrate(self, request: Request) -> None:
        self.product = self.gains[:, :, 3].copy()

    @command("73 66 447A0000", after=("63",), pattern=rb"sf(.{4}).{58}")
    def _set_rate(self, request: Request) -> None:
        (hertz,) = struct.unpack(">f", request.value)
        if self._judge(0.01 < hertz <= 1000):
            self.hertz = hertz
            self.period_ns = int(np.float32(1 / np.float32(hertz)) * np.float32(1e6)) * 1000

    @command("73 6D 01", after=("63",), pattern=rb"sm(.).{61}")
    def _set_game(self, request: Request) -> None:
        self.is_game = self._judge(True) and request.value != b"\0"

    @command("73 67 FF FF 03 42400000", after=("63",), pattern=rb"sg(.{3})(.{4}).{55}")
    def _set_gain(self, request: Request) -> None:
        finger, channel, stage = struct.unpack("3b", request.values[0])
        (value,) = struct.unpack(">f", request.values[1])
        if not self._judge(-1 <= finger <= 3 and -1 <= channel <= 3 and 0 <= stage <= 3 and 0 <= value <= MOST[stage]):
            return
        for i in range(4) if finger < 0 else (finger,):
            for j in range(3) if channel < 0 else (channel,):
                self.gains[i, j, stage] = value
                self._follow(self.gains[i, j], stage)

    def _follow(self, gain: np.ndarray, stage: int) -> None:
        """Set the product of a gauge's gains, or its front and fine gain by the product."""
        if stage < 3:
            gain[3] = gain[:3].prod()
            return
        base = gain[3] / gain[2] if gain[2] else 0.0
        gain[0] = next((front for limit, front in FRONT_GAINS.items() if base <= limit), 128.0)
        gain[1] = np.clip(base / gain[0], 0, 1)

    def _judge(self, is_valid: bool) -> bool:
        """Keep whether the last setting was refused."""
        self.error = int(not is_valid)
        self.counters["refused"] += self.error
        return is_valid

    @command("67 66", "42C80000 ..{60}", after=("63",), pattern=rb"gf.{62}")
    def _get_rate(self, request: Request) -> bytes:
        return struct.pack(">f", self.hertz)

    @command("67 6D", "00 ..{63}", after=("63",), pattern=rb"gm.{62}")
    def _get_game(self, request: Request) -> bytes:
        return bytes([self.is_game])

    @command("67 67 00 01 02", "41100000 ..{60}", after=("63",), pattern=rb"gg(.{3}).{59}")
    def _get_gain(self, request: Request) -> bytes:
        finger, channel, stage = request.value
        if finger > 4 or channel > 3 or stage > 3:
            raise Refused("value")
        return struct.pack(">f", self.gains[finger, channel, stage])

    @command("67 65", "00 ..{63}", after=("63",), pattern=rb"ge.{62}")
    def _get_error(self, request: Request) -> bytes:
        return bytes([self.error])

    @command("67 64", "00000000 0000 ..{58}", after=("63",), pattern=rb"gd.{62}")
    def _get_data(self, request: Request) -> bytes:
        return self._report(0)

    @command("67 76", "..{64}", after=("63",), pattern=rb"gv.{62}")
    def _get_disagreement(self, request: Request) -> bytes:
        a, b, c, d = self.counts[:2].T / FULL_SCALE
        first, second = np.abs(a - b + c - d)
        return struct.pack(">5f", first, 0, 0, second, 0)


def _size(data: bytes) -> int:
    return REPORT_BYTES
