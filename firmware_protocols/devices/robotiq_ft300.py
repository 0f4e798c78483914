"""Robotiq FT 300-S: a force-torque sensor with an accelerometer, between a robot's flange and its tool.

Wire: 19200 8N1. From power-up it sends ``STREAM``, until it receives 50 bytes FF in a row. It answers Modbus RTU, unit
9, functions 03 and 16, too; a register is two bytes of ``MAP``. 0200 in register 410 starts the stream.

    180..185  force and torque as in ``STREAM``    500..502  firmware: FTS and three numbers, a byte each
    190..192  acceleration                         510..513  serial number: FTS, 00, then low and high word
    410       stream                               514       year of production

Hosts that search for the sensor skip ports that any process has open. Few check the sum: a force that is 20 4E on the
wire (200 N) breaks a frame for drivers that split there.

Try it: ``tactemu run robotiq_ft300``, then ``FT300Stream(port, 1).get_force_torque_raw()``.
"""

from typing import Annotated, Any

from firmware_protocols import (
    Counts, Device, Frame, Option, Reading, RegisterMap, Registers, Sense, Serial, Tool, Transmissions, command_table,
    fact_table, points, xyz,
)  # fmt: skip
from firmware_protocols.protocols.modbus import Banks, Rtu, silence_ns

STREAM = Frame("""
    stream
    0     20 4E           head
    2     <i2 x 6         values  Fx Fy Fz [0.01 N], Mx My Mz [0.001 Nm]
    last  <crc16_modbus   crc
""")
MAP = RegisterMap("""
    360   >i2 x 6   wrench        r   register 180: Fx Fy Fz [0.01 N], Mx My Mz [0.001 Nm]
    380   >i2 x 3   acceleration  r   register 190: x y z [0.001 g]
    820   >u2       stream            register 410: 512 starts
    1000  u1 x 20   firmware      r   register 500
    1020  u1 x 4    letters       r   register 510
    1024  >u2 x 2   serial        r   register 512: low word, high word
    1028  >u2       year          r   register 514
""")
BAUD = 19200
UNIT = 9
SERIAL_LETTERS = tuple(b"FTS")
START_STREAM = 0x0200
STOP_BYTES = 50
STOP = STOP_BYTES * b"\xff"
INT16: dict[str, Any] = {"low": -0x8000, "high": 0x7FFF}
ORIGIN = points({"origin": (0.0, 0.0, 0.0)})
ROS = "ros-industrial-attic/robotiq@45196f6"
C = "secorolab/robotiq_ft@f63b3d8"
PYTHON = "ft300python 1.0.2"
COM = f"{ROS} robotiq_ft_sensor/src/rq_sensor_com.cpp"
ALL = "rq_sensor_com.cpp, rq_sensor_state.cpp, rq_sensor.cpp, ft300_modbusrtu.py, ft300_stream.py (all whole)"


