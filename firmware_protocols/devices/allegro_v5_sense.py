"""Wonik Allegro Hand V5 Sense: sixteen pressure channels and sixteen joints on CAN.

Wire: classic CAN, standard ids: the numbers of the vendor's driver times four.

    id        number   data               direction   about
    150       54       ``EIGHT``          to host     channels 0 to 7
    154       55       ``EIGHT``          to host     channels 8 to 15
    200       80       remote             to hand     information: ``INFORMATION`` under the same id
    220       88       remote             to hand     serial number: 8 ASCII, the fourth is the side, R or L
    204       81       ``<u2 x 3``        to hand     periods [ms] of joints, IMU and temperatures; 0 stops them
    80 .. 8C  20 .. 23 ``POSE``           to host     joints: index, middle, ring, thumb; on remote, too
    100, 104  40, 41   -                  to hand     servo on, off
    180 ..    60 ..    ``POSE``           to hand     torques of a finger; with 228 01 its positions
    380 ..    E0 ..    ``POSE``           to hand     positions of a finger
    224       89       -                  to hand     calibration: the present pose becomes 0
    228       -        01 or 00, zeros    to hand     positions in place of torques on or off
    22C, 1A0  68       8, 6 bytes         to hand     gravity, settings: ignored

Channel 0 is the palm; 3, 7, 11 and 15 are the fingertips of index, middle, ring and thumb; the others lie on the links
between. The driver multiplies a byte by 4, takes FF as invalid and shows it as 0, low-passes and divides by 10.

Torques move nothing here. Not modelled, since the driver asks for none of them: the older frames 158 and 15C (four u16
each, big-endian), motor currents 000 and 00C (eight i8 each, 240 mA / 127), IMU, temperatures.

Evidence: the vendor's ROS driver, run.

Try it: ``tactemu run allegro_v5_sense --port can:socketcan:vcan0``, then ``candump vcan0``.
"""

from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    CanFrame, Column, Counts, Frame, Option, Reading, Request, Transmissions, command, fact_table, points, stack,
)  # fmt: skip
from firmware_protocols.devices.allegro_v5 import (
    FINGER_SPACING_M, FINGERS, JOINTS, POSITIONS, SPEED_COUNTS_PER_S, TORQUES, AllegroV5,
)  # fmt: skip

EIGHT = Frame("""
    eight channels
    0     u1 x 8     channels     0 to 254, FF invalid
""")
INFORMATION = Frame("""
    information
    0     <u2        hardware
    2     <u2        firmware
    4     00 x 2     reserved
    6     u1         servo        bit 0: on
    7     00         reserved
""")
CHANNEL_IDS = (0x150, 0x154)
INVALID_BYTE = 0xFF
PITCH_M = 0.018
COUNTS_PER_NEWTON = 25.0
DRIVER, SOCKET = "AllegroHandDrv.cpp", "candrv/socket_can.cpp"


