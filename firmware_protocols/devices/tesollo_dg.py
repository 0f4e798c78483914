"""Tesollo DG-3F M, DG-4F, DG-5F and DG-5F-S: a hand with a force-torque sensor or a tactile matrix in each fingertip.

Wire: TCP port 502, no Modbus. ``PACKET`` in both directions, high byte first, without a sum; the hand only answers.

    command  data                        answer
    01       codes of the parts          the parts in this order: a record for each motor, fingertips, inputs
    05       (motor, duty >i2) each      none; duty in 0.1 %
    06       three outputs, 00 or 01     none
    08       -                           ``VERSION``
    0B       -                           none; what the force-torque sensors measure now becomes zero

Codes: 01 position, 02 current, 03 temperature, 04 velocity, 05 fingertips, 06 inputs and outputs. A record has the
number of its motor, then the parts requested, as in ``MOTOR``. The driver reads as many bytes as it expects from the
answer to 08, and closes after 500 ms without them.

Evidence: the vendor's library, its README, and the vendor's ROS node on top of it.

Try it: ``tactemu run tesollo_dg``, then send 00 03 08.
"""

from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    Column, CountsPerNewton, Device, Frame, Motors, Option, Packets, Refused, Request, Sense, Tcp, Transmissions,
    command, fact_table, grid_layout, on_fingers, points, wrench,
)  # fmt: skip

PACKET = Frame("""
    packet, either direction
    0     >u2             length = total
    2     u1              command
    3     bytes           data
""")
VERSION = Frame("""
    answer to 08
    0     >u2             model
    2     u1 x 2          firmware
    4     u1              sensor
    5     u1              fingers      bit 0: the first has a sensor
""")
MOTOR = Frame("""
    motor
    0     u1              id           from 1
    1     >i2 clip        position     [0.1 deg], DG-5F-S: [0.01 deg]
    3     >i2 clip        current      [mA]
    5     >i2             temperature  [0.1 deg C]
    7     i1 clip         velocity     [rpm]
""")
TIPS = (
    Frame("""
        force-torque sensors, the first finger first
        0     >i2 x taxels x 6  values   Fx Fy Fz [0.1 N], Tx Ty Tz [1 mNm]
    """),
    Frame("""
        tactile M, row by row
        0     u1 x taxels       values   cells
    """),
    Frame("""
        tactile S, row by row
        0     >u2 x taxels      values   cells
    """),
)
PARTS = {1: slice(1, 3), 2: slice(3, 5), 3: slice(5, 7), 4: slice(7, 8)}
"""The bytes of a motor's record by code."""
FINGERTIPS, OUTPUTS = 5, 6
HANDS = {"DG-3F M": (0x3F02, 3, 12), "DG-4F": (0x4F02, 4, 18), "DG-5F": (0x5F02, 5, 20), "DG-5F-S": (0x5F04, 5, 20),
         "DG-5F-S15": (0x5F24, 5, 15)}  # fmt: skip
"""The model's number, which for five fingers grows by that of the side; its fingers and motors."""
SIDES = {"left": 0x10, "right": 0x20}
SENSORS = {"6-axis": 1, "3-axis": 2, "tactile_m": 3, "4-axis": 4, "tactile_s": 5}
ROWS = {"tactile_m": (5, 0xFF, 1), "tactile_s": (6, 0xFFFF, 2)}
"""The rows of a matrix, its largest number, its table."""
TORQUES = {"6-axis": (1, 1, 1), "3-axis": (0, 0, 0), "4-axis": (0, 0, 1)}
"""The torques that a force-torque sensor measures; the others are 0."""
FULL_SPEED_DEG_PER_S = 400.0
LIBRARY = "tesollodelto/dg_tcp_comm@cacd02f"
CPP, HPP = f"{LIBRARY} src/delto_developer_TCP.cpp", f"{LIBRARY} include/delto_tcp_comm/delto_developer_TCP.hpp"
NODE = "tesollodelto/dg_hardware@d32367e src/system_interface.cpp"
ALL = "README.md, delto_developer_TCP.cpp, delto_developer_TCP.hpp, system_interface.cpp (all whole)"


