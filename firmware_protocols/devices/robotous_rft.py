"""Robotous RFT: six-axis force-torque sensors of a robot's wrist, on RS-232, RS-422 or USB.

Wire: 115200 8N1 at first. The host sends a ``REQUEST`` of eleven bytes; an ``ANSWER`` of nineteen repeats its command.

    command  parameters       data of the answer      about
    01       -                model, ASCII
    02       -                serial number, ASCII
    03       -                firmware, ASCII
    06       baud             ``RESULT``              0, 4: 115200, 1: 921600, 2: 460800, 3: 230400, 5: 57600; in force
                                                      from the next power-up
    07       -                baud, baud to come
    08       type, cutoff     ``RESULT``              1, 1..14: low-pass at 500 ... 1 Hz; 0 0 and 1 0: none
    09       -                type, cutoff
    0A       -                ``READING``             once
    0B       -                ``READING`` s           as answers to 0B, until 0C, which has no answer
    0F       rate             ``RESULT``              0..8: 200, 10, 20, 50, 100, 200, 333, 500, 1000 Hz
    10       -                rate
    11       0, 1             no answer               1: the present force and torque become zero; 0: no more
    12       -                a byte for each axis    number of its overloads

Data are filled up with zeros. While readings are sent, only 0C, 10 and 11 are obeyed. Baud, filter and rate are saved.

Evidence: the vendor's manual and driver.

Try it: ``tactemu run robotous_rft``, then a ``CRT_RFT_UART`` of the vendor's package for ROS 2.
"""

from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    Device, Frame, LowPass, Option, Packets, Refused, Request, Sense, Serial, Tool, Transmissions,
    command, fact_table, points, wrench,
)  # fmt: skip

REQUEST = Frame("""
    request
    0     55            start
    1     u1            command
    2     bytes x 7     parameters    one or two, the rest without meaning
    9     sum8 from 1   sum
    10    AA            end
""")
ANSWER = Frame("""
    answer
    0     55            start
    1     u1            command
    2     bytes x 15    data
    17    sum8 from 1   sum
    18    AA            end
""")
READING = Frame("""
    reading
    0     >i2 x 6       wrench        Fx Fy Fz [1/50 N], Tx Ty Tz [1/2000 Nm; RFT80 and RFT82: 1/1000 Nm]
    12    u1            overload      bits 5 to 0: Fx Fy Fz Tx Ty Tz beyond 120 % of the rated load
    13    00 x 2        reserved
""")
UNKNOWN, OUT_OF_RANGE, DONE = 1, 2, bytes([1, 0])
BAUDS = (115200, 921600, 460800, 230400, 115200, 57600)
RATES_HZ = (200, 10, 20, 50, 100, 200, 333, 500, 1000)
FASTEST_HZ = {57600: 200, 115200: 333, 230400: 500, 460800: 500, 921600: 1000}
"""The fastest rate of readings at each baud rate."""
CUTOFFS_HZ = (None, 500, 300, 200, 150, 100, 50, 40, 30, 20, 10, 5, 3, 2, 1)
Model = Literal["RFT40-SA01", "RFT44-SB01", "RFT60-HA01", "RFT64-SB01", "RFT76-HA01", "RFT82-HA02", "RFT80-6A01"]
RATED = {"RFT40": (100, 150, 2.5), "RFT44": (100, 150, 2.5), "RFT60": (150, 200, 4), "RFT64": (150, 200, 4),
         "RFT76": (300, 300, 10), "RFT82": (400, 400, 20), "RFT80": (400, 400, 20)}  # fmt: skip
"""The rated Fx and Fy [N], Fz [N], and torques [Nm]."""
START, STOP, READ_RATE, BIAS = 0x0B, 0x0C, 0x10, 0x11
DRIVER = "ROBOTOUS/ROS-2-Interface-for-RFT-Series-UART-Model@057c534"
MANUAL = "ROBOTOUS, RFT Series Installation and Operation Manual, revision 1.7"
BOTH = f"{MANUAL}, whole; {DRIVER}, all files"