def places() -> dict[str, tuple[str, float, float]]:
    """Return link, x and y [m] of each channel by name: the palm, three of the first finger, four of each other."""
    found = {"palm": ("palm", 0.0, -0.06)}
    for k in range(1, 4 * len(FINGERS)):
        finger, part = FINGERS[k // 4], k % 4
        found[f"{finger} {'tip' if part == 3 else part}"] = (finger, (k // 4 - 1.5) * FINGER_SPACING_M, part * PITCH_M)
    return found


def _are_poses(frames: list[CanFrame]) -> bool:
    """Return True if these are complete rounds of the fingers' joints, or none yet."""
    return [frame.arbitration_id for frame in frames] == list(JOINTS) * (len(frames) // 4)


class AllegroV5Sense(AllegroV5):
    """Sixteen channels that the hand transmits unasked, and sixteen joints."""

    name = "allegro_v5_sense"
    title = "Wonik Allegro Hand V5 Sense, touch"
    evidence = ("driver",)
    sources = (
        "Wonikrobotics-git/allegro_hand_ros2_V5_Sense@db81588 AllegroHandDrv.cpp, candrv/socket_can.cpp, candef.h",
    )
    origin = DRIVER
    judge = "Wonikrobotics-git/allegro_hand_ros2_V5_Sense@db81588"
    facts = fact_table(f"""
        stated touch: the message numbers of fingertips and palm; a value is a byte times 4, FF marks an invalid one @
            AllegroHandDrv.cpp _parseMessage, maps
        assumed touch: {COUNTS_PER_NEWTON:.0f} counts/N
        assumed touch: which finger has which fingertip channel; the channels between two tips lie on the finger of the
            following tip
        assumed touch: each channel is one point, {PITCH_M * 1000.0:.0f} mm apart along a finger; fingers are
            {FINGER_SPACING_M * 1000.0:.0f} mm apart, all in one plane @ AllegroHandDrv.cpp; urdf
        stated identity: the formats of information and serial number; its fourth character is the side @ _parseMessage
        assumed identity: hardware 0500, firmware 0100 (hex); serial number V5SR0001 @ AllegroHandDrv.cpp
        stated configuration: periods [ms] of the reports of joints, IMU and temperatures; 0 stops a report @
            AllegroHandDrv.cpp:init, ~
        stated configuration: after message 228 01, the messages 180 to 18C command positions @ socket_can.cpp
            command_set_pose_direct
        assumed configuration: the model never sends IMU and temperatures, whatever their periods @ AllegroHandDrv.cpp
            asks 0
        assumed timing: touch is sent 100 times a second from power-up on, whatever the periods; the bus has 1 Mbit/s
        assumed timing: joints turn at {SPEED_COUNTS_PER_S * 0.088:.0f} deg/s, between -180 and 180 deg
    """, looked="AllegroHandDrv.cpp, socket_can.cpp, allegro_node.cpp")  # fmt: skip

    def __init__(
        self,
        *,
        invalid: Annotated[tuple[int, ...], Option("channels that send FF", low=0, high=15)] = (),
        side: Annotated[Literal["right", "left"], Option("which hand: a letter of the serial number")] = "right",
    ):
        self.layout = stack(
            *(points({name: (x, y, 0.0)}, pitch=0.012, link=link) for name, (link, x, y) in places().items())
        )
        self.invalid = list(invalid)
        self.columns = (
            Column(name="channel", low=0, high=0xFE, assumed_per_unit=COUNTS_PER_NEWTON, push=0 if invalid else 1),
        )
        self._power_up(f"V5S{'R' if side == 'right' else 'L'}0001")
        self.takes_positions, self.joints_ns = False, 0

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return raw counts of the normal force on each channel, 0..254; 0 for an invalid one; shape ``(16,)``."""
        super().measure(reading, t_ns)
        self.counts[self.invalid] = 0
        return self.counts

    def stream(self, t_ns: int, name: str) -> Transmissions[CanFrame]:
        """Return two frames of eight channels each."""
        sent = self.layout.on_wire(np.where(np.isin(np.arange(16), self.invalid), INVALID_BYTE, self.counts))
        eights = zip(CHANNEL_IDS, sent.reshape(2, 8))
        return [CanFrame(arbitration_id=ident, data=EIGHT.pack(channels=eight)) for ident, eight in eights]

    @command("200#R", "200#0005000100000000", safe=True)
    @command("200#R", "200#0005000100000100", name="is it on", after=("100#",))
    def information(self, request: Request):
        """Return versions, and whether the servos are on."""
        return INFORMATION.pack(hardware=0x0500, firmware=0x0100, servo=self.servo)

    @command("204#030000000000", _are_poses, name="joints every 3 ms", data="<3H")
    @command("204#000000000000", name="stop")
    def periods_ms(self, request: Request):
        """Set the period of the joints."""
        self.joints_ns = request.value * 1_000_000
        self.wake_ns = request.t_ns + self.joints_ns if self.joints_ns else None

    def wake(self, t_ns: int) -> Transmissions[CanFrame]:
        """Return the joints of all fingers, once each period."""
        self.wake_ns = t_ns + self.joints_ns
        return self.poses(t_ns)

    @command("224#")
    def calibration(self, request: Request):
        """Make the present pose 0."""
        self.rest = self.motors.positions(request.t_ns)

    @command("228#0100000000000000", name="positions in place of torques", data="<B7x")
    def mode(self, request: Request):
        """Take torques, or positions in their place."""
        self.takes_positions = request.value == 1

    @command("180#F0000000000010FF", name="torques of the index", on=TORQUES, data="<4h", origin=SOCKET)
    @command("180#6400640064006400", name="positions of the index", after=("228#0100000000000000",))
    def torques(self, request: Request):
        """Obey positions of a finger in place of torques, which move nothing."""
        if self.takes_positions:
            self._go(TORQUES.index(request.id), request)

    @command("384#6400640064006400", name="positions of the middle", on=POSITIONS, data="<4h", origin=SOCKET)
    def positions(self, request: Request):
        """Obey positions of a finger."""
        self._go(POSITIONS.index(request.id), request)

    @command("22C#0000000000000000", name="gravity")
    @command("1A0#810000000000", name="device number", origin=SOCKET)
    def other(self, request: Request):
        """Ignore gravity and settings."""
