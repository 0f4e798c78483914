r"""Feetech STS3215 servos on one line: the six of an SO-101 arm, with the loads that they measure.

Wire: one-wire TTL behind an adapter, half duplex, 1 000 000 8N1; packets as in
:mod:`firmware_protocols.protocols.feetech`. Servos transmit only in reply. All numbers are little-endian; signs are
sign and magnitude. A servo is a memory:

    read position of 1   FF FF 01 04 02 38 02 BE                  FF FF 01 04 00 2A 08 C8     (2090)
    sync read of six     FF FF FE 0A 82 38 02 01 02 03 04 05 06 26
    sync write           FF FF FE 0A 83 2A 02 01 00 08 02 64 09 D0

Registers below 40 survive power-off if they are written while ``lock`` is 0; with ``lock`` 1 they act, but are lost.
4096 steps are a turn. What a servo calls its position is its encoder minus ``offset``, 0..4095 unless bit 4 of
``phase`` is set. ``torque`` 0 releases the shaft, 1 holds it, 2 damps, 128 makes its position 2048. ``mode`` 0 goes to
``goal`` within ``low`` and ``high``, 1 turns at ``goal_speed``, 2 with ``pwm``. In mode 0 ``goal_speed`` is the speed
limit, 0 the greatest (50 x ``top_speed``) steps/s. The current (69) reads 0.

``status`` is in every answer: bit 0 voltage, 2 temperature, 5 overload. The driver of LeRobot reads a copy of the goal
at 71, the vendor's table has it at 67. LeRobot takes the line speeds 5, 6, 7 for 57600, 38400, 19200, and so does
this model; the vendor's table has 76800, 57600, 38400.

Try it: ``tactemu run feetech_sts3215 --port pty:/tmp/arm``, then LeRobot's ``FeetechMotorsBus("/tmp/arm", ...)``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated

import numpy as np

from firmware_protocols import (
    Column, Counts, Device, Motors, Option, Reading, RegisterMap, Registers, Rs485, Sense, Sent, Transmissions,
    command_table, fact_table, points, quantize,
)  # fmt: skip
from firmware_protocols.protocols.feetech import ServoLine

MAP = RegisterMap("""
    0   u1            major           = 3  r               firmware; LeRobot requires the same in all servos
    1   u1            minor           = 10  r
    3   <u2           model           = 777  r
    5   u1            id              0..253  = 1  flash
    6   u1            baud            0..7  flash          0 1M, 1 500k, 2 250k, 3 128k, 4 115200; see above
    7   u1            delay           flash                before an answer [2 us]
    8   u1            answers         = 1  flash           0: to ping and read only
    9   <u2           low             flash
    11  <u2           high            = 4095  flash
    13  u1            hottest         = 70  flash          [deg C]
    14  u1            most_volts      = 140  flash         [0.1 V]
    15  u1            least_volts     = 40  flash          [0.1 V]
    16  <u2           most_torque     = 1000  flash        [0.1 %]
    18  u1            phase           = 12  flash
    19  u1            unload          = 44  flash          bits of status
    20  u1            alarm           = 47  flash          bits of status
    21  u1            p               = 32  flash
    22  u1            d               = 32  flash
    23  u1            i               flash
    24  u1            start_force     = 16  flash
    25  u1            integral_limit  flash
    26  u1 x 2        dead_zones      = 1  flash
    28  <u2           most_current    = 511  flash         [6.5 mA]
    30  u1            resolution      = 1  flash
    31  <u2 sign 11   offset          flash
    33  u1            mode            flash
    34  u1            safe_torque     = 20  flash          [%]
    35  u1            overload_time   = 200  flash         [10 ms]
    36  u1            overload        = 80  flash          [%]
    37  u1            speed_p         = 10  flash
    38  u1            current_time    = 200  flash         [10 ms]
    39  u1            speed_i         = 10  flash
    40  u1            torque
    41  u1            acceleration                         [100 steps/s2]
    42  <u2 sign 15   goal
    44  <u2 sign 10   pwm                                  [0.1 %]
    46  <u2 sign 15   goal_speed                           [steps/s]
    48  <u2           torque_limit    = 1000               [0.1 %]
    55  u1            lock            = 1
    56  <u2 sign 15   position        r
    58  <u2 sign 15   speed           r                    [steps/s]
    60  <u2 sign 10   load            r                    [0.1 %]
    62  u1            voltage         r                    [0.1 V]
    63  u1            temperature     r                    [deg C]
    64  u1            waiting         r                    1 between reg write and action
    65  u1            status          r
    66  u1            moving          r
    67  <u2 sign 15   goal_copy       r
    80  u1 x 4        factory         = 1, 1, 1, 0         moving threshold, DTs, speed unit, Hts
    84  u1            top_speed       = 66                 [50 steps/s]
    85  u1            most_acceleration  = 254
    86  u1            factor          = 1
