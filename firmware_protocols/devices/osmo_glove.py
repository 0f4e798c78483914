r"""OSMO glove: three-axis magnetometers under magnetic skins, on the fingers of a glove.

Wire: USB-CDC, opened at 9600. Device to host only: there is no command. 50 times a second (the build with an operating
system) each board of a finger sends three messages, one for each of its two magnetometers and one for its motion chip:
protobuf (``bowie.Data``), stuffed by COBS and ended by 00.

    field  type     content
    1      varint   index: the number of orientations that the board has sent so far
    2      varint   finger, 1 pinky to 5 thumb
    3      varint   link, 1 to 4
    4      varint   sensor: 1 to 20 finger by finger, link by link; 20 more for the second magnetometer
    5      message  Mag: 1 seconds, 2 nanoseconds (varints), 3 x, 4 y, 5 z (float32, integer counts)
    6      message  Quat: 1 seconds, 2 nanoseconds, 3 x, 4 y, 5 z, 6 w, 7 accuracy (float32)

As in protobuf, zeros are left out. Each board's clock runs from its own power-up in steps of 15.625 us; boards start
one after the other, 4.5 s each. A glove with link 1 only has sensors 1, 5, 9, 13, 17 and 21, 25, 29, 33, 37.

The vendor's reader drops and counts a block that is not COBS. Its ROS nodes skip messages below 37 bytes, such as those
of the magnetometers in the first minutes, and a field with one axis at exactly 0.

Try it: ``tactemu run osmo_glove``, then the reader of osmo_tactile_glove's labs/glove2robot/utils/bowie.py.
"""

import struct
from typing import Annotated, Literal

from firmware_protocols import (
    USB, Counts, Device, FieldGains, LinearMagnet, Option, Reading, Rollover, Serial, Transmissions, cobs, fact_table,
    points, quantize, xyz,
)  # fmt: skip

SOURCE = "jessicayin/osmo_tactile_glove@e0465b6"
GUIDE = "jessicayin/osmo_tactile_glove@284b722 hardware_guides"
FINGERTIPS_M = {
    "pinky": (-0.034, 0.075, 0.0), "ring": (-0.012, 0.092, 0.0), "middle": (0.010, 0.100, 0.0),
    "index": (0.032, 0.090, 0.0), "thumb": (0.060, 0.040, 0.0),
}  # fmt: skip
LINKS_PER_FINGER = 4
SECOND_SENSOR_OFFSET = 20
LINK_SPACING_M = 0.02
"""The distance from link to link of a finger."""
SECOND_CHIP_SPACING_M = 0.006
"""The distance from the first magnetometer of a board to the second."""
COUNTS_PER_UT = 32768 / 5000
RANGE_COUNTS = round(2000 * COUNTS_PER_UT)
REST_FIELD_UT = (-38.0, 21.0, 412.0)
TICK_NS = 15_625
BOARD_START_NS = 4_500_000_000
"""The time that the glove takes to start one board."""
VARINT_TYPE = 0
MESSAGE_TYPE = 2
FLOAT_TYPE = 5
"""The wire type of a float in protobuf, as those above of a varint and of a message."""


