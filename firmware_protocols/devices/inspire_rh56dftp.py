r"""Inspire RH56DFTP: a hand with 1062 tactile points in seventeen matrices, over Modbus RTU, EB 90 or Modbus TCP.

Wire: RS-485, 115200 8N1, answers to its own unit after 6 to 14 ms: Modbus RTU, or with the option ``line=native`` the
vendor's own protocol. Or Modbus TCP on port 6000, where the unit selects nothing and the answer repeats it. Modbus
functions are 03, 06, 16. All protocols have the same registers.

    native  read   EB 90 unit 04  11 address n    sum    ->  90 EB unit n+3 11 address data sum
            write  EB 90 unit n+3 12 address data sum    ->  90 EB unit 04  12 address 01   sum

Native numbers are low byte first, the address too; the sum is the low byte of the sum from the unit on, and at most
252 bytes fit. A refused request gets no answer. A save (1005) gets a second answer a second later, with 00 for 01.

Addresses count *bytes*: reading n Modbus registers at A gives bytes A .. A + 2 n - 1, and the register at A is byte A
(low) and byte A + 1 (high). So two neighbouring matrices of 16-bit values are read by advancing 2 addresses per
register. One driver reads one register per address and gets, after the matrix, the memory behind it.

Touch, int16 0..4096, row by row from the first:

    3000     little finger: tip 3x3 (+0, 18 bytes), top 12x8 (+18, 192), pad 10x8 (+210, 160)
    3370     ring finger, the same
    3740     middle finger, the same
    4110     index finger, the same
    4480     thumb: tip 3x3, top 12x8 (4498), middle 3x3 (4690), pad 12x8 (4708)
    4900     palm 8x14, until 5123: column by column from the bottom, each from row 8 up to row 1

Six values are little, ring, middle, index, thumb bend, thumb turn. All other addresses below 6000 read zero (drivers
read register 0 to detect the hand). Published drivers disagree which of two actuators is in the high byte of a register
at 1606, 1612 and 1618: Unitree's takes the first, others the second (option ``first_byte``). The native protocol reads
these as bytes, the first one first.

Firmwares differ, according to a driver that works around them: over TCP the transaction of an answer is one too high
(option ``id_error``), and a connection opened within 300 ms of the last one's end gets no answers (``reconnect_s``). A
hand stops if its answers are not read; the fault ``hang`` does that at a time of your choice.

Try it: ``tactemu run inspire_rh56dftp --port tcp:127.0.0.1:6000``, then ``RH56DFTP_TCP(host, 6000).get(...)``; or
``tactemu run inspire_rh56dftp line=native``, then ``RH56Driver(port).connect()`` of pyrh56.
"""

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    Column, Counts, Device, Motors, Option, Reading, Registers, Rs485, Sense, Sent, Tcp, Transmissions, command_table,
    fact_table, points,
)  # fmt: skip
from firmware_protocols.devices.inspire_memory import BAUDS, FINGER_BASES_M, MAP, TOUCH_ADDRESS, matrices
from firmware_protocols.protocols.eb90 import Eb90
from firmware_protocols.protocols.modbus import Banks, Mbap, Rtu, silence_ns

FUNCTIONS = (3, 6, 16)
ORDER_REGISTERS = ("clear_errors", "save", "restore", "zero_force")
GRAMS_PER_NEWTON = 1000 / 9.80665
OPEN_ANGLE = 1000.0
CLOSED_POSITION = 2000
MAX_TOUCH_COUNTS = 4096
FULL_STROKE_S = 0.6
STROKE_RAD = 1.6
MOVING_MA = 200
MAX_FORCE_G = 3000
LEVER_M = 0.07
STATUS_AT_FORCE = 3
MAX_CURRENT_MA = 2000
STRENGTH_NM = MAX_FORCE_G / GRAMS_PER_NEWTON * LEVER_M

ACTUATORS = ("little", "ring", "middle", "index", "thumb bend", "thumb turn")


_READ = (
    "plusml-rh56dftp 0.1.7 RH56DFTP/, ftp_registers.py; inspire-rh56dftp 0.1.0 client.py, registers.py, scheduler.py; "
    "pyrh56 0.4.0 driver.py, protocol.py, registers.py"
)

