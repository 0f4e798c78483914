r"""ROBOTIS HX5-D20: a hand of twenty motors with nine pressures on each fingertip, behind one controller.

Wire: RS-485 (or USB), 4 000 000 8N1, packets as in :mod:`firmware_protocols.protocols.dynamixel`. The controller is 110
in a right hand, 140 in a left one. Behind it, and answering by themselves, are five fingers from the thumb on: four
motors, DYNAMIXEL XC335-T332, and a sensor each, 111..115 to 131..135 (141..145 to 161..165).

While ``sync`` is 1 the controller polls them, and shows their data in five tables of 198 bytes, from 1024 on:

    offset  bytes   content
    0       6       ids of six nodes
    6       12, 12  address to read from each, and number of bytes
    30      12, 12  address to write in each, and number of bytes
    54      72      data read, one node after the other
    126     72      data to write, one node after the other

Four motors of 6 bytes (current, velocity [0.02397 rad/s], position [0.001534 rad, 2048 is 0], int16 each) and nine
pressures 0..255, row by row: these are at 1102, 1300, 1498, 1696 and 1894. Goals of a motor are current and position.
The motors show these at 224..229 and take the goals at 230..233, by their indirect addresses 126 127 128 129 132 133
and 102 103 116 117. The vendor's driver reboots all nodes, writes 0 to ``sync``, fills tables and indirect addresses,
writes 1, and then reads and writes by the controller's own indirect addresses: byte k of ``read_data`` (634) is that at
the k-th address of ``read_places`` (122), ``write_data`` (799) goes to ``write_places`` (452).

    ping            FF FF FD 00 6E 03 00 01 08 82                FF FF FD 00 6E 07 00 55 00 04 01 01 EA 32
    thumb           FF FF FD 00 6E 07 00 02 4E 04 09 00 19 42    FF FF FD 00 6E 0D 00 55 00 ..{9} ..{2}

Try it: ``tactemu run robotis_hx5``, then ``PacketHandler(2.0).readTxRx(port, 110, 1102, 9)`` of ``dynamixel_sdk``.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np

from firmware_protocols import (
    Column, Counts, Device, Motors, Option, Reading, Rollover, Rs485, Sent, Transmissions, command_table,
    fact_table, grid_layout, on_fingers, quantize,
)  # fmt: skip
from firmware_protocols.devices.robotis_hx5_nodes import (
    CONTROLLER_TABLE, FINGERS, MIDDLE_COUNTS, MOTORS_PER_FINGER, MOTOR_TABLE, RAD_PER_COUNT, SENSOR_TABLE, Controller,
    Motor, Node, Sensor,
)  # fmt: skip
from firmware_protocols.protocols.dynamixel import DynamixelLine

DHI = "ROBOTIS-GIT/dynamixel_hardware_interface@db2b903 "
MODELS_AT = "param/dxl_model"
HAND = "ROBOTIS-GIT/robotis_hand@d59e479 robotis_hand_description/ros2_control/hx5_d20_rev2/*.xacro"
LOOKED = f"{DHI}src, scripts, {MODELS_AT}; ROBOTIS-GIT/robotis_hand@d59e479 (all); ROBOTIS-GIT/DynamixelSDK@2ded684d"


class RobotisHx5(Device):
    """A hand with its controller, motors and sensors on one line."""

    name = "robotis_hx5"
    tables = (CONTROLLER_TABLE, MOTOR_TABLE, SENSOR_TABLE)
    """The control tables of its nodes."""
    kind = "hand"
    title = "ROBOTIS HX5-D20 hand, five tips of 3x3"
    ports = (Rs485(baud=4_000_000),)
    rate_hz = 1000.0
    rollovers = (Rollover(name="tick", bits=16, step=1000, clock=True, state="tick"),)
    evidence = ("driver",)
    sources = (
        f"{DHI}src/dynamixel_hardware_interface.cpp, src/dynamixel/dynamixel.cpp, {MODELS_AT}/*.model",
        f"{HAND}",
        "howon720/robotis_hand_hx5_d20@00b3a75 tactile_sensor.cpp (order of the cells)",
        "dynamixel-sdk 4.1.0 protocol2_packet_handler.py",
    )
    judge = "ROBOTIS-GIT/dynamixel_hardware_interface@db2b903, dynamixel-sdk 4.1.0"
    documented = command_table(
        """
        ? ping                          6E 03 00 01 08 82                    6E 07 00 55 00 04 01 01 EA 32
        ? ping the index's first motor  74 03 00 01 0E 4A                    74 07 00 55 00 A4 06 01 ..{2}
        ask the fingers                 6E 06 00 03 46 00 01 53 0F           6E 04 00 55 00 09 1F
        thumb  6E 06 00 03 46 00 01 53 0F; 6E 07 00 02 4E 04 09 00 19 42  6E 0D 00 55 00 ..{9} ..{2}
        index  6E 06 00 03 46 00 01 53 0F; 6E 07 00 02 14 05 09 00 15 8A  6E 0D 00 55 00 ..{9} ..{2}
        middle  6E 06 00 03 46 00 01 53 0F; 6E 07 00 02 DA 05 09 00 34 D2  6E 0D 00 55 00 ..{9} ..{2}
        ring  6E 06 00 03 46 00 01 53 0F; 6E 07 00 02 A0 06 09 00 1F 1A  6E 0D 00 55 00 ..{9} ..{2}
        little  6E 06 00 03 46 00 01 53 0F; 6E 07 00 02 66 07 09 00 2A E2  6E 0D 00 55 00 ..{9} ..{2}
        ? sync read                     FE 08 00 82 4E 04 09 00 6E 48 BF     6E 0D 00 55 00 ..{9} ..{2}
        ? fast sync read                FE 08 00 8A 4E 04 09 00 6E 41 FF     FE 0E 00 55 00 6E ..{9} ..{2}
        ? bulk read                     FE 08 00 92 6E 4E 04 09 00 C4 8F     6E 0D 00 55 00 ..{9} ..{2}
        ? fast bulk read                FE 08 00 9A 6E 4E 04 09 00 CD CF     FE 0E 00 55 00 6E ..{9} ..{2}
        sync write                      FE 09 00 83 46 00 01 00 6E 01 1D AD
        bulk write                      FE 09 00 93 6E 46 00 01 00 01 37 13
        LED                             6E 06 00 03 41 00 01 3C 8F           6E 04 00 55 00 09 1F
        write the model: access         6E 06 00 03 00 00 01 28 8A           6E 04 00 55 07 18 9F
        ? read beyond: range            6E 07 00 02 DA 07 09 00 1F 52        6E 04 00 55 04 12 9F
        sync 2: value                   6E 06 00 03 46 00 02 59 0F           6E 04 00 55 06 1D 1F
        reboot                          6E 03 00 08 3E 82                    6E 04 00 55 00 09 1F
        factory reset: instruction      6E 04 00 06 FF 0E 77                 6E 04 00 55 02 06 9F
        """,
        head="FF FF FD 00",
        origin="hx5_d20_rr.model; packets by dynamixel-sdk 4.1.0",
    )
    facts = fact_table(f"""
        stated touch: each fingertip has nine raw bytes @ {DHI}{MODELS_AT}/hx5_d20_r_synctable_1_device_5.model
        stated touch: cells are numbered row by row, from the left and from the top @
            howon720/robotis_hand_hx5_d20@00b3a75 tactile_sensor.cpp
        assumed touch: pads of 3 x 3 cells at a pitch of 4 mm, all in one plane with normal +z; 50 counts/N @ {LOOKED}
        stated identity: the models 260 and 261, with nodes 110..135 and 140..165 @ {DHI}{MODELS_AT}/dynamixel.model:6;
            {HAND}:231
        stated identity: the motors are XC335-T332, model 1700: no other model has the items and addresses that the
            driver sets @ {HAND}:364 read with {DHI}{MODELS_AT}/xc335_t332.model and the other 90
        assumed identity: every node has firmware 1, and the sensors model number 0 @ {LOOKED}
        stated configuration: every node answers a reboot; the controller and the motors answer a ping @
            {DHI}src/dynamixel_hardware_interface.cpp:201
        stated configuration: the data of the slots follow one another @
            {DHI}scripts/hx_synctable_model_generator.py:178
        stated configuration: the slots, their sizes and indirect addresses @ {HAND}:236, 371
        assumed configuration: after power-up the slots are as the vendor's driver sets them, and sync is 0; a reboot
            takes no time @ {LOOKED}
        assumed configuration: tables do not change while sync is 0; goals are passed on while it is 1 @ {LOOKED}
        assumed configuration: with drive mode 8 a goal turns the torque on; offset, direction, profile and gains have
            no effect @ {LOOKED}
        assumed configuration: motors have positions 0..4095 and move at 6 rad/s; currents read 0, and goal currents
            have no effect @ {LOOKED}
        assumed configuration: watchdog, line speeds and protocol are stored without effect; voltages read 0; Modbus is
            not modelled @ {LOOKED}
        stated configuration: the errors are 2 instruction, 4 range, 6 value, 7 access @ dynamixel-sdk 4.1.0
            protocol2_packet_handler.py:52
        assumed configuration: which error is sent: 2 for an unknown instruction, 3 for a wrong CRC, 4 beyond the
            tables, 7 for a read-only item @ {LOOKED}
        assumed timing: 1000 conversions a second; the tick counts from power-up @ {LOOKED}
    """)

    def __init__(
        self,
        *,
        id: Annotated[Literal[110, 140], Option("id as delivered: 110 a right hand, 140 a left one")] = 110,
        counts_per_newton: Annotated[float, Option("raw counts along a cell's normal", unit="1/N")] = 50.0,
    ):
        self.counts_per_newton, self.hand = counts_per_newton, id
        self.columns = (Column(name="pressure", low=0, high=255, push=1),)
        self.layout = on_fingers(grid_layout(3, 3, 0.004))
        n = MOTORS_PER_FINGER * len(FINGERS)
        self.motors = Motors([MIDDLE_COUNTS] * n, low=0, high=4095, time_constant_s=0.02, speed_limit=6 / RAD_PER_COUNT)
        self.counts = np.zeros(len(self.layout), np.int64)
        self.nodes: list[Node] = []
        self.controller = Controller(*self._kept(id), self.nodes, self.counters)
        for k in range(len(FINGERS)):
            first = id + 1 + k * (MOTORS_PER_FINGER + 1)
            *motors, sensor = range(first, first + MOTORS_PER_FINGER + 1)
            self.nodes += [Motor(*self._kept(m), self.motors, MOTORS_PER_FINGER * k + m - first) for m in motors]
            self.nodes.append(Sensor(*self._kept(sensor)))
            self.controller.registers[f"ids_{k}"] = [*motors, sensor, 0]
        self.line = DynamixelLine(counters=self.counters)

    def _kept(self, ident: int) -> tuple[int, Mapping[str, Any]]:
        return ident, self.flash.get(str(ident), {})

    @property
    def tick(self) -> int:
        """The offset of the controller's clock [ms]."""
        return self.controller.tick

    @tick.setter
    def tick(self, tick: int) -> None:
        self.controller.tick = tick

    # -- what the runner asks --------------------------------------------------------------------------------------

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return raw pressures 0..255, shape ``(45,)``, thumb to little finger, row by row."""
        self.counts = quantize(self.layout.push(reading["force"]), self.counts_per_newton, 0, 255)
        tips = self.nodes[MOTORS_PER_FINGER :: MOTORS_PER_FINGER + 1]
        for sensor, cells in zip(tips, self.layout.on_wire(self.counts).reshape(-1, 9)):
            sensor.registers["pressures"] = cells
        return self.counts

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Answer packets, which arrive in chunks of any size."""
        nodes = [self.controller, *self.nodes]
        answers = self.line.answers(data, t_ns, nodes)
        for ident, node in enumerate(nodes, self.hand):
            if node.is_changed:
                self.flash[str(ident)], node.is_changed = node.registers.kept(), False
        return [Sent(answer.frame, delay_ns=answer.delay_ns, turn=answer.turn) for answer in answers]

    def joints(self, t_ns: int) -> Mapping[str, float]:
        """Return the angle of each motor from its middle [rad], by name."""
        angles = (self.motors.positions(t_ns) - MIDDLE_COUNTS) * RAD_PER_COUNT
        names = (f"{finger} {k}" for finger in FINGERS for k in range(1, MOTORS_PER_FINGER + 1))
        return dict(zip(names, angles.tolist()))
