"""DexRobot DexHand021: six boards on CAN-FD, five with a fingertip that measures force and temperature.

Wire: CAN-FD, standard identifiers. Board b is 1..6 of a left hand, 7..12 of a right one: thumb, palm, index, middle,
ring, little finger. The palm turns the thumb and spreads the fingers, and has no fingertip.

    id         data                          direction   about
    180+b      ``FEEDBACK``                  to host     the palm sends only its first 16 bytes
    100+b      ``MOTION``                    to board    in mode 2 answered by feedback
    000+b      03 74 mode period on          to board    feedback: 1 periodic, 2 when asked, 3 when it has changed;
                                                         period [10 ms]; on 1, or 0 for none
    000+b      03 A4                         to board    clear errors
    080+b      03, command, 00, 01           to host     answer to these two
    000+b      01 02                         to board    version of the firmware
    080+b      four bytes, the last first    to host     answer to that
    600+b      EE, type, bits                to host     an error; never sent

A frame may be longer than its message: the C++ library pads to 64 bytes. Feedback frames below 42 bytes are of
boards without touch. That library (185f7c8) takes every number of the feedback high byte first and the forces as
integers; the Python driver, which is newer, reads them as listed here.

Evidence: the vendor's two drivers, run.

Try it: ``tactemu run dexrobot_dexhand --port can:socketcan:vcan0``, then ``candump vcan0``.
"""

from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    Can, CanFrame, CanRequests, Column, Counts, Device, Frame, Identifier, Motors, Option, Reading, Refused, Request,
    Transmissions, command, command_table, fact_table, points, quantize, stack,
)  # fmt: skip

FEEDBACK = Frame("""
    feedback
    0     <i2 x 2 x 3  motors              of each of two: current [mA], speed [rpm], position [counts]
    12    <i2 x 2    angles              [0.01 deg]
    16    <f4        normal              [N]
    20    00 x 4     normal_delta        u32
    24    <f4        tangential          [N]
    28    00 x 4     tangential_delta    u32
    32    <u2        direction           of the tangential force [deg]
    34    00 x 4     proximity           u32
    38    <u4        temperature         [deg C]
    42    00 x 4     encoders            u16 x 2
    46    00 x 2     unused
""")
MOTION = Frame("""
    motion
    0     u1         mode      44: goals [0.01 deg], 33 and 55: [counts]; others move nothing here
    1     u1         enabled   bit 0 the first motor, 1 the second
    2     <i2 x 2    goals
""")
BYTES_WITHOUT_TOUCH = 16
FINGERS = ("thumb", "index", "middle", "ring", "little")
BOARDS = ("thumb", "palm", *FINGERS[1:])
JOINTS = {
    # name: most [deg], counts per degree / (20 / 3), two for each board
    "th_dip": (90, 2.1), "th_mcp": (90, 2.1), "th_rot": (150, 1.8), "ff_spr": (30, 4.0), "ff_dip": (90, 2.2),
    "ff_mcp": (90, 1.6), "mf_dip": (90, 2.2), "mf_mcp": (90, 1.6), "rf_dip": (90, 2.2), "rf_mcp": (90, 1.6),
    "lf_dip": (90, 2.2), "lf_mcp": (90, 1.6),
}  # fmt: skip
MAX_ANGLES_DEG, HALL_FACTORS = np.array(list(JOINTS.values())).T
COUNTS_PER_DEGREE = HALL_FACTORS * 20 / 3
ANGLES, HALL_COUNTS = (0x44,), (0x33, 0x55)
"""The modes of a motion by the kind of its goals."""
CAN_ID = Identifier("00ffbbbbbbb", {"function": "f", "board": "b"})
SET_UP, REPLY, MOVE, STATE = range(4)
OFF, PERIODIC, WHEN_ASKED, ON_CHANGE = range(4)
SET_FEEDBACK, CLEAR_ERRORS, ASK_VERSION = b"\x03\x74", b"\x03\xa4", b"\x01\x02"
FIRMWARE = bytes([1, 0, 0, 0])
FINGER_SPACING_M = 0.025
PITCH_M = 0.012
MAX_FORCE_N = 50.0
PYZLG = "DexRobot/pyzlg_dexhand@316575a pyzlg_dexhand/"
CPP = "DexRobot/dexhand021_linux_sdk_cpp@185f7c8 "
TESTED = "DexRobot/pyzlg_dexhand@316575a tools/hardware_test/test_dexhand.py"
LOOKED = "all of pyzlg_dexhand@316575a; dexhand021_linux_sdk_cpp@185f7c8 include, example, libdexhand_sdk_cpp.so"