OVER_TCP = command_table(
    """
    ? angles, unit 0  00 01 00 00 00 06 00 03 06 0A 00 06  00 01 00 00 00 0F 00 03 0C ..{12}
    ? palm, unit 255  00 01 00 00 00 06 FF 03 13 24 00 70  00 01 00 00 00 E3 FF 03 E0 ..{224}
    """,
    port="tcp",
    origin="vendor manual 2.6.20; inspire-rh56dftp 0.1.0 client.py",
)
COMMANDS_BY_LINE = {
    "modbus": command_table(
        """
        ? unit                                  01 03 03 E8 00 01 04 7A        01 03 02 00 01 79 84
        ? presence                              01 03 00 00 00 01 84 0A        01 03 02 00 00 B8 44
        ? tip of the index finger               01 03 10 0E 00 09 E0 CF        01 03 12 ..{18} ..{2}
        ? palm                                  01 03 13 24 00 70 00 A1        01 03 E0 ..{224} ..{2}
        ? forces                                01 03 06 2E 00 06 A5 49        01 03 0C ..{12} ..{2}
        ? angles                                01 03 06 0A 00 06 E5 42        01 03 0C ..{12} ..{2}
        ? IP address                            01 03 06 A4 00 02 85 60        01 03 04 A8 C0 D2 0B C7 08
        clear errors                            01 06 03 EC 00 01 89 BB        =
        zero the forces                         01 06 03 F1 00 01 19 BD        =
        save                                    01 06 03 ED 00 01 D8 7B        =
        bend the little finger                  01 06 05 CE 01 F4 E8 EE        =
        six angles  01 10 05 CE 00 06 0C 03 E8 03 20 02 58 01 90 00 C8 00 00 C5 F5  01 10 05 CE 00 06 21 38
        read coils: illegal function            01 01 00 00 00 08 3D CC        01 81 01 81 90
        mask write: illegal function            01 16 05 CE 00 00 00 01 5E 43  01 96 01 8E 60
        ? read beyond the map: illegal address  01 03 17 6F 00 01 B1 A3        01 83 02 C0 F1
        write a reading: illegal address        01 06 0B B8 00 01 CA 0B        01 86 02 C3 A1
        ? read too much: illegal value          01 03 0B B8 00 7E 47 EB        01 83 03 01 31
        angle out of range: illegal value       01 06 05 CE 03 E9 29 87        01 86 03 02 61
        """,
        port="rtu",
        origin="register map of the vendor manual 2.4, 2.6; CRC by pymodbus 3.11",
    ),
    "native": command_table(
        """
        ? unit                     EB 90 01 04 11 E8 03 01 02     90 EB 01 04 11 E8 03 01 02
        ? tip of the index finger  EB 90 01 04 11 0E 10 12 46     90 EB 01 15 11 0E 10 ..{18} ..
        ? palm                     EB 90 01 04 11 24 13 E0 2D     90 EB 01 E3 11 24 13 ..{224} ..
        ? angles                   EB 90 01 04 11 0A 06 0C 32     90 EB 01 0F 11 0A 06 ..{12} ..
        ? status                   EB 90 01 04 11 4C 06 06 6E     90 EB 01 09 11 4C 06 ..{6} ..
        bend fingers  EB 90 01 0F 12 CE 05 E8 03 20 03 58 02 90 01 C8 00 00 00 B6  90 EB 01 04 12 CE 05 01 EB
        clear errors               EB 90 01 04 12 EC 03 01 07     90 EB 01 04 12 EC 03 01 07
        save                       EB 90 01 04 12 ED 03 01 08     90 EB 01 04 12 ED 03 01 08, 90 EB 01 04 12 ED 03 00 07
        ? unit 2                   EB 90 02 04 11 E8 03 01 03
        ? beyond the map           EB 90 01 04 11 70 17 01 9E
        position out of range      EB 90 01 05 12 C2 05 D1 07 B7
        """,
        port="rtu",
        origin="vendor manual PRJ-02-TS-U-001 2.4; pyrh56 0.4.0 rh56_sdk/protocol.py",
    ),
}
"""The requests to a hand with unit 1, by the protocol of its line."""


