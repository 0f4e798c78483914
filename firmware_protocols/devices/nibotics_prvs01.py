r"""Nibotics NI-PRVS01: a hand with seven motors; pressure and temperature at nineteen places, sound and motion.

Wire: USB-CDC, opened at 115200. The hand sends, unasked, two messages after each conversion; the host sends orders,
which get no answer. A message with a bad check is dropped.

    1    hand    14 microphones of 12 bits, in 12 and 9 bytes
    2    hand    pressures [hPa] and temperatures by channel, seven positions of 12 bits in 11 bytes, speeds, motion
    3    host    seven positions 0..4095, then seven speeds 0..250: little, ring, middle, index, three axes of the thumb

Channels: little 0..2, ring 4..6, middle 8..10, index 12..14, thumb 16..18, palm 20..23, row by row, a finger's first at
its top; 3, 7, 11, 15 and 19 are not in use. An older firmware has 19 channels, the same without the palm; a host
distinguishes them by the length. The only known driver does not show the palm.

Try it: ``tactemu run nibotics_prvs01``, then ``NI_PRVS01(port)`` of ``nibotics``.
"""

from collections.abc import Mapping
from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    MORE, NO_PACKET, Column, Counts, Device, Frame, Motors, Option, Packets, Reading, Request, Sense, Serial,
    Transmissions, command, fact_table, grid_layout, on_fingers, pack_12_bits, points, quantize, stack,
)  # fmt: skip
from firmware_protocols.sums import crc8

MESSAGE = Frame("""
    message, either direction
    0     AA 01          head
    2     <u2            length = len(data)
    4     crc8 from 2    length_check    of the length
    5     <u2            kind
    7     bytes          data
    last  crc8 from 2    check           from 5 gives the same: up to there it is 0
""")
GENERAL = Frame("""
    general, the data of message 2; by channel
    0     <f4 x channels    pressures       [hPa]
    ..    <f4 x channels    temperatures    [deg C]
    ..    bytes x 11        positions       12 bits each, low bits first
    ..    u1 x 7            speeds
    ..    <i2 x 2 x 3       motion          acceleration and rotation: x, y, z
""")
MICROPHONES_KIND = 1
GENERAL_KIND = 2
ACTUATORS = ("pinky", "ring", "middle", "index", "thumb_radial_extension", "thumb_flexion", "thumb_grasp")
PALM_CHANNELS = range(20, 24)
MICROPHONE_COUNTS = np.full(14, 2048)
COUNTS_PER_S_PER_SPEED = 41.0
MAX_SPEED = 250
COUNTS_PER_MS2 = 4096 / 9.80665
COUNTS_PER_DEG_S = 32.8


_PACKAGE = "nibotics-hand 0.1.0"
_READ = "nibotics-hand 0.1.0 (all of it: definitions.py, hand.py, protocol.py, sensor_data.py, METADATA)"


