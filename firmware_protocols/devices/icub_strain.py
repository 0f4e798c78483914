"""iCub strain: the board of the robot's six-axis force-torque sensors (FT45), on CAN.

Wire: classic CAN, 1 Mbit/s, standard ids ``class << 8 | source << 4 | x``. While transmitting, each conversion is a
``VECTOR`` of the forces, type A, and one of the torques, type B. Beyond 1000..64000 on any gauge the calibrated values
stay as last sent, and a seventh byte is 1.

Host h to board b, id 2hb; the answer, id 2bh, is empty unless the table has one:

    07 mode             0 calibrated, 3 gauges, 4 both (the gauges as types 8 and 9), others silent
    08 n                about n ms: 9 slots of int(34.78 n) ticks of 3.2 us
    15 0, 15 1          no tare; the present values become 0
    15 2 axis i16       tare of an axis, high byte first, added to the counts
    18 axis             18 axis u16: full scale [N, Nm] of 8000 counts (hex)
    1C major minor      1C 06 03 00 00 01 00 ok: board strain, version 3.0.0, protocol 1.0

Evidence: firmware of the board, the robot's own driver (YARP ``canBusAnalogSensor``), run, and the sensor's data sheet.

Try it: ``tactemu run icub_strain --port can:socketcan:vcan0``, then ``cansend vcan0 201#0700; candump vcan0``
"""

from typing import Annotated, Any

import numpy as np

from firmware_protocols import (
    Can, CanFrame, CanRequests, Counts, Device, Frame, Identifier, Option, Reading, Refused, Request, Sense, Tool,
    Transmissions, command, fact_table, points, xyz,
)  # fmt: skip

VECTOR = Frame("""
    three values, id 011 bbbb tttt (b board, t type)
    0     <u2 x 3     axes        x y z from 8000: calibrated, of the full scale; or three gauges
    6     bytes       saturated   01, else missing
""")
REST, LOWEST, HIGHEST = 0x8000, 1000, 64000
CALIBRATED, GAUGES, BOTH = 0, 3, 4
POLLING = 2
BOARD, VERSION, PROTOCOL = 6, bytes([3, 0, 0]), bytes([1, 0])
FULL_SCALES = (1500, 1500, 2000, 35, 35, 25)
LIMITS: dict[str, Any] = {"low": 0, "high": 0xFFFF, "rest": REST}
FIRMWARE = "icub-firmware@052098e sensorReaderDspic30f4013/strain/source_code"
DRIVER = "icub-main@24c1a00 CanBusAnalogSensor.cpp"


def period_of(n: int) -> int:
    """Return the period [ns] of message 08."""
    return int(34.78 * n) * 9 * 3200