class TesolloDg(Device):
    """A hand that is polled over TCP."""

    name = "tesollo_dg"
    kind = "hand"
    ports = (Tcp(port=502),)
    rate_hz = 500.0
    evidence = ("vendor document", "driver")
    sources = (f"{LIBRARY} README.md (parts, units)", f"{CPP} (packets, order)", f"{NODE} (images, duty)")
    judge = f"{LIBRARY}"
    origin = f"{CPP}, request written out; README.md"
    documented_with = ("counts_per_newton",)
    facts = fact_table(f"""
        stated touch: units are 0.1 N and 1 mNm; a finger has 15 bytes or 18 words @ {LIBRARY} README.md:100-109
        stated touch: axes that are not connected still have a place in the record @ {HPP}:71-74
        stated touch: values are sent high byte first; all fingers are sent, whatever the mask @ {CPP}:125-127, 526-563
        stated touch: cells are sent row by row, in 5 or 6 rows of 3 @ {NODE}:716-736
        assumed touch: row 0 is towards the tip; cells are 3 mm apart, with 50 counts/N; the places of the fingertips,
            which are touched 12 mm above and 3 mm beside the origin of their sensor; z points out of the pad @ {ALL}
        stated identity: the model, the firmware, the kind of sensor, and the mask @ {CPP}:346-353
        stated identity: the numbers of models and kinds of sensors, and their motors and fingers @ {HPP}:44-75;
            {CPP}:47-102
        assumed identity: firmware 1.0 @ {ALL}
        stated configuration: a duty is -100 % to 100 % in steps of 0.1 %; motors are numbered from 1 @ {NODE}:794-795;
            {CPP}:585-598
        stated configuration: code 0B is for force-torque sensors only @ {CPP}:630-641
        assumed configuration: a motor turns at {FULL_SPEED_DEG_PER_S:g} deg/s at full duty, between -90 and 90 deg,
            draws 1 mA per 0.1 % and stays at 25.0 deg C; outputs can be read back, the input is 0; parts that are not
            requested, and unknown codes, take no bytes; packets of other lengths get no answer @ {ALL}
        stated timing: TCP port 502 @ {NODE}:90; the driver waits 3000 ms for 08 and 500 ms for 01 @ {CPP}:334, 419
        assumed timing: 500 conversions a second @ {ALL}
    """)

    def __init__(
        self,
        *,
        hand: Annotated[Literal["DG-3F M", "DG-4F", "DG-5F", "DG-5F-S", "DG-5F-S15"], Option("model")] = "DG-5F",
        side: Annotated[Literal["left", "right"], Option("side, of a hand with five fingers")] = "right",
        sensor: Annotated[
            Literal["6-axis", "3-axis", "4-axis", "tactile_m", "tactile_s"], Option("the sensor in each fingertip")
        ] = "6-axis",
        counts_per_newton: CountsPerNewton = 50.0,
    ):
        self.title = f"Tesollo {hand}, {sensor.replace('_', ' ')} fingertips"
        self.number, fingers, motors = HANDS[hand]
        self.number += SIDES[side] * (fingers == 5)
        self.sensor = SENSORS[sensor]
        names = ("thumb", "index", "middle", "ring", "little")[:fingers]
        if sensor in ROWS:
            rows, high, tips = ROWS[sensor]
            self.layout = on_fingers(grid_layout(rows, 3, 0.003), *names)
            self.columns = (Column(name="cell", low=0, high=high, assumed_per_unit=counts_per_newton, push=1),)
        else:
            self.layout, tips = on_fingers(points({"": (0, 0.003, 0.012)}), *names), 0
            self.senses = (Sense("wrench", at=on_fingers(points({"": (0, 0, 0)}), *names)),)
            low, high = ([end * on for on in (1, 1, 1, *TORQUES[sensor])] for end in (-0x8000, 0x7FFF))
            self.columns = wrench("Fx Fy Fz Tx Ty Tz", per_unit=(10, 1000), low=low, high=high)
        self.tips = TIPS[tips].bind(wire_order=self.layout.wire_order)
        self.per_degree = 100.0 if "-S" in hand else 10.0
        self.motors = Motors(np.zeros(motors), low=-90, high=90, time_constant_s=0)
        self.duty, self.outputs = np.zeros(motors), bytes(3)
        self.packets = Packets(PACKET, by="command", counters=self.counters, max_data=3 * motors)

    def lines(self, dtr: bool, rts: bool, t_ns: int, port: str) -> Transmissions:
        """Drop the incomplete request of a client that comes or goes."""
        self.packets.reset()
        return ()

    def reply(self, request: Request, content: bytes) -> Transmissions:
        """Return a packet with the command of the request."""
        return [PACKET.pack(command=request.command, data=content)] if content else ()

    @command("00 09 01 01 02 03 04 05 06", "00 E3 01 01 ..{219} 00 00 00 00", data="*", safe=True, within_ms=500)
    def data(self, request: Request) -> bytes:
        """Return the parts that were requested."""
        parts = [PARTS[code] for code in request.data if code in PARTS]
        degrees, speeds = self.motors.positions(request.t_ns), self.motors.velocities(request.t_ns)
        records = [
            MOTOR.pack(
                id=k, position=round(at * self.per_degree), current=int(duty), temperature=250, velocity=round(v)
            )
            for k, (at, v, duty) in enumerate(zip(degrees, speeds / 6, self.duty), 1)
        ]
        content = b"".join(record[:1] + b"".join(record[part] for part in parts) for record in records if parts)
        if FINGERTIPS in request.data:
            content += self.tips.pack(values=self.counts)
        return content + (self.outputs + b"\0") * (OUTPUTS in request.data)

    @command("00 3F 05" + "".join(f" {k:02X} 00 00" for k in range(1, 21)), name="duty 0", data="*")
    def drive(self, request: Request) -> None:
        """Turn each motor by its duty."""
        if len(request.data) != 3 * len(self.duty):
            raise Refused("value")
        self.duty = np.frombuffer(request.data, np.dtype([("id", "u1"), ("duty", ">i2")]))["duty"].astype(float)
        self.motors.drive(np.clip(self.duty / 1000, -1, 1) * FULL_SPEED_DEG_PER_S, request.t_ns)

    @command("00 06 06 01 00 00", name="output 1 on")
    def set_outputs(self, request: Request) -> None:
        """Set the three outputs."""
        self.outputs = bytes(each & 1 for each in request.data)

    @command("00 03 08", "00 09 08 5F 22 01 00 01 1F", safe=True, within_ms=3000)
    def version(self, request: Request) -> bytes:
        """Return model, firmware and sensors."""
        mask = (1 << len(self.layout.links)) - 1
        return VERSION.pack(model=self.number, firmware=[1, 0], sensor=self.sensor, fingers=mask)

    @command("00 03 0B")
    def zero_fingertips(self, request: Request) -> None:
        """Take the present forces and torques as zero."""
        if self.tips.name == TIPS[0].name:
            self.zero = self.present