class RobotousRft(Device):
    """A sensor between flange and tool, asked or sending by itself."""

    name = "robotous_rft"
    title = "Robotous RFT six-axis force-torque sensors, UART"
    kind = "force-torque sensor"
    senses = (Sense("wrench", at=points({"origin": (0.0, 0.0, 0.0)})),)
    evidence = ("vendor document", "driver")
    sources = (MANUAL, f"{DRIVER} RFT_IF_PACKET_Rev1.2.cpp, RFT_UART_SAMPLE.cpp")
    judge = DRIVER
    origin = f"{MANUAL}, 3.6; bytes by {DRIVER} RFT_IF_PACKET_Rev1.2.cpp"
    documented_with = None
    facts = fact_table(f"""
        stated touch: values are int16, high byte first: 50 counts per N, and 2000 or 1000 per Nm, depending on the
            model @ {MANUAL}, 3.6.11
        stated touch: an overload is a component that exceeds its rated load by more than 20 %; the counter ends at 255
            @ {MANUAL}, 3.6.11, 3.6.18, 4.2
        assumed touch: forces act on the tool, which is touched 50 mm above the origin and to the side of it; z points
            out; counts saturate at the limits of int16; a reading is the filtered value minus the bias @ {BOTH}
        stated identity: three texts of 15 characters @ {MANUAL}, 3.6.2 to 3.6.4
        assumed identity: the content of the texts; they are padded with zeros @ {BOTH}
        stated configuration: the parameters, the error codes, and which settings are saved @ {MANUAL}, 3.3, 3.6.5 to
            3.6.19
        assumed configuration: the commands for CAN are unknown; commands that have to wait for 0C, and wrong sums, get
            no answer; any bias other than 0 counts as 1; overloads are counted from power-up on @ {BOTH}
        stated timing: 200 Hz and 115200 baud after power-up; the highest rate at each baud rate @ {MANUAL}, 3.4, 3.6.16
        assumed timing: the sensor measures at the rate of its readings, whether they are requested or not @ {BOTH}
    """)

    def __init__(
        self,
        *,
        tool: Tool = (0.02, 0.01, 0.05),
        model: Annotated[Model, Option("sets load and scale")] = "RFT60-HA01",
        serial_number: Annotated[str, Option("at most 15 characters of ASCII")] = "C00300000",
        firmware: Annotated[str, Option("at most 15 characters of ASCII")] = "1.0",
    ):
        self.layout = points({"tool": tool})
        self.flash = {"baud": 0, "rate": 0, "filter": (0, 0)} | self.flash
        self.baud = self.flash["baud"]
        self.ports, self.rate_hz = (Serial(baud=BAUDS[self.baud]),), float(RATES_HZ[self.flash["rate"]])
        self.low_pass, self.streaming = LowPass(CUTOFFS_HZ[self.flash["filter"][1]]), False
        torque_scale = 1000 if model[:4] == "RFT8" else 2000
        self.columns = wrench("Fx Fy Fz Tx Ty Tz", per_unit=(50, torque_scale), low=-0x8000, high=0x7FFF)
        self.packets = Packets(REQUEST, by="command", counters=self.counters)
        self.packets.others = "refused"
        across, along, torque = RATED[model[:5]]
        self.limits = 1.2 * np.array([across, across, along, torque, torque, torque])
        self.texts = [text.encode("ascii") for text in (model, serial_number, firmware)]
        self.overload, self.overloads = np.zeros(6, bool), np.zeros(6, int)

    def filtered(self, values: np.ndarray, t_ns: int) -> np.ndarray:
        """Return the force and torque behind the low-pass, and count the axes whose overload begins."""
        wrench = self.low_pass(values, t_ns)
        before, self.overload = self.overload, np.abs(wrench[0]) > self.limits
        self.overloads = np.minimum(self.overloads + (self.overload & ~before), 255)
        return wrench

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return a reading, between 0B and 0C."""
        return _answer(START, self._reading()) if self.streaming else ()

    def accepts(self, request: Request) -> bool:
        """Return False for a command that waits for 0C."""
        return not self.streaming or request.command in (STOP, READ_RATE, BIAS)

    def reply(self, request: Request, content: bytes) -> Transmissions:
        """Return the answer."""
        return _answer(request.command, content)

    def refused(self, request: Request, why: str) -> Transmissions:
        """Return the answer of a failure."""
        return _answer(request.command, bytes([0, UNKNOWN if why == "unknown_command" else OUT_OF_RANGE]))

    def _reading(self) -> bytes:
        return READING.pack(wrench=self.counts[0], overload=int(np.packbits(self.overload)[0]) >> 2)

    @command("55 01 00 00 00 00 00 00 00 01 AA", "55 01 52 46 54 36 30 2D 48 41 30 31 00 * AA", name="model", safe=True)
    @command("55 02 00 00 00 00 00 00 00 02 AA", "55 02 ..{16} AA", name="serial number", safe=True)
    @command("55 03 00 00 00 00 00 00 00 03 AA", "55 03 ..{16} AA", name="firmware", safe=True)
    @command("55 07 00 00 00 00 00 00 00 07 AA", "55 07 00 00 00 * 07 AA", name="baud rate", safe=True)
    @command("55 09 00 00 00 00 00 00 00 09 AA", "55 09 00 00 00 * 09 AA", name="filter", safe=True)
    @command("55 0A 00 00 00 00 00 00 00 0A AA", "55 0A ..{16} AA", name="once", safe=True)
    @command("55 10 00 00 00 00 00 00 00 10 AA", "55 10 00 00 00 * 10 AA", name="rate", safe=True)
    @command("55 12 00 00 00 00 00 00 00 12 AA", "55 12 00 00 00 00 00 00 * 12 AA", name="overloads", safe=True)
    def read(self, request: Request) -> bytes:
        """Return a text, a setting, a reading or the numbers of overloads."""
        n, saved = request.command, self.flash
        values = {7: (self.baud, saved["baud"]), 9: saved["filter"], 16: (saved["rate"],), 18: self.overloads.tolist()}
        return self._reading() if n == 10 else bytes(values[n]) if n in values else self.texts[n - 1]

    @command("55 06 01 00 00 00 00 00 00 07 AA", "55 06 01 00 00 * 07 AA", name="921600 baud")
    @command("55 08 01 0A 00 00 00 00 00 13 AA", "55 08 01 00 00 * 09 AA", name="10 Hz low-pass")
    @command("55 0F 04 00 00 00 00 00 00 13 AA", "55 0F 01 00 00 * 10 AA", name="100 readings a second")
    def save(self, request: Request) -> bytes:
        """Save the baud rate of the next power-up, or set and save filter or rate, unless the line is too slow."""
        value, cutoff = request.parameters[:2]
        if request.command == 0x06 and value < len(BAUDS):
            self.flash["baud"] = value
        elif request.command == 0x08 and cutoff < (1, len(CUTOFFS_HZ), 0)[min(value, 2)]:
            self.flash["filter"], self.low_pass.cutoff_hz = (value, cutoff), CUTOFFS_HZ[cutoff]
        elif request.command == 0x0F and value < len(RATES_HZ) and RATES_HZ[value] <= FASTEST_HZ[BAUDS[self.baud]]:
            self.flash["rate"], self.period_ns = value, round(1e9 / RATES_HZ[value])
        else:
            raise Refused("value")
        return DONE

    @command("55 0B 00 00 00 00 00 00 00 0B AA", name="start")
    @command("55 0C 00 00 00 00 00 00 00 0C AA", name="stop")
    @command("55 11 01 00 00 00 00 00 00 12 AA", name="bias")
    def start_stop_or_bias(self, request: Request) -> Transmissions:
        """Start or stop readings; or make the present force and torque zero, or no more."""
        if request.command == BIAS:
            self.zero = self.present if request.parameters[0] else 0.0
        else:
            self.streaming = request.command == START
        return ()


def _answer(command: int, data: bytes) -> list[bytes]:
    return [ANSWER.pack(command=command, data=data.ljust(15, b"\0"))]