""")
BAUDS = (1_000_000, 500_000, 250_000, 128_000, 115_200, 57_600, 38_400, 19_200)
COUNTS_PER_TURN = 4096
MIDDLE_COUNTS = 2048
SHAFT_STOP_COUNTS = 2**40
SEVERAL_TURNS = 0x10
HOLDING, MAKE_MIDDLE = 1, 128
POSITION, SPEED, PWM = 0, 1, 2
VOLTAGE, TEMPERATURE, OVERLOAD = 1, 4, 32
ORDERS = {"torque", "mode", "goal", "pwm", "goal_speed", "top_speed", "low", "high", "offset"}
LIMB = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
SWING_PERIOD_NS = 4_000_000_000


class Servo:
    """One servo of the line: a memory that moves a shaft, and gives its position."""

    def __init__(self, arm: FeetechSts3215, index: int, ident: int):
        self.arm, self.index = arm, index
        self.registers = Registers(MAP, kept={"id": ident, **arm.flash.get(str(index), {})})
        self.registers["torque_limit"] = self.registers["most_torque"]
        self.by_hand, self.released_ns = 0.0, 0
        self.registers["goal"] = self.position(0)

    @property
    def id(self) -> int:
        """The id of the servo, 0..253."""
        return self.registers["id"]

    @property
    def delay_ns(self) -> int:
        """The delay before an answer [ns]."""
        return 2000 * self.registers["delay"]

    @property
    def confirms(self) -> bool:
        """True if the servo answers writes, too."""
        return self.registers["answers"] != 0

    @property
    def status(self) -> int:
        """The status bits: voltage, temperature, overload."""
        get, volts = self.registers.__getitem__, self.arm.volts
        fine = get("least_volts") <= volts <= get("most_volts")
        hot = self.arm.warmth[self.index] > get("hottest")
        return VOLTAGE * (not fine) | TEMPERATURE * bool(hot) | OVERLOAD * bool(self.arm.overloaded[self.index])

    # -- the shaft -------------------------------------------------------------------------------------------------

    def position(self, t_ns: int) -> float:
        """Return the position of the servo [steps]."""
        by_hand = self.by_hand + (self._hand_offset(t_ns) if self.registers["torque"] == 0 else 0.0)
        shown = self.arm.motors.positions(t_ns)[self.index] + by_hand - self.registers["offset"]
        return shown if self.registers["phase"] & SEVERAL_TURNS else shown % COUNTS_PER_TURN

    def _hand_offset(self, t_ns: int) -> float:
        """Return how far a hand has moved the shaft since its release [steps]."""
        there, then = (
            np.sin(2 * np.pi * (time_ns / SWING_PERIOD_NS - self.index / len(LIMB)))
            for time_ns in (t_ns, self.released_ns)
        )
        return float(self.arm.swing[self.index] * (there - then))

    def _measure(self, t_ns: int) -> None:
        """Set the registers that show the present."""
        position, speed = round(self.position(t_ns)), self.arm.motors.velocities(t_ns)[self.index]
        shown = position if self.registers["phase"] & SEVERAL_TURNS else position % COUNTS_PER_TURN
        present = {
            "position": shown, "speed": speed, "moving": abs(speed) > 1.0, "load": self.arm.counts[self.index],
            "voltage": self.arm.volts, "temperature": self.arm.warmth[self.index], "status": self.status,
            "waiting": self.id in self.arm.line.pending, "goal_copy": self.registers["goal"],
        }  # fmt: skip
        for name, value in present.items():
            self.registers[name] = value

    # -- the memory ------------------------------------------------------------------------------------------------

    def read(self, address: int, n: int, t_ns: int) -> bytes:
        """Return memory as it is at ``t_ns``."""
        if n and address < MAP.by_name["factory"].address and address + n > MAP.by_name["position"].address:
            self._measure(t_ns)
        return self.registers.read(address, n)

    def write(self, address: int, data: bytes, t_ns: int) -> Sequence[str]:
        """Store what the host writes, keep it in flash if unlocked, and move the shaft."""
        position, held = self.position(t_ns), self.registers["torque"]
        written = self.registers.write(address, data)
        if held == 0 and "torque" in written:
            self.by_hand, self.released_ns = self.by_hand + self._hand_offset(t_ns), t_ns
        elif "torque" in written:
            self.released_ns = t_ns
        if self.registers["torque"] == MAKE_MIDDLE:
            self.registers["torque"] = 0
            self.registers["offset"] = self.registers["offset"] + round(position) - MIDDLE_COUNTS
            written.append("offset")
        if self.registers["lock"] == 0:
            kept = {name: self.registers.all(name) for name in written if MAP.by_name[name].flash}
            self.arm.flash[str(self.index)] = self.arm.flash.get(str(self.index), {}) | kept
        if "baud" in written:
            self.arm.set_line_speed(self.registers["baud"])
        if {"torque", "torque_limit"}.intersection(written):
            self.arm.limit_torques()
        if ORDERS.intersection(written):
            self._go(t_ns)
        return written

    def _go(self, t_ns: int) -> None:
        """Move the shaft as the registers order."""
        get, motors = self.registers.__getitem__, self.arm.motors
        top = 50 * get("top_speed")
        limits = self.arm.limits.copy()
        limits[self.index] = min(abs(get("goal_speed")) or top, top)
        self.arm.limits = limits
        motors.limit_speed(limits, t_ns)
        if get("torque") == HOLDING and get("mode") in (SPEED, PWM):
            speed = get("goal_speed") if get("mode") == SPEED else get("pwm") / 1000 * top
            motors.drive(speed, t_ns, at=self.index)
            return
        here = motors.positions(t_ns)[self.index]
        if get("torque") == HOLDING and get("mode") == POSITION:
            goal = min(max(get("goal"), get("low")), get("high")) if get("low") < get("high") else get("goal")
            here = here + goal - self.position(t_ns)
        motors.go(here, t_ns, at=self.index)


_READ = "lerobot 0.4.4 motors/feetech/, robots/so_follower/; feetech-servo-sdk 1.0.0; the vendor's memory table"


class FeetechSts3215(Device):
    """Servos on one line, addressed by id."""

    name = "feetech_sts3215"
    kind = "hand"
    title = "Feetech STS3215, six servos of an SO-101 arm"
    rate_hz = 100.0
    evidence = ("driver", "vendor document")
    sources = (
        "lerobot 0.4.4 motors/feetech/tables.py, feetech.py; robots/so_follower/so_follower.py",
        "feetech-servo-sdk 1.0.0 protocol_packet_handler.py, group_sync_read.py, group_sync_write.py",
        "the vendor's memory table for STS servos, as public wikis copy it; huggingface/lerobot pull 3373",
        "ftservo/ftservo-wiki@9522ce1 official-specs.json (speeds)",
    )
    judge = "feetech-servo-sdk 1.0.0, lerobot 0.4.4"
    documented = command_table(
        """
        @ as lerobot 0.4.4 sends it
        ? ping     01 02 01 FB                          01 02 00 FC
        ? ping all   FE 02 01 FE
            01 02 00 FC, 02 02 00 FB, 03 02 00 FA, 04 02 00 F9, 05 02 00 F8, 06 02 00 F7  one after another
        ? model    01 04 02 03 02 F3                    01 04 00 09 03 EE
        ? position   01 04 02 38 02 BE                    01 04 00 .. .. ..
        torque on  01 04 03 28 01 CE                    01 02 00 FC
        offset     02 05 03 1F 54 09 79                 02 02 00 FB
        reg write  01 05 04 2A 00 08 C3                 01 02 00 FC
        action     FE 02 05 FA                          -  what reg writes ordered
        ? positions  FE 0A 82 38 02 01 02 03 04 05 06 26
            01 04 00 .. .. .., 02 04 00 .. .. .., 03 04 00 .. .. .., 04 04 00 .. .. .., 05 04 00 .. .. ..,
            06 04 00 .. .. ..
        goals      FE 0A 83 2A 02 01 00 08 02 64 09 D0
        @ vendor's memory table; sum by feetech-servo-sdk 1.0.0
        middle     01 04 03 28 80 4F                    01 02 00 FC  here is 2048
        500 kbaud  01 04 03 06 01 F0                    01 02 00 FC
        """,
        head="FF FF",
    )
    facts = fact_table("""
        assumed touch: full torque is 2.94 Nm; the reported load is the torque of the motor against an external load
        stated identity: the model number is 777; all servos must have the same firmware @ lerobot 0.4.4
            motors/feetech/tables.py, feetech.py
        assumed identity: firmware 3.10
        stated configuration: the registers, their sizes and signs @ lerobot 0.4.4 motors/feetech/tables.py
        assumed configuration: the defaults that the vendor's table lacks: phase, unload, alarm, start_force, speed_p,
            speed_i, and registers 80 to 86
        assumed configuration: the supply is always 12.1 V and the current 0; gains, dead zones, acceleration and
            safe_torque have no effect
        assumed configuration: only bit 4 of `phase` has an effect; speeds are in steps/s, and speed 0 is the highest;
            encoder and current have no faults
        assumed configuration: a servo moves to its goal when its torque is switched on; the goal after power-up is the
            present position; no condition switches the torque off; overload means that the load was above `overload`
            for `overload_time`; a status bit clears with its cause
        assumed configuration: a line speed that is written to one servo holds for all servos of the line from then on
        assumed configuration: a write that includes a read-only byte stores nothing and is confirmed; missing registers
            read 0
        assumed configuration: in a physics engine servos give way by 0.1 rad at full torque, and turn freely while
            their torque is off
        stated timing: the line speeds and their codes @ ftservo/ftservo-wiki@9522ce1 official-specs.json
        assumed timing: a motor moves at its speed limit and settles with a time constant of 20 ms; in step mode and
            with damping it stands still; pwm 1000 is the top speed; values are sampled 100 times a second
        assumed timing: released shafts swing as if a hand moved them: in sine waves of 4 s, each a sixth of a period
            behind the one before
    """, looked=_READ)  # fmt: skip

    def __init__(
        self,
        *,
        ids: Annotated[tuple[int, ...], Option("ids as delivered; register 5 holds them")] = (1, 2, 3, 4, 5, 6),
        encoders: Annotated[
            float | tuple[float, ...], Option("positions of the shafts at power-up, before offsets", unit="steps")
        ] = 2048.0,
        swing: Annotated[
            float | tuple[float, ...],
            Option("amplitude of a hand that moves released shafts to and fro, as a leader's", unit="rad", low=0.0),
        ] = 0.0,
        full_torque: Annotated[float, Option("load that reads 1000", unit="Nm", low=0.01)] = 2.94,
        volts: Annotated[float, Option("supply", unit="V", low=0.0, high=25.5)] = 12.1,
    ):
        n, self.full_torque = len(ids), full_torque
        self.swing = np.broadcast_to(np.asarray(swing, float) / (2 * np.pi) * COUNTS_PER_TURN, n)
        self.volts = round(10 * volts)
        self.layout = points({})
        self.names = [LIMB[ident - 1] if 1 <= ident <= len(LIMB) else f"servo {ident}" for ident in ids]
        shafts = points(dict.fromkeys(self.names, (0.0, 0.0, 0.0)))
        self.senses = (Sense("load", at=shafts), Sense("temperature", at=shafts))
        scale = 1000 / full_torque
        self.columns = (Column(name="load", sense="load", unit="Nm", counts_per_unit=scale, low=-1000, high=1000),)
        self.motors = Motors(
            np.broadcast_to(encoders, n), low=-SHAFT_STOP_COUNTS, high=SHAFT_STOP_COUNTS, time_constant_s=0.02,
            names=self.names, unit=2 * np.pi / COUNTS_PER_TURN, zero=MIDDLE_COUNTS, strength=full_torque,
        )  # fmt: skip
        self.limits = np.full(n, 50.0 * MAP.by_name["top_speed"].default)  # type: ignore[operator]
        self.motors.limit_speed(self.limits, 0)
        self.counts, self.warmth = np.zeros(n, np.int64), np.full(n, 25)
        self.since_ns, self.overloaded = np.zeros(n, np.int64), np.zeros(n, bool)
        self.line = ServoLine(counters=self.counters)
        self.servos = [Servo(self, index, ident) for index, ident in enumerate(ids)]
        self.limit_torques()
        self.set_line_speed(self.servos[0].registers["baud"])

    def limit_torques(self) -> None:
        """Limit the torques in an engine: to each servo's limit, and to 0 while its torque is off."""
        get = [servo.registers.__getitem__ for servo in self.servos]
        self.motors.limit_force([each("torque_limit") / 1000 * (each("torque") == HOLDING) for each in get])

    def set_line_speed(self, code: int) -> None:
        """Set the speed of the line."""
        self.ports = (Rs485(baud=BAUDS[code]),)

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return the torque of each motor against its load [0.1 % of full torque], shape ``(n_servos,)``."""
        self.counts = quantize(-reading["load"], 1000 / self.full_torque, -1000, 1000)
        self.warmth = quantize(reading["temperature"], 1.0, 0, 255)
        get = [servo.registers.__getitem__ for servo in self.servos]
        heavy = np.abs(self.counts) > [10 * each("overload") for each in get]
        self.since_ns = np.where(heavy, self.since_ns, t_ns)
        self.overloaded = heavy & (t_ns - self.since_ns >= [10_000_000 * each("overload_time") for each in get])
        strengths = np.array([each("torque_limit") for each in get]) * self.full_torque / 1000
        self.motors.apply_loads(reading["load"], strengths, t_ns)
        return self.counts

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Answer packets, which arrive in chunks of any size."""
        answers = self.line.answers(data, t_ns, self.servos)
        return [Sent(answer.frame, delay_ns=answer.delay_ns, turn=answer.turn) for answer in answers]

    def joints(self, t_ns: int) -> Mapping[str, float]:
        """Return the angle of each shaft from the middle of its turn [rad], by name."""
        return {
            name: float((servo.position(t_ns) - MIDDLE_COUNTS) * 2 * np.pi / COUNTS_PER_TURN)
            for name, servo in zip(self.names, self.servos)
        }