class DexrobotDexHand(Device[CanFrame]):
    """A hand with a force sensor in each fingertip, and twelve motors."""

    name = "dexrobot_dexhand"
    kind = "hand"
    title = "DexRobot DexHand021"
    senses = ("force", "temperature")
    columns = (
        Column(name="normal", unit="N", counts_per_unit=1.0, low=0, high=MAX_FORCE_N, push=1),
        Column(name="tangential", unit="N", counts_per_unit=1.0, low=0, high=MAX_FORCE_N),
        Column(name="direction", low=0, high=359),
        Column(name="temperature", sense="temperature", unit="degC", counts_per_unit=1.0, low=0, high=85, rest=25),
    )
    evidence = ("driver",)
    sources = (
        f"{PYZLG}dexhand_interface.py, zcan_wrapper.py, dexhand_protocol/*.py, ../config/config.yaml",
        f"{CPP}include/Protocols.h, libs/libdexhand_sdk_cpp.so",
    )
    judge = "DexRobot/pyzlg_dexhand@316575a, DexRobot/dexhand021_linux_sdk_cpp@185f7c8"
    documented = command_table("""
        @ DexRobot/pyzlg_dexhand@316575a pyzlg_dexhand/dexhand_interface.py, dexhand_protocol/*.py
        feedback every 10 ms   001##10374010101                          081##103740001
        feedback when asked    001##10374020101                          081##103740001
        feedback on change     001##10374030101                          081##103740001
        feedback off           001##10374010100                          081##103740001
        clear errors           001##103A4                                081##103A40001
        motion, as a question  001##10374020101; 101##1 44 03 E803 D007  181##1..{48}
        @ DexRobot/dexhand021_linux_sdk_cpp@185f7c8 include/Protocols.h, libs/libdexhand_sdk_cpp.so
        ? version              001##10102000000000000                    081##1..{4}
        motion                 101##1 44 03 E803 D007                    -  both motors to 10 and 20 deg
    """)
    facts = fact_table(f"""
        stated touch: the boards are, in order, thumb, palm, index, middle, ring and little finger @
            {PYZLG}dexhand_interface.py:99 finger_map
        stated touch: the same order; the palm has no fingertip @ {CPP}include/Protocols.h:222, status_data
        stated touch: direction 0 points to the fingertip @ {PYZLG}dexhand_interface.py:68
        assumed touch: forces reach {MAX_FORCE_N:.0f} N; the direction rises clockwise; the temperature is 0 to 85 deg C
        assumed touch: each fingertip is one point, {FINGER_SPACING_M * 1000.0:.0f} mm apart, with normal +z and the
            tips towards +y
        assumed touch: proximity and the two deltas are 0
        stated identity: the version is requested with 01 02; it has four bytes, the last one first @
            {CPP}libdexhand_sdk_cpp.so get_sdk_version
        assumed identity: firmware 1.0.0.0
        stated configuration: 1 and 5 Mbit/s @ {PYZLG}zcan_wrapper.py:263
        stated configuration: a set-up message begins with 03, then has the mode, the period [10 ms] and a switch @
            {PYZLG}dexhand_protocol/commands.py:107
        stated configuration: goals are in 0.01 deg, or in counts of the Hall sensor @ {PYZLG}dexhand_interface.py:504
            _scale_angle
        stated configuration: joints reach 90 deg, th_rot 150 deg, ff_spr 30 deg @ {TESTED}:46
        stated configuration: feedback is sent even without a set-up message @ {TESTED}: reads, and never sets a mode
        assumed configuration: mode 1 after power-up; in mode 2 the hand answers each motion message
        assumed configuration: motors move at 200 deg/s; currents, speeds and encoders read 0
        assumed timing: after power-up every board sends feedback 100 times a second, all at the same time
    """, looked=LOOKED)  # fmt: skip

    def __init__(
        self, *, side: Annotated[Literal["left", "right"], Option("which hand; sets the identifiers")] = "left"
    ):
        self.first = 1 if side == "left" else 7
        boards = range(self.first, self.first + len(BOARDS))
        self.packets = CanRequests(CAN_ID, by="function", is_fd=True)
        filters = tuple(CAN_ID.filter(function=to, board=b) for to in (SET_UP, MOVE) for b in boards)
        self.ports = (Can(data_bitrate=5_000_000, filters=filters, addressed=tuple((b, 0x7F) for b in boards)),)
        places = {finger: ((k - 2) * FINGER_SPACING_M, 0.0, 0.0) for k, finger in enumerate(FINGERS)}
        self.layout = stack(*(points({f: at}, pitch=PITCH_M, link=f) for f, at in places.items()))
        names = tuple(JOINTS)
        self.motors = Motors(
            [0.0] * len(names), high=MAX_ANGLES_DEG, low=0.0, speed_limit=200.0, names=names, unit=np.deg2rad(1)
        )
        self.modes, self.periods_ns = [PERIODIC] * len(BOARDS), [0] * len(BOARDS)
        self.said, self.said_ns = [b""] * len(BOARDS), [-(1 << 62)] * len(BOARDS)

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return, by sense: normal, tangential force [N], float32, direction [deg] of a tip; temperature [deg C]."""
        x, y, z = self.layout.to_taxel_frame(reading["force"]).T
        forces = (np.clip(np.stack([-z, np.hypot(x, y)]), 0.0, MAX_FORCE_N) + 0.0).astype(np.float32)
        direction = np.rint(np.degrees(np.arctan2(x, y))) % 360
        self.counts = np.stack([*forces, direction], axis=1)
        self.warmth = quantize(reading["temperature"], 1.0, 0, 85)
        return {"force": self.counts, "temperature": self.warmth}

    def stream(self, t_ns: int, name: str) -> Transmissions[CanFrame]:
        """Return the feedback of the boards that send it unasked."""
        frames = []
        for board, mode in enumerate(self.modes):
            frame = self._feedback(board, t_ns)
            due = t_ns - self.said_ns[board] >= self.periods_ns[board]
            if (mode == PERIODIC and due) or (mode == ON_CHANGE and frame.data != self.said[board]):
                frames.append(frame)
                self.said[board], self.said_ns[board] = frame.data, t_ns
        return frames

    def _feedback(self, board: int, t_ns: int) -> CanFrame:
        """Return the feedback frame of one board, counted from 0."""
        two = slice(2 * board, 2 * board + 2)
        degrees = self.motors.positions(t_ns)[two]
        motors = np.zeros((2, 3), np.int64)
        motors[:, 2] = np.rint(degrees * COUNTS_PER_DEGREE[two])
        measured = dict.fromkeys(("normal", "tangential", "direction", "temperature"), 0)
        if touches := BOARDS[board] in FINGERS:
            tip = FINGERS.index(BOARDS[board])
            normal, tangential, direction = self.layout.on_wire(self.counts)[tip].tolist()
            warmth = self.layout.on_wire(self.warmth)[tip].item()
            measured = {"normal": normal, "tangential": tangential, "direction": int(direction), "temperature": warmth}
        data = FEEDBACK.pack(motors=motors, angles=quantize(degrees, 100.0, 0, 0x7FFF), **measured)
        return self._frame(STATE, board, data if touches else data[:BYTES_WITHOUT_TOUCH])

    def _frame(self, function: int, board: int, data: bytes) -> CanFrame:
        return self.packets.frame(CAN_ID.of(function=function, board=self.first + board), data)

    def accepts(self, request: Request) -> bool:
        """Return True for a board of this hand."""
        return 0 <= request.board - self.first < len(BOARDS)

    @command(on=MOVE, data="6s*")
    def move(self, request: Request):
        """Move the motors of a board."""
        order, board = MOTION.unpack(request.value), request.board - self.first
        assert order is not None
        two = slice(2 * board, 2 * board + 2)
        if order["mode"] in (*ANGLES, *HALL_COUNTS):
            enabled = [bool(order["enabled"] & bit) for bit in (1, 2)]
            per_degree = 100.0 if order["mode"] in ANGLES else COUNTS_PER_DEGREE[two]
            self.motors.go(np.where(enabled, order["goals"] / per_degree, np.nan), request.t_ns, at=two)
        return [self._feedback(board, request.t_ns)] if self.modes[board] == WHEN_ASKED else ()

    @command(on=SET_UP, data="2s*")
    def set_up(self, request: Request):
        """Set the feedback of a board, clear errors, or return its version."""
        board, data, answer = request.board - self.first, request.data, bytes([*request.data[:2], 0, 1])
        if request.value == ASK_VERSION:
            answer = FIRMWARE[::-1]
        elif request.value == SET_FEEDBACK and len(data) >= 5 and PERIODIC <= data[2] <= ON_CHANGE:
            self.modes[board], self.said[board] = (data[2] if data[4] else OFF), b""
            self.periods_ns[board] = data[3] * 10_000_000
        elif request.value != CLEAR_ERRORS:
            raise Refused("value")
        return [self._frame(REPLY, board, answer)]
