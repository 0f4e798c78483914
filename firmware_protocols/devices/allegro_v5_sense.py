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

import struct
from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    Can, CanFrame, Column, Command, Counts, Device, Frame, Motors, Option, Reading, Transmissions, fact_table, points,
    quantize, stack,
)  # fmt: skip

EIGHT = Frame("""
    eight channels
    0     u1 x 8     channels     0 to 254, FF invalid
""")
POSE = Frame("""
    joints of a finger
    0     <i2 x 4    joints       [0.088 deg], from the palm to the tip
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
INFO = 0x200
SERIAL = 0x220
PERIODS = 0x204
ON = 0x100
OFF = 0x104
CALIBRATE = 0x224
POSITIONS = 0x228
TORQUE = 0x180
GO = 0x380
JOINTS = 0x80
"""The id of the first finger, like TORQUE and GO; each next finger adds four."""
IGNORED_IDS = (0x22C, 0x1A0)
DATA_BYTES = {PERIODS: 6, ON: 0, OFF: 0, CALIBRATE: 0, POSITIONS: 8, IGNORED_IDS[0]: 8, IGNORED_IDS[1]: 6}
RAD_PER_COUNT = np.radians(0.088)
STOP_COUNTS = 2045
SPEED_COUNTS_PER_S = 4000.0
INVALID_BYTE = 0xFF
FINGERS = ("index", "middle", "ring", "thumb")
PITCH_M = 0.018
FINGER_SPACING_M = 0.03
COUNTS_PER_NEWTON = 25.0


def places() -> dict[str, tuple[str, float, float]]:
    """Return link, x and y [m] of each channel by name: the palm, three of the first finger, four of each other."""
    found = {"palm": ("palm", 0.0, -0.06)}
    for k in range(1, 4 * len(FINGERS)):
        finger, part = FINGERS[k // 4], k % 4
        found[f"{finger} {'tip' if part == 3 else part}"] = (finger, (k // 4 - 1.5) * FINGER_SPACING_M, part * PITCH_M)
    return found


class AllegroV5Sense(Device[CanFrame]):
    """Sixteen channels that the hand transmits unasked, and sixteen joints."""

    name = "allegro_v5_sense"
    kind = "hand"
    title = "Wonik Allegro Hand V5 Sense, touch"
    ports = (Can(),)
    evidence = ("driver",)
    sources = (
        "Wonikrobotics-git/allegro_hand_ros2_V5_Sense@db81588 AllegroHandDrv.cpp, candrv/socket_can.cpp, candef.h",
    )
    judge = "Wonikrobotics-git/allegro_hand_ros2_V5_Sense@db81588"
    facts = fact_table(f"""
        stated touch: numbers of tips and palm, bytes times 4, FF invalid @ AllegroHandDrv.cpp _parseMessage, maps
        assumed touch: {COUNTS_PER_NEWTON:.0f} counts/N @ AllegroHandDrv.cpp, socket_can.cpp, allegro_node.cpp
        assumed touch: which finger has which tip; channels between lie on the finger whose tip follows @ the same
        assumed touch: a point each, {PITCH_M * 1000.0:.0f} mm apart along a finger, fingers
            {FINGER_SPACING_M * 1000.0:.0f} mm apart, flat @ the same; urdf
        stated identity: forms of information and serial number; the fourth character is the side @ _parseMessage
        assumed identity: hardware 0500, firmware 0100 (hex); serial number V5SR0001 @ AllegroHandDrv.cpp
        stated configuration: periods [ms] of joints, IMU, temperatures; 0 stops @ AllegroHandDrv.cpp:init, ~
        stated configuration: 228 01 makes 180 to 18C positions @ socket_can.cpp command_set_pose_direct
        assumed configuration: IMU and temperatures are not sent, whatever their period @ AllegroHandDrv.cpp asks 0
        assumed timing: touch 100 times a second from power-up on, whatever the periods; 1 Mbit/s @ the same
        assumed timing: joints turn at {SPEED_COUNTS_PER_S * 0.088:.0f} deg/s between -180 and 180 deg @ the same
    """)

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
        self.columns = (Column(name="channel", low=0, high=0xFE, push=0 if invalid else 1),)
        self.serial = b"V5S" + (b"R" if side == "right" else b"L") + b"0001"
        self.servo, self.takes_positions, self.joints_ns = False, False, 0
        self.zero = np.zeros(16)
        self.motors = Motors(
            [0.0] * 16,
            low=-STOP_COUNTS,
            high=STOP_COUNTS,
            time_constant_s=0.0,
            speed_limit=SPEED_COUNTS_PER_S,
            names=[f"{finger} {k}" for finger in FINGERS for k in range(4)],
            unit=RAD_PER_COUNT,
        )

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return raw counts of the normal force on each channel, 0..254; 0 for an invalid one; shape ``(16,)``."""
        self.counts = quantize(self.layout.push(reading["force"]), COUNTS_PER_NEWTON, 0, 0xFE)
        self.counts[self.invalid] = 0
        return self.counts

    def stream(self, t_ns: int, name: str) -> Transmissions[CanFrame]:
        """Return two frames of eight channels each."""
        sent = self.layout.on_wire(np.where(np.isin(np.arange(16), self.invalid), INVALID_BYTE, self.counts))
        eights = zip(CHANNEL_IDS, sent.reshape(2, 8))
        return [CanFrame(arbitration_id=ident, data=EIGHT.pack(channels=eight)) for ident, eight in eights]

    def receive(self, data: CanFrame, t_ns: int, port: str) -> Transmissions[CanFrame]:
        """Obey or answer one frame: identity, joint poses, periods, and where the joints go."""
        ident, message = data.arbitration_id, data.data
        remote = CanFrame(arbitration_id=ident, is_remote_frame=True)
        finger = next((k for k in range(4) for first in (JOINTS, TORQUE, GO) if ident == first + 4 * k), None)
        is_query = data == remote and (ident in (INFO, SERIAL) or (finger is not None and ident < TORQUE))
        if data not in (remote, CanFrame(arbitration_id=ident, data=message)):
            self.counters["ignored"] += 1
            return ()
        if not is_query and not (ident in DATA_BYTES or (finger is not None and ident >= TORQUE)):
            self.counters["ignored"] += 1
            return ()
        if not is_query and (data == remote or len(message) != DATA_BYTES.get(ident, 8)):
            self.counters["bad_length"] += 1
            return ()
        self.counters["requests"] += 1
        if is_query:
            return [self._answer(ident, finger, t_ns)]
        if ident in (ON, OFF):
            self.servo = ident == ON
        elif ident == CALIBRATE:
            self.zero = self.motors.positions(t_ns)
        elif ident == POSITIONS:
            self.takes_positions = message[0] == 1
        elif ident == PERIODS:
            self.joints_ns = struct.unpack_from("<H", message)[0] * 1_000_000
            self.wake_ns = t_ns + self.joints_ns if self.joints_ns else None
        elif finger is not None and (ident >= GO or self.takes_positions):
            goals = np.full(16, np.nan)
            goals[4 * finger :][:4] = np.array(struct.unpack("<4h", message)) + self.zero[4 * finger :][:4]
            self.motors.go(goals, t_ns)
        return ()

    def wake(self, t_ns: int) -> Transmissions[CanFrame]:
        """Return the joints of all fingers, once each period."""
        self.wake_ns = t_ns + self.joints_ns
        return [self._answer(JOINTS + 4 * finger, finger, t_ns) for finger in range(4)]

    def _answer(self, ident: int, finger: int | None, t_ns: int) -> CanFrame:
        if ident == INFO:
            data = INFORMATION.pack(hardware=0x0500, firmware=0x0100, servo=self.servo)
        elif finger is None:
            data = self.serial
        else:
            counts = np.round(self.motors.positions(t_ns) - self.zero)
            data = POSE.pack(joints=np.clip(counts[4 * finger :][:4], -0x8000, 0x7FFF).astype(int))
        return CanFrame(arbitration_id=ident, data=data)

    @property
    def commands(self) -> tuple[Command, ...]:
        """The driver's messages from open to close."""
        driver, socket = "AllegroHandDrv.cpp", "candrv/socket_can.cpp"
        side = self.serial[3:4].hex()
        return (
            Command(name="servo off", request="104#", origin=driver),
            Command(name="information", request="200#R", reply="200#0005000100000000", origin=driver, safe=True),
            Command(name="serial number", request="220#R", reply=f"220#563553{side}30303031", origin=driver, safe=True),
            Command(name="joints every 3 ms", request="204#030000000000", reply=_are_poses, origin=driver),
            Command(name="servo on", request="100#", origin=driver),
            Command(name="is it on", request="200#R", after=["100#"], reply="200#0005000100000100", origin=driver),
            Command(name="joints of the thumb", request="08C#R", reply="08C#..{8}", origin=socket, safe=True),
            Command(name="calibration", request="224#", origin=driver),
            Command(name="torques of the index", request="180#F0000000000010FF", about="moves nothing", origin=socket),
            Command(name="positions in place of torques", request="228#0100000000000000", origin=driver),
            Command(
                name="positions of the index",
                request="180#6400640064006400",
                after=["228#0100000000000000"],
                origin=driver,
            ),
            Command(name="positions of the middle", request="384#6400640064006400", origin=socket),
            Command(name="gravity", request="22C#0000000000000000", origin=driver),
            Command(name="device number", request="1A0#810000000000", origin=socket),
            Command(name="stop", request="204#000000000000", origin=driver),
        )


def _are_poses(frames: list[CanFrame]) -> bool:
    """Return True if these are complete rounds of the fingers' joints, or none yet."""
    idents = [JOINTS + 4 * finger for finger in range(4)] * (len(frames) // 4)
    return [frame.arbitration_id for frame in frames] == idents