class InspireRh56dftp(Device):
    """A hand with tactile matrices, and actuators that follow their commands."""

    name = "inspire_rh56dftp"
    title = "Inspire RH56DFTP hand, tactile version"
    kind = "hand"
    senses = ("force", Sense("temperature", at=points({"motors": (0.0, 0.0, 0.0)}, link="palm")))
    rate_hz = 50.0
    evidence = ("vendor document", "driver")
    sources = (
        "vendor manual PRJ-02-TS-U-001 V1.0.0 2.4, 2.6, 2.6.20 (in NaCl-1374/inspire_hand_ws@fc75490 inspire_R1)",
        "NaCl-1374/inspire_hand_ws@fc75490 inspire_hand_defaut.py (tactile map)",
        "plusml-rh56dftp 0.1.7 Register/config/configFTP/ftp_registers.py (both maps)",
        "inspire-rh56dftp 0.1.0 client.py, registers.py (numbers high byte first on the wire; the batches of reads)",
        "pyrh56 0.4.0 rh56_sdk/protocol.py, registers.py (native frames)",
        "Modbus application protocol V1.1b3; Modbus over serial line V1.02",
        "correlllab/rh56_controller@e4ef2568 experiment_data (recordings of force stops)",
    )
    judge = "plusml-rh56dftp 0.1.7, inspire-rh56dftp 0.1.0, pyrh56 0.4.0, pymodbus 3.11.3, modbus_tk 1.1.5"
    documented_with = None
    facts = fact_table(f"""
        stated touch: the matrices, their sizes and addresses; values are 0..4096 @ inspire-rh56dftp 0.1.0
            registers.py:28, plusml-rh56dftp 0.1.7 ftp_registers.py
        stated touch: over TCP numbers are sent high byte first @ inspire-rh56dftp 0.1.0 client.py:265 (tried on a hand)
        assumed touch: places of the points: all matrices lie in one plane with normal +z; the pitch is 1.5 mm on the
            fingers and 4 mm on the palm @ {_READ}
        assumed touch: 1000 counts/N; the force of a finger is the sum over its matrices @ {_READ}
        stated configuration: status 3 means that a finger stands at its force limit; a save gets one answer at once and
            one a second later @ pyrh56 0.4.0 rh56_sdk/registers.py:66, driver.py:547
        assumed configuration: unit and line speed change at the next power-up, if saved; register 1002 takes both 3 and
            4 for 921600, as the sources differ @ {_READ}
        assumed configuration: writes outside the table get exception 2, values out of range exception 3; addresses
            above 5999 get no answer; error registers stay 0 @ {_READ}
        assumed configuration: force limits have an effect only with option `stop_s`, and are checked once per
            conversion; gestures are stored without effect; the line has only the protocol it is delivered with; a save
            never fails @ {_READ}
        assumed configuration: in a physics engine force limits act {LEVER_M * 1000.0:.0f} mm from each joint, and
            {MAX_FORCE_G} g correspond to {MAX_CURRENT_MA} mA; a finger gives way by 0.3 rad at that force @ {_READ}
        measured timing: a finger begins to move after 60 to 70 ms, and stops after 27 ms, at 1729 g at most (an
            RH56DFX) @ correlllab/rh56_controller@e4ef2568 experiment_data
        stated timing: of a hand that is polled faster, 21 to 97 % of a pad's frames repeat the one before, which gives
            50 conversions a second @ ojas-mediratta/InspireHand-Tactile-Sensing@5d0a83d3
        assumed timing: a full stroke is 1.6 rad and takes 0.6 s at speed 1000; it begins at once; a moving motor draws
            200 mA; requests over TCP are answered at once @ {_READ}
    """)

    def __init__(
        self,
        *,
        unit: Annotated[int, Option("unit as delivered; register 1000 holds it", low=1, high=254)] = 1,
        baud: Annotated[
            Literal[115200, 57600, 19200, 921600], Option("line speed as delivered; register 1002 holds it")
        ] = 115200,
        counts_per_newton: Annotated[float, Option("tactile counts along a point's normal", unit="1/N")] = 1000.0,
        line: Annotated[Literal["modbus", "native"], Option("protocol of the RS-485 line")] = "modbus",
        first_byte: Annotated[
            Literal["low", "high"], Option("byte of a Modbus register that holds the first of two byte registers")
        ] = "low",
        answer_s: Annotated[
            float, Option("time from a request on the line to its answer; hands take 6 to 14 ms", unit="s", low=0.0)
        ] = 0.006,
        id_error: Annotated[int, Option("added to the transaction of TCP answers", low=0, high=1)] = 0,
        stop_s: Annotated[
            float | None,
            Option("time to the stop of a finger beyond its force limit; None: no limits", unit="s", low=0.0),
        ] = None,
        strongest_g: Annotated[
            float | None, Option("force at which an actuator stops, with `stop_s`; a hand: 1729", unit="g", low=1.0)
        ] = None,
        reconnect_s: Annotated[
            float, Option("time after a TCP connection's end when a new one gets no answers", unit="s", low=0.0)
        ] = 0.0,
    ):
        self.answer_ns = round(answer_s * 1e9)
        self.stop_ns = None if stop_s is None else round(stop_s * 1e9)
        self.strongest_g = np.inf if strongest_g is None else strongest_g
        self.id_error, self.reconnect_ns = id_error, round(reconnect_s * 1e9)
        self.closed_ns, self.unheard = -self.reconnect_ns, set[str]()
        self.pairs_swapped = {"tcp": first_byte == "high", "rtu": first_byte == "high" and line == "modbus"}
        """True, by port, if the second of two byte registers comes first."""
        self.swapped = False
        self.columns = (
            Column(name="touch", unit="N", counts_per_unit=counts_per_newton, low=0, high=MAX_TOUCH_COUNTS, push=1),
        )
        self.layout = matrices()
        self.registers = Registers(MAP, kept={"unit": unit, "baud": BAUDS.index(baud), **self.flash})
        self.registers["speed_set"] = self.registers.all("speed_default")
        self.registers["force_set"] = self.registers.all("force_default")
        self.unit, speed = self.registers["unit"], BAUDS[self.registers["baud"]]
        self.documented = (*COMMANDS_BY_LINE[line], *OVER_TCP) if self.unit == 1 else ()
        self.ports = (Rs485(name="rtu", baud=speed), Tcp(name="tcp", port=6000, is_plugged=False))
        self.rtu = Rtu(counters=self.counters, gap_ns=silence_ns(speed))
        self.native = Eb90(counters=self.counters) if line == "native" else None
        self.clients: dict[str, Mbap] = {}
        self.motors = Motors(
            [OPEN_ANGLE] * 6, low=0.0, high=OPEN_ANGLE, time_constant_s=0.0, speed_limit=self._speeds(),
            names=ACTUATORS, unit=-STROKE_RAD / OPEN_ANGLE, zero=OPEN_ANGLE, strength=STRENGTH_NM, deflection=0.3,
        )  # fmt: skip
        self._limit_forces()
        self.counts = np.zeros(len(self.layout), np.int64)
        self.forces = self.zero_forces = np.zeros(6)

    # -- readings --------------------------------------------------------------------------------------------------

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return tactile counts 0..4096, shape ``(1062,)``, matrix by matrix, row by row."""
        self.counts = super().measure(reading, t_ns)["force"]
        forces_n = dict.fromkeys([*FINGER_BASES_M, "palm"], 0.0)
        for patch in self.layout.patches:
            forces_n[patch.link] += self.present[patch.taxels].sum()
        self.forces = np.array([*list(forces_n.values())[:-1], 0.0]) * GRAMS_PER_NEWTON
        if self.stop_ns is not None:
            self._stop(t_ns, self.stop_ns)
        self.registers["temperature"] = reading["temperature"][0]
        return self.counts

    def _stop(self, t_ns: int, stop_ns: int) -> None:
        """Stop actuators above their force limit after a while; stop those at their greatest force at once.

        So a force that grows by k with the angle, at a speed v, ends at most at limit + k v (stop + conversion).
        """
        forces, now = self.forces - self.zero_forces, self.motors.positions(t_ns)
        ends = np.where(forces >= self.strongest_g, now, self.motors.positions(t_ns + stop_ns))
        over = (forces > np.array(self.registers.all("force_set"))) & (self.motors.goals < now)
        if over.any():
            self.motors.go(np.where(over, ends, np.nan), t_ns)

    # -- requests --------------------------------------------------------------------------------------------------

    def lines(self, dtr: bool, rts: bool, t_ns: int, port: str) -> Transmissions:
        """Start a new connection with a new request; mark it as unheard if it comes too soon."""
        self.clients.pop(port, None)
        self.unheard.discard(port)
        if not dtr:
            self.closed_ns = t_ns
        elif port.startswith("tcp") and t_ns - self.closed_ns < self.reconnect_ns:
            self.unheard.add(port)
        return ()

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Answer requests, which arrive in chunks of any size."""
        if port in self.unheard:
            self.counters["unheard"] += 1
            return ()
        self.swapped = self.pairs_swapped[port.partition("/")[0]]
        if port == "rtu" and self.native:
            replies = self.native.answers(data, t_ns, self.unit, self)
            return [Sent(reply.frame, delay_ns=self.answer_ns + reply.delay_ns) for reply in replies]
        banks = Banks(holding=self, step=1, low_first=True, functions=FUNCTIONS)
        if port == "rtu":
            answers = self.rtu.answers(data, t_ns, {self.unit: banks})
            return [Sent(answer, delay_ns=self.answer_ns) for answer in answers]
        client = self.clients.setdefault(port, Mbap(counters=self.counters, id_error=self.id_error))
        return client.answers(data, t_ns, banks)

    def read(self, address: int, n: int, t_ns: int) -> bytes:
        """Return memory as the hand reports it at ``t_ns``."""
        if address < TOUCH_ADDRESS:
            self._report(t_ns)
        if address + n > TOUCH_ADDRESS:
            self.registers["touch"] = self.layout.on_wire(self.counts)
        return self.registers.read(address, n)

    def _report(self, t_ns: int) -> None:
        """Update the registers of the actuators."""
        registers, angles, moving = self.registers, self.motors.positions(t_ns), self.motors.moving(t_ns)
        registers["angle"] = angles
        registers["position"] = CLOSED_POSITION - 2 * angles
        registers["force"] = self.forces - self.zero_forces
        motors, share = self.motors, np.abs(self.motors.forces) / STRENGTH_NM
        registers["current"] = MAX_CURRENT_MA * share if motors.is_in_engine else MOVING_MA * moving
        held = motors.stalled & motors.is_in_engine
        status = np.select([held, ~moving, motors.goals < angles], [STATUS_AT_FORCE, 2, 1], 0)
        registers["status"] = status.reshape(-1, 2)[:, ::-1].ravel() if self.swapped else status

    def write(self, address: int, data: bytes, t_ns: int) -> Sequence[str]:
        """Store what the host writes, and execute its orders."""
        written = self.registers.write(address, data)
        if "position_set" in written:
            self.motors.go((CLOSED_POSITION - self._given("position_set")) / 2, t_ns)
        if "angle_set" in written:
            self.motors.go(self._given("angle_set"), t_ns)
        if "speed_set" in written:
            self.motors.limit_speed(self._speeds(), t_ns)
        if "force_set" in written:
            self._limit_forces()
        self._obey({order for order in ORDER_REGISTERS if self.registers[order]})
        return written

    def _given(self, name: str) -> np.ndarray:
        """Return the targets in a register, NaN for an actuator that stays."""
        values = np.array(self.registers.all(name), float)
        return np.where(values < 0, np.nan, values)

    def _speeds(self) -> np.ndarray:
        """Return the speed limits of the actuators [angle counts per second]."""
        return np.array(self.registers.all("speed_set")) / FULL_STROKE_S

    def _limit_forces(self) -> None:
        self.motors.limit_force(np.array(self.registers.all("force_set")) / MAX_FORCE_G)

    def _obey(self, orders: set[str]) -> None:
        """Execute the orders that read 1, and reset them to 0."""
        for order in orders:
            self.registers[order] = 0
        if "restore" in orders:
            self.registers.reset(*self.registers.kept())
        if "zero_force" in orders:
            self.zero_forces = self.forces
        if "save" in orders:
            self.flash.update(self.registers.kept())