class NiboticsPrvs01(Device):
    """A hand that streams touch, sound and motion, and obeys orders."""

    name = "nibotics_prvs01"
    kind = "hand"
    title = "Nibotics NI-PRVS01 hand"
    ports = (Serial(baud=115200, usb=True),)
    rate_hz = 100.0
    evidence = ("driver",)
    sources = ("nibotics-hand 0.1.0 protocol.py, definitions.py, hand.py, README (METADATA)",)
    judge = "nibotics-hand 0.1.0"
    facts = fact_table(f"""
        stated touch: pressures are in hPa, temperatures in deg C @ {_PACKAGE} README (METADATA), Sensor Data
        stated touch: the channels of each finger and of the palm; versions with 19 and 24 of them @ {_PACKAGE}
            definitions.py:42, protocol.py:8
        assumed touch: a channel reads 0 at rest (two channels are called icp1, icp2; a barometer would read 1013);
            unused channels read 0; a channel measures the pressure on a square as wide as its pitch @ {_READ}
        assumed touch: places: three in a row, 15 mm apart, on each finger; 2 x 2, 25 mm apart, on the palm; all in one
            plane with normal +z @ {_READ}
        stated configuration: a command has speeds 0..250, then positions 0..4095 @ {_PACKAGE} hand.py:52, README
        assumed configuration: 4096 counts per g and 32.8 counts per deg/s, in the axes of the palm; microphones read
            2048 @ {_READ}
        assumed configuration: a command holds until the next one; speeds above 250 count as 250; the hand is open after
            power-up @ {_READ}
        assumed timing: both messages are sent 100 times a second; speed n is 41 n counts/s; while a motor moves its
            speed reads as commanded, else 0 @ {_READ}
    """)

    def __init__(
        self,
        *,
        channels: Annotated[Literal[24, 19], Option("channels of the firmware; 19 is older and has no palm")] = 24,
        counts_per_pascal: Annotated[float, Option("scale of pressure on the wire", unit="1/Pa")] = 0.01,
    ):
        self.counts_per_pascal = counts_per_pascal
        fingers = on_fingers(grid_layout(3, 1, 0.015), "little", "ring", "middle", "index", "thumb")
        palm = [grid_layout(2, 2, 0.025, name="palm", link="palm")] if channels == 24 else []
        self.layout = stack(fingers, *palm)
        self.channels = np.array([4 * k + j for k in range(5) for j in range(3)] + [*PALM_CHANNELS] * bool(palm))
        board = points({"board": (0.0, 0.0, -0.01)}, link="palm" if palm else "")
        self.senses = (
            "pressure", "temperature", Sense("acceleration", at=board), Sense("angular_velocity", at=board),
        )  # fmt: skip
        self.columns = (Column(name="pressure", unit="Pa", counts_per_unit=counts_per_pascal, low=0, high=1e9, push=1),)
        self.general = GENERAL.bind(channels=channels)
        self.packets = Packets(MESSAGE, _size, by="kind", counters=self.counters)
        self.pressures, self.temperatures = np.zeros(channels, np.float32), np.zeros(channels, np.float32)
        self.motion = np.zeros((2, 3), np.int64)
        self.motors = Motors(
            np.zeros(7), low=0, high=4095, time_constant_s=0.0, speed_limit=MAX_SPEED * COUNTS_PER_S_PER_SPEED
        )
        self.speeds = np.full(7, 100)

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return pressures as sent, float32, shape ``(19,)``, or ``(15,)`` without a palm."""
        sent = np.clip(reading["pressure"] * self.counts_per_pascal, 0.0, 1e9).astype(np.float32)
        self.pressures[self.channels] = self.layout.on_wire(sent)
        self.temperatures[self.channels] = self.layout.on_wire(reading["temperature"])
        turn = np.rad2deg(reading["angular_velocity"]) * COUNTS_PER_DEG_S
        motion = np.concatenate([reading["acceleration"] * COUNTS_PER_MS2, turn])
        self.motion = quantize(motion, 1.0, -0x8000, 0x7FFF)
        return sent

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return the two messages of one conversion."""
        positions = np.rint(self.motors.positions(t_ns)).astype(np.int64)
        data = self.general.pack(
            pressures=self.pressures,
            temperatures=self.temperatures,
            positions=pack_12_bits(positions),
            speeds=np.where(self.motors.moving(t_ns), self.speeds, 0),
            motion=self.motion,
        )
        sound = pack_12_bits(MICROPHONE_COUNTS[:8]) + pack_12_bits(MICROPHONE_COUNTS[8:])
        return [MESSAGE.pack(kind=GENERAL_KIND, data=data), MESSAGE.pack(kind=MICROPHONES_KIND, data=sound)]

    @command(
        "AA 01 15 00 16 03 00 00 00 00 00 00 00 D2 04 00 00 00 00 00 00 64 64 64 4D 64 64 64 15",
        name="index to 1234 at 77",
        data="<7H7B",
        origin="frame of nibotics-hand 0.1.0",
    )
    def order(self, request: Request):
        """Go to seven positions, at seven speeds."""
        positions, self.speeds = np.array(request.values[:7]), np.minimum(request.values[7:], MAX_SPEED)
        self.motors.limit_speed(self.speeds * COUNTS_PER_S_PER_SPEED, request.t_ns)
        self.motors.go(positions, request.t_ns)
        return ()

    def joints(self, t_ns: int) -> Mapping[str, float]:
        """Return how far each motor is closed [rad], of a quarter turn, by name."""
        return dict(zip(ACTUATORS, (self.motors.positions(t_ns) / 4095 * np.pi / 2).tolist()))


def _size(data: bytes) -> int | str:
    if len(data) < 5:
        return MORE
    return 8 + int.from_bytes(data[2:4], "little") if crc8(data[2:4]) == data[4] else NO_PACKET
