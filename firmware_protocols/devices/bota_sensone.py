"""Bota SensONE (generation 0), a force-torque sensor: text commands, then binary frames.

Wire: 460800 8N1. Opening the port restarts the sensor, which then sends App Init. Commands end with CR or LF, as the
vendor's library sends them, or with a silence; each is answered r,0,X,0, where X is its first letter.

    command                  about
    C                        configure: ends the stream; the sensor takes the other commands only then
    c,TEMP,CAL,FORMAT,BAUD   temperature compensated, calibrated, 0 binary or 1 CSV, 4: 460800; 0,1,0,4 as sent
    f,SINC,CHOP,FAST,FIR     filter: 51200 / SINC frames per second, SINC 64 to 2048; SINC,0,0,1 as sent
    b,FX,FY,FZ,TX,TY,TZ      offset [N, Nm]
    p?                       first a line p,0,SERIAL,0,0,MODEL, SERIAL of three digits: the library shows SN000123
    s                        sent after these by the library
    R                        run: ``FRAME`` s; answered while it runs, too: the library sends it again after a tare

Status bits as the library names them: 1 throttled, 2 overrange, 4 invalid, 8 raw.

Try it: ``tactemu run bota_sensone``, then a ``BotaDriver`` with Bota_Binary_gen0, BFT-SENS-SER-M8 and SN000001.
"""

import re
from typing import Annotated

import numpy as np

from firmware_protocols import (
    Column, Counts, Device, Frame, Lines, Option, Reading, Restart, Rollover, Sense, Serial, Tool, Transmissions,
    command_table, fact_table, points, xyz,
)  # fmt: skip

FRAME = Frame("""
    frame
    0     AA                    head
    1     <u2                   status
    3     <f4 x 6               wrench       Fx Fy Fz [N], Mx My Mz [Nm]
    27    <u4 wrap              time         [us]
    31    <f4                   temperature  [deg C]
    last  <crc16_x25 from 1     crc
""")
OVERRANGE = 2
GREETING = b"App Init\r\n"
SILENCE_NS = 20_000_000
CONVERTER_HZ = 51200
SINC_RANGE = range(64, 2049)
NUMBER = rb"(-?\d{1,9}(?:\.\d{1,9})?)"
COMMANDS = re.compile(rb"[Rs]|p\?|c(?:,\d){4}|f,(?P<sinc>\d{1,5})(?:,\d){3}|b" + rb"".join([b"," + NUMBER] * 6))
ORIGIN = points({"origin": (0.0, 0.0, 0.0)})