class IcubStrain(Device[CanFrame]):
    """A board that transmits when it is told to."""

    name = "icub_strain"
    title = "iCub strain six-axis force-torque sensor"
    kind = "force-torque sensor"
    senses = (Sense("wrench", at=points({"origin": (0.0, 0.0, 0.0)})),)
    columns = (
        *xyz("Fx Fy Fz", unit="N", counts_per_unit=[REST / each for each in FULL_SCALES[:3]], **LIMITS),
        *xyz("Tx Ty Tz", unit="Nm", counts_per_unit=[REST / each for each in FULL_SCALES[3:]], **LIMITS),
    )
    evidence = ("firmware", "driver", "vendor document")
    sources = (
        f"{FIRMWARE} main.c, strain_config.c",
        "icub-firmware-shared@62f2818 iCubCanProto_{types,analogSensorMessages}.h",
        DRIVER,
        "icub-tech-iit.github.io/documentation/ft_sensors",
    )
    judge = "robotology/icub-main@24c1a00"
    origin = f"{FIRMWARE} main.c"
    documented_with = ("tool",)
    facts = fact_table(f"""
        stated touch: counts are sent low byte first, with 8000 (hex) for zero, in units of the full scale / 8000 (hex)
            @ {DRIVER} decode16; main.c
        stated touch: the ranges are 1500, 1500, 2000 N and 35, 35, 25 Nm @
            icub-tech-iit.github.io/documentation/ft_sensors, table 2
        stated touch: beyond 1000..64000 on a gauge the last values are repeated (0 at first), and a seventh byte is
            sent @ main.c s_calculate_and_send_datas
        assumed touch: the full scales are these ranges; type A is force; the tool is touched at the point `tool` @
            main.c (names A force, its array torque); analogSensorMessages.h (both names); strain_config.c (0)
        assumed touch: each gauge is one axis, as with the matrix at delivery; sums saturate at 16 bits @
            strain_config.c (DSP library not read)
        stated identity: version 3.0.0, protocol 1.0, board 6 @ strain_config.c; types.h
        assumed identity: address 1 @ strain_config.c (F)
        stated configuration: the messages, their answers of length 0, and the filter for identifiers 2hb; after
            power-up no timer runs @ main.c; hal_can_boardFilter_set
        assumed configuration: missing bytes count as 0; a period of 0 has no effect; message 18 with a wrong axis, and
            unknown messages, get no answer @ main.c (stale bytes, an unset length; hal_error_canMsg_set not read)
        assumed configuration: messages 04 to 06, 09 to 14, 16, 17, 19 to 1B, 32 and those of the boot loader get no
            answer; nothing is saved @ left out
        stated timing: the period is 9 slots of 34.78 ticks for each ms, with 20 MHz and a prescaler of 64; it is 1 ms
            after power-up @ main.c
    """, looked="main.c, strain_config.c")  # fmt: skip

    def __init__(
        self,
        *,
        address: Annotated[int, Option("address of the board", low=1, high=14)] = 1,
        tool: Tool = (0.02, 0.01, 0.05),
    ):
        self.layout = points({"tool": tool})
        ident = Identifier(f"ccchhhh{address:04b}", {"kind": "c", "host": "h"})
        self.packets, self.ports = CanRequests(ident, by="kind"), (Can(filters=(ident.filter(kind=POLLING),)),)
        self.address, self.mode, self.runs = address, 1, False
        self.rate_hz = 1e9 / period_of(1)
        self.tare, self.held, self.gauges = np.zeros(6, np.int16), np.zeros(6, int), np.full(6, REST)
        self.saturated = False

    @property
    def transmits(self) -> bool:
        """True while it sends each conversion."""
        return self.runs and self.mode in (CALIBRATED, GAUGES, BOTH)

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return the values that are sent, or would be."""
        self.gauges = np.asarray(super().measure(reading, t_ns))[0]
        values = np.clip(self.gauges + self.tare, 0, 0xFFFF)
        self.saturated = bool(((self.gauges > HIGHEST) | (self.gauges < LOWEST)).any())
        if self.transmits:
            self.held = values = self.held if self.saturated else values
        self.counts = (self.gauges if self.mode == GAUGES else values)[None]
        return self.counts

    def stream(self, t_ns: int, name: str) -> Transmissions[CanFrame]:
        """Return forces and torques."""
        if not self.transmits:
            return ()
        sent = [(0xA, self.counts[0]), (0x8, self.gauges)][: 2 if self.mode == BOTH else 1]
        return [
            self.packets.frame(
                0x300 | self.address << 4 | kind + k,
                VECTOR.pack(axes=values[3 * k : 3 * k + 3], saturated=b"\1" * self.saturated),
            )
            for kind, values in sent
            for k in (0, 1)
        ]

    def reply(self, request: Request, content: bytes) -> Transmissions[CanFrame]:
        """Return the answer, from this board to the host."""
        return [self.packets.frame(0x200 | self.address << 4 | request.host, content)]

    @command("201#1800", "210#18 00 05 DC", name="full scale of Fx", origin=f"{DRIVER} readFullScaleAnalog", safe=True)
    @command("201#080A", "210#", name="every 10 ms", origin=f"{DRIVER} sensor_start")
    @command("201#0700", "210#", name="transmit", origin=f"{DRIVER} sensor_start")
    @command("201#0703", "210#", name="transmit gauges", origin=f"{DRIVER} sensor_start")
    @command("201#0704", "210#", name="transmit both")
    @command("201#0701", "210#", name="stop", origin=f"{DRIVER} sensor_stop")
    @command("201#1501", "210#", name="tare")
    @command("201#1502010100", "210#", name="tare of Fy")
    @command("201#1500", "210#", name="no tare")
    @command("201#1C0100", "210#1C 06 03 00 00 01 00 01", data="*", on=POLLING, name="version", safe=True)
    def execute(self, request: Request) -> Transmissions[CanFrame]:
        """Execute a message, and return its answer."""
        data = request.data.ljust(8, b"\0")
        code, axis = data[:2]
        answer = b""
        match code:
            case 0x07:
                self.mode, self.runs = axis, axis in (CALIBRATED, 1, GAUGES, BOTH)
            case 0x08:
                self.period_ns, self.runs = period_of(axis) or self.period_ns, True
            case 0x15 if axis < 2:
                self.tare = ((REST - self.gauges) * axis).astype(np.int16)  # -8000 stays, as in C
            case 0x15:
                if axis == 2 and data[2] < 6:
                    self.tare[data[2]] = int.from_bytes(data[3:5], "big", signed=True)
            case 0x18 if axis < 6:
                answer = data[:2] + FULL_SCALES[axis].to_bytes(2, "big")
            case 0x1C:
                answer = bytes([code, BOARD, *VERSION, *PROTOCOL, data[1:3] == PROTOCOL])
            case _:
                raise Refused("value")
        return self.reply(request, answer)