class RobotiqFt300(Device):
    """A sensor of force and torque on a tool, streamed or polled."""

    name = "robotiq_ft300"
    kind = "force-torque sensor"
    title = "Robotiq FT 300-S force-torque sensor"
    ports = (Serial(baud=BAUD),)
    senses = (Sense("wrench", at=ORIGIN), Sense("acceleration", at=ORIGIN))
    columns = (
        *xyz("Fx Fy Fz", sense="wrench", unit="N", counts_per_unit=100.0, **INT16),
        *xyz("Mx My Mz", sense="wrench", unit="Nm", counts_per_unit=1000.0, **INT16),
        *xyz("ax ay az", sense="acceleration", unit="m/s²", counts_per_unit=1000 / 9.80665, **INT16),
    )
    evidence = ("driver",)
    sources = (
        f"{ROS} robotiq_ft_sensor (the vendor's C driver)",
        f"{C} src/rq_sensor_com.c (the same in C)",
        f"{PYTHON} ft300_modbusrtu.py, ft300_stream.py (acceleration)",
    )
    judge = f"{ROS}, {C}, {PYTHON}"
    documented = command_table(
        f"""
        @ {C}; CRC by pymodbus
        stop              {STOP.hex()}
        firmware          {STOP.hex()}; 09 03 01 F4 00 04 05 4F           09 03 08 46 54 53 ..{{3}} 00 00 ..{{2}}
        serial number     {STOP.hex()}; 09 03 01 FE 00 04 25 4D           09 03 08 46 54 53 00 ..{{4}} ..{{2}}
        @ {PYTHON}; CRC by pymodbus
        force and torque  {STOP.hex()}; 09 03 00 B4 00 06 84 A6           09 03 0C ..{{12}} ..{{2}}
        acceleration      {STOP.hex()}; 09 03 00 BE 00 03 64 A7           09 03 06 ..{{6}} ..{{2}}
        year              {STOP.hex()}; 09 03 02 02 00 01 25 3A           09 03 02 ..{{2}} ..{{2}}
        stream            {STOP.hex()}; 09 10 01 9A 00 01 02 02 00 CD CA  09 10 01 9A 00 01 21 52
        """
    )
    documented_with = None
    facts = fact_table(f"""
        stated touch: a frame is 20 4E, six numbers with their low byte first, and a CRC @ {COM}:406-431
        stated touch: forces are in 0.01 N, torques in 0.001 Nm @ {COM}:426, 431
        stated touch: accelerations are in 0.001 g; force and torque are also in registers @ {PYTHON} ft300_modbusrtu.py
        assumed touch: the tool is touched 50 mm above the origin; z points out of the tool side; forces act on the tool
            @ {ALL}
        assumed touch: values saturate at the limits of 16 bits @ {ALL}
        stated identity: the firmware version is three letters, then three numbers, one byte each @ {COM}:651-656
        stated identity: the serial number is three letters, then a number, low word first @ {COM}:666-682
        stated identity: the firmware version begins with F @ {COM}:273-281
        assumed identity: letters FTS, firmware 1.0.0, serial number 1, year 2024; missing registers read 00 @ {ALL}
        stated configuration: 50 bytes FF stop the stream; 0200 in register 410 starts it @ {COM}:70-71, 517
        stated configuration: the sensor may already stream when a driver opens the port @ {COM}:257-267
        assumed configuration: it streams from power-up on, and answers Modbus requests while it streams @ {ALL}
        assumed configuration: other values of register 410 have no effect; other addresses and functions are refused @
            {ALL}
        stated timing: 19200 8N1, unit 9 @ {COM}:812, 1189
        assumed timing: 100 frames a second @ {ALL}
    """)

    def __init__(
        self,
        *,
        tool: Tool = (0.0, 0.0, 0.05),
        streams: Annotated[
            bool, Option("stream from power-up, as hardware does; if false, only Modbus is in use")
        ] = True,
        serial_number: Annotated[int, Option("serial number that hosts print behind FTS", low=0, high=0xFFFFFFFF)] = 1,
        firmware: Annotated[tuple[int, int, int], Option("firmware version behind FTS", low=0, high=0xFF)] = (1, 0, 0),
        year: Annotated[int, Option("year of production", low=0, high=0xFFFF)] = 2024,
    ):
        self.layout = points({"tool": tool})
        self.registers = Registers(MAP)
        self.registers["firmware"] = [*SERIAL_LETTERS, *firmware, *[0] * 14]
        self.registers["letters"] = [*SERIAL_LETTERS, 0]
        self.registers["serial"] = [serial_number & 0xFFFF, serial_number >> 16]
        self.registers["year"] = year
        self.rtu = Rtu(counters=self.counters, gap_ns=silence_ns(BAUD))
        self.streaming, self.stops = streams, 0

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return, by sense, Fx Fy Fz Mx My Mz [0.01 N, 0.001 Nm] ``(1, 6)``, and acceleration [0.001 g] ``(1, 3)``."""
        super().measure(reading, t_ns)
        self.registers["wrench"], self.registers["acceleration"] = (counts[0] for counts in self.counts.values())
        return self.counts

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return one frame, while the stream runs."""
        return [STREAM.pack(values=self.counts["wrench"][0])] if self.streaming else ()

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Stop the stream, or answer Modbus; both arrive in chunks of any size."""
        _, stopped, received = (STOP[: self.stops] + data).rpartition(STOP)
        self.stops = len(received) - len(received.rstrip(STOP[:1]))
        if stopped:
            self.counters["requests"] += 1
            self.rtu.reset()
            self.streaming, data = False, received
        if self.rtu.is_idle:
            data = data.lstrip(STOP[:1])  # hosts continue the stop after the stream has ended
        answers = self.rtu.answers(data, t_ns, {UNIT: Banks(holding=self.registers, functions=(3, 16))})
        if self.registers["stream"] == START_STREAM:
            self.registers["stream"], self.streaming = 0, True
        return answers