class BotaSensone(Device):
    """A sensor between flange and tool that measures force, torque and temperature."""

    name = "bota_sensone"
    kind = "force-torque sensor"
    title = "Bota SensONE force-torque sensor, serial"
    ports = (Serial(baud=460800),)
    senses = (Sense("wrench", at=ORIGIN), Sense("temperature", at=ORIGIN))
    rollovers = (Rollover(name="time", bits=32, step=1_000_000, clock=True, state="clock_us"),)
    boot_s = 0.1
    evidence = ("driver",)
    sources = (
        "tud-phi/bota_ft_sensors@4b98f94 python/senseone.py, python/bota_serial_example.py (the vendor's)",
        "bota-driver 1.1.16 (the vendor's library), as it speaks: LF, filter, offset, p?, status bits, restart",
    )
    judge = "bota-driver 1.1.16, tud-phi/bota_ft_sensors@4b98f94"
    documented = command_table(r"""
        @ bota-driver 1.1.16, as it speaks
        configure                   'C\n'                    'r,0,C,0\r\n'
        serial number and model     'C\n'; 'p?\n'            70 2C 30 2C *
        communication               'C\n'; 'c,0,1,0,4\n'     'r,0,c,0\r\n'
        512 samples to a frame      'C\n'; 'f,512,0,0,1\n'   'r,0,f,0\r\n'
        64 samples to a frame       'C\n'; 'f,64,0,0,1\r\n'  'r,0,f,0\r\n'
        offset                      'C\n'; 'b,1.500000,-2.250000,0.000000,0.000000,0.000000,0.125000\n'
            'r,0,b,0\r\n'
        what follows a configuration  'C\n'; 's\n'           'r,0,s,0\r\n'
        run                         'C\n'; 'R\n'             'r,0,R,0\r\n'
        @ bota_ft_sensors@4b98f94 senseone.py
        configure, without an end   'C'                      'r,0,C,0\r\n'
        run, without an end         'C\n'; 'R'               'r,0,R,0\r\n'
    """)
    documented_with = None
    facts = fact_table("""
        stated touch: forces, torques and temperature as floats, N, Nm and degrees @ tud-phi/bota_ft_sensors@4b98f94
            python/senseone.py:170-180; bota-driver 1.1.16, as it shows them
        assumed touch: the tool is touched 50 mm above the sensor's origin; z points out of the tool side, forces act on
            the tool @ bota_ft_sensors, all files; bota-driver's help texts
        assumed touch: saturation and overrange are set at the limits given by the options; other status bits stay 0 @
            bota_ft_sensors, all files; bota-driver, which names the bits
        stated identity: command p? returns what the library shows after SN000, and the model, but no firmware version @
            bota-driver 1.1.16, run: SN000123, BFT-SENS-SER-M8, version x.x.x
        assumed identity: the zeros in the answer to p? @ bota-driver 1.1.16, which takes both by place
        stated configuration: the fields of commands c and f; C, c, f and R are answered with r,0,X,0 @
            python/senseone.py:10-20, 105-145
        assumed configuration: command b adds an offset; s and c have no effect: the model has no CSV output and no
            other baud rate @ bota-driver 1.1.16, run; bota_ft_sensors send 0,1,0,4 alone
        assumed configuration: command R is answered while the sensor runs: the library waits 2 s for this answer and
            warns if it does not come @ bota-driver 1.1.16, tare() and activate(), run
        assumed configuration: commands that are unknown, out of range or not possible at the time get no answer; a
            silence of 20 ms ends a command; answers end with CR LF @ bota_ft_sensors, all files; bota-driver, run
        stated configuration: opening the port restarts the sensor @ bota-driver 1.1.16: it says so, and waits 3 s
        stated timing: a frame is sent every SINC * 19.53125 us; the time counts microseconds @ python/senseone.py:127,
            178; bota-driver: 512 is 100 Hz, 256 is 200 Hz
        assumed timing: SINC is 512 after power-up; a restart takes 0.1 s and clears offset and filter @
            bota_ft_sensors, all files; bota-driver, which sets both each time
    """)

    def __init__(
        self,
        *,
        tool: Tool = (0.0, 0.0, 0.05),
        force_range: Annotated[float, Option("largest force along each axis", unit="N", low=1e-3)] = 500.0,
        torque_range: Annotated[float, Option("largest torque about each axis", unit="Nm", low=1e-3)] = 15.0,
        serial_number: Annotated[int, Option("SN000001 is 1", low=0, high=999)] = 1,
        model: Annotated[str, Option("the vendor's name of the model, ASCII")] = "BFT-SENS-SER-M8",
    ):
        self.layout = points({"tool": tool})
        self.range = np.array([force_range] * 3 + [torque_range] * 3)
        most, floats = {"N": force_range, "Nm": torque_range}, {"counts_per_unit": 1.0, "is_float": True}
        self.columns = (
            *(each for name, unit in (("Fx Fy Fz", "N"), ("Mx My Mz", "Nm"))
              for each in xyz(name, unit=unit, low=-most[unit], high=most[unit], **floats)),
            Column(name="T", sense="temperature", unit="degC", low=-1e6, high=1e6, rest=25.0, **floats),
        )  # fmt: skip
        self.lines_in = Lines(counters=self.counters, longest=96)
        self.clock_us = 0
        self.zero = np.zeros(6)
        self.identity = f"p,0,{serial_number:03d},0,0,{model}\r\n".encode("ascii")
        self.configuring = self.running = False

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return float32 by sense, as sent: Fx Fy Fz [N] Mx My Mz [Nm] ``(1, 6)``; temperature [deg C] ``(1,)``."""
        super().measure(reading, t_ns)
        self.status = OVERRANGE if (np.abs(self.present - self.zero) > self.range).any() else 0
        return self.counts

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return one frame while the stream runs."""
        if not self.running:
            return ()
        (wrench,), (temperature,) = self.counts["wrench"], self.counts["temperature"]
        time = t_ns // 1000 + self.clock_us
        return [FRAME.pack(status=self.status, wrench=wrench, time=time, temperature=temperature)]

    def boot(self, t_ns: int) -> Transmissions:
        """Return the greeting after power-up."""
        return [GREETING]

    def lines(self, dtr: bool, rts: bool, t_ns: int, port: str) -> Transmissions:
        """Restart the sensor when the port is opened."""
        return [Restart()] if dtr else ()

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Obey commands, which arrive in chunks of any size, with or without a line end."""
        lines = self.lines_in.cut(data)
        self.wake_ns = t_ns + SILENCE_NS if self.lines_in.has_partial else None
        return [answer for line in lines for answer in self._obey(line)]

    def wake(self, t_ns: int) -> Transmissions:
        """Obey the command that a silence has ended."""
        return [answer for line in self.lines_in.end() for answer in self._obey(line)]

    def _obey(self, line: bytes) -> list[bytes]:
        self.counters["requests"] += 1
        if line == b"C":
            self.configuring, self.running = True, False
        elif not (line == b"R" and self.running) and not (self.configuring and self._configured(line)):
            self.counters["refused"] += 1
            return []
        return [self.identity * (line == b"p?") + b"r,0,%c,0\r\n" % line[0]]

    def _configured(self, line: bytes) -> bool:
        """Execute a command other than C; return False if it is none."""
        command = COMMANDS.fullmatch(line)
        if command is None or (command["sinc"] and int(command["sinc"]) not in SINC_RANGE):
            return False
        if command["sinc"]:
            self.period_ns = round(int(command["sinc"]) * 1e9 / CONVERTER_HZ)
        elif line[:1] == b"b":
            self.zero = -np.array([float(number) for number in line.split(b",")[1:]])
        elif line == b"R":
            self.configuring, self.running = False, True
        return True