class OsmoGlove(Device):
    """A glove of boards on the links of five fingers, with two magnetometers and a motion chip each."""

    name = "osmo_glove"
    kind = "glove"
    ports = (Serial(baud=9600, usb=USB(0x2833, 0xB015, "Meta AI", "BowieGlove", "123456789")),)
    rate_hz = 50.0
    columns = xyz("x y z", unit="uT", counts_per_unit=COUNTS_PER_UT, low=-RANGE_COUNTS, high=RANGE_COUNTS)
    rollovers = (Rollover(name="index", bits=32, state="index"),)
    evidence = ("firmware", "driver")
    sources = (
        f"{SOURCE} firmware/BowieGlove_rtos: glove.c, bhi360.c, usb_descriptors.c; README",
        f"{SOURCE} firmware/BowieGlove: bowie.proto; glove.c l.61-85 (twenty boards)",
        f"{SOURCE} labs/glove2robot/utils/bowie.py; hardware/ros2 bowie_node.py, "
        "bowie_node_synced.py (sensors of link 1 alone)",
    )
    judge = SOURCE
    facts = fact_table(f"""
        stated identity: USB 2833:B015, Meta AI, BowieGlove, 123456789 @ {SOURCE} RTOS usb_descriptors.c l.33-104
        measured identity: a real glove is listed with these ids, as ttyACM0 @ {GUIDE} flash_firmware.md, step 6
        stated identity: twenty boards, with the numbers of finger, link and sensor @ {SOURCE} RTOS glove.c l.59-81
        stated identity: the second magnetometer's number is 20 higher @ {SOURCE} RTOS bhi360.c l.198
        stated identity: a glove that has only link 1 of each finger, with two magnetometers each @ {SOURCE}
            bowie_node_synced.py l.61-75
        stated touch: x, y, z are counts of 5000 / 32768 uT @ {SOURCE} RTOS glove.c l.446-448 (in a comment)
        stated touch: orientations are in steps of 1 / 16384 @ {SOURCE} RTOS glove.c l.414-418
        stated timing: 50 Hz @ {SOURCE} firmware/README.md l.5 (glove.c asks the chips for 100)
        stated timing: the index counts orientations; the clocks count steps of 15.625 us @ {SOURCE} RTOS bhi360.c
            l.132-168
        stated timing: the firmware build without an operating system requests 25 Hz @ {SOURCE} BowieGlove glove.c l.299
        stated timing: a board needs 4.5 s to start @ {SOURCE} RTOS glove.c l.83
        assumed touch: the places on a flat hand; link 1 is at the fingertip @ {SOURCE} glove.c, bowie_data.py
        assumed touch: 60 uT/N in the plane, 90 uT/N along the normal, a push raises z; field at rest @ glove.c, README
        assumed touch: the chips' range: +-2000 uT @ glove.c, bhi360.c, common.c (the chip's firmware is binary)
        assumed touch: the boards do not move: one orientation, with accuracy 3 @ bhi360.c, bowie_data.py l.947: 1 to 4
        assumed timing: magnetometers, then the orientation, all of one instant @ bhi360.c (the chip's FIFO decides)
        assumed configuration: the glove has been on for 10 minutes @ glove.c, README (its nodes drop what is younger)
    """)

    def __init__(
        self,
        *,
        sensors: Annotated[
            Literal["fingertips", "all"], Option("link 1 of each finger, or all four links, as in the firmware")
        ] = "fingertips",
        gains: FieldGains = (60.0, 60.0, -90.0),
        orientation: Annotated[
            tuple[float, float, float, float], Option("quaternion x, y, z, w of every board", low=-1, high=1)
        ] = (0.02, -0.05, 0.1, 0.99),
        uptime_s: Annotated[
            float, Option("time since the glove was switched on, at the start", unit="s", low=90.0, high=1e6)
        ] = 600.01,
    ):
        links = LINKS_PER_FINGER if sensors == "all" else 1
        self.title = f"OSMO tactile glove, {10 * links} magnetometers"
        self.boards = [(finger, link) for finger in range(len(FINGERTIPS_M)) for link in range(links)]
        self.layout = points({
            f"{name} {link + 1}{'ab'[chip]}": (x, y - LINK_SPACING_M * link - SECOND_CHIP_SPACING_M * chip, z)
            for name, (x, y, z) in FINGERTIPS_M.items() for link in range(links) for chip in range(2)
        })  # fmt: skip
        self.magnet = LinearMagnet(gain=gains, offset=REST_FIELD_UT)
        self.orientation = [round(16384 * part) / 16384 for part in orientation]
        self.uptime_ns = round(uptime_s * 1e9)
        self.index = round(uptime_s * self.rate_hz)

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return the field at each magnetometer in counts of 5000 / 32768 uT, shape ``(n, 3)``."""
        field = self.magnet(self.layout.to_taxel_frame(reading["force"]))
        self.counts, self.felt_ns = quantize(field, COUNTS_PER_UT, -RANGE_COUNTS, RANGE_COUNTS), t_ns
        return self.counts

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return three messages for each board."""
        fields, messages = self.layout.on_wire(self.counts).astype(float).tolist(), []
        index = self.index - (self.index >> 31 << 32)
        for k, (finger, link) in enumerate(self.boards):
            since_ns = (self.felt_ns + self.uptime_ns - BOARD_START_NS * k) // TICK_NS * TICK_NS
            time, sensor = divmod(since_ns, 1_000_000_000), LINKS_PER_FINGER * finger + link + 1
            first, second = (_message(*time, *field) for field in fields[2 * k : 2 * k + 2])
            quat = _message(*time, *self.orientation, 3.0)
            parts = (sensor, first), (sensor + SECOND_SENSOR_OFFSET, second), (sensor, None, quat)
            messages += [cobs(_message(index, finger + 1, link + 1, *part)) for part in parts]
        self.index = self.index + 1 & 0xFFFFFFFF
        return messages


def _message(*values: int | float | bytes | None) -> bytes:
    """Return the values as fields 1, 2, 3 ... in protobuf."""
    data = b""
    for number, value in enumerate(values, 1):
        if isinstance(value, bytes):
            data += bytes([number << 3 | MESSAGE_TYPE]) + _varint(len(value)) + value
        elif isinstance(value, float) and value:
            data += bytes([number << 3 | FLOAT_TYPE]) + struct.pack("<f", value)
        elif value:
            data += bytes([number << 3 | VARINT_TYPE]) + _varint(int(value))
    return data


def _varint(number: int) -> bytes:
    """Return a number in groups of seven bits, the lowest first; bit 7 marks all but the last byte.

    A negative number has 64 bits.
    """
    data, number = bytearray(), number & 0xFFFFFFFFFFFFFFFF
    while number > 0x7F:
        data.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*data, number])
