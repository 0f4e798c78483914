"""Seed Robotics FTS-3: up to five fingertips that measure force along three axes, on one board.

Wire: FTDI bridge (0403:6010, its second port), 1 000 000 8N1. Text; every line of the board ends with CR LF. It sends
unasked, every 20 ms at most,

    @,sec,msec,x1,y1,z1,x2,y2,z2,x3,y3,z3,x4,y4,z4,x5,y5,z5,

of integers. The fields of a missing sensor are empty, and so are x and y of one that measures z only.

    command                      answer          about
    enabletime, disabletime      #OK             lines with the two fields of time, or without
    setepoch,SEC,MSEC            #OK             sets the present time
    setperiod,MSEC               #OK             sets the period of the lines
    calibrate                    #OK             what is measured now becomes zero
    getversion, softwareversion  #OK,VERSION
    dumpsensors, dumponboard, resume  #OK

A command ends with CR or LF, as the ROS node sends it, or with a silence: the vendor's tool sends no end, and waits
0.3 s. SEC of the tool (``setepoch,1781003060.4375293,0``) and MSEC of the node (``setperiod,50.0``, without an end)
have a fraction, which the model drops.

Try it: ``tactemu run seed_fts3``, then read lines.
"""

from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    USB, Counts, CountsPerNewton, Device, Lines, Option, Reading, Request, Serial, Transmissions, command,
    command_table, fact_table, points, xyz,
)  # fmt: skip

FINGER_SPACING_M = 0.02
MIN_PERIOD_MS = 20
SILENCE_NS = 100_000_000
MAX_COUNTS = 0x7FFF

OK_LINE = b"#OK\r\n"
FRACTION = rb"(?:\.\d*)?"

Fitted = Literal["xyz", "z", "none"]


class SeedFts3(Device):
    """Fingertips that stream lines of numbers."""

    name = "seed_fts3"
    kind = "fingertip"
    title = "Seed Robotics FTS-3 fingertips"
    ports = (Serial(baud=1_000_000, usb=USB(0x0403, 0x6010, interface=1, node="ttyUSB")),)
    rate_hz = 1000 / MIN_PERIOD_MS
    evidence = ("vendor document", "driver")
    sources = (
        "kb.seedrobotics.com FTS3 pressure sensor (unit, range, rate; the vendor's manual)",
        "seedrobotics/SensorTools@a4b7613 README, SensorTool.py",
        "seedrobotics/ros2_sensor_pkg@a920d6c script/read_publish_sensor_node.py; seedrobotics/ros_fts README",
    )
    judge = "seedrobotics/SensorTools@a4b7613, seedrobotics/ros2_sensor_pkg@a920d6c"
    origin = "SensorTools@a4b7613 SensorTool.py"
    documented = command_table(
        r"""
        setperiod,20, with CR LF   'setperiod,20\r\n'  '#OK\r\n'
        setperiod with a fraction  'setperiod,50.0'    '#OK\r\n'
        """,
        origin="ros2_sensor_pkg@a920d6c read_publish_sensor_node.py",
    )
    documented_with = ("sensors", "counts_per_newton")
    facts = fact_table("""
        stated touch: values are whole numbers in mN, up to 3 kg; a command that is not modelled switches to counts @
            kb.seedrobotics.com fts3_pressuresensor; ros_fts README.md:63
        assumed touch: values are -32767..32767; a push makes z positive, x and y are forces on the skin; fingertips are
            20 mm apart @ kb.seedrobotics.com, SensorTools, ros2_sensor_pkg, ros_fts, all files
        assumed identity: the version, and that nothing else follows #OK @ read_publish_sensor_node.py:213,
            SensorTool.py, which look at #OK alone
        stated configuration: each line has five sensors; the fields of a missing sensor are empty, and so are x and y
            of a sensor that measures z only @ SensorTools README.md (Data Format), read_publish_sensor_node.py:150-180
        stated configuration: the commands enabletime, disabletime, calibrate, setepoch and setperiod @ SensorTools
            README.md
        stated configuration: seconds of setepoch and milliseconds of setperiod may have a fraction @ SensorTool.py:98,
            read_publish_sensor_node.py:138-140
        stated configuration: 0403:6010, the second port @ SensorTool.py:26-50
        assumed configuration: a silence of 100 ms ends a command; an unknown command gets no answer; fractions are
            truncated @ SensorTool.py (waits 0.3 s), read_publish_sensor_node.py; README's example 1781003060, 0
        assumed configuration: dumpsensors and dumponboard write nothing, so that resume has nothing to do @
            read_publish_sensor_node.py:117-126, which logs what comes; README.md, kb.seedrobotics.com
        stated timing: 50 lines a second from power-up on, at 1 Mbaud @ kb.seedrobotics.com fts3_pressuresensor
        stated timing: at most 50 lines a second @ read_publish_sensor_node.py:141-146, ros_fts README.md:86
        assumed timing: after power-up lines have the time, from 0 on; periods below 20 ms count as 20 ms @
            SensorTool.py and read_publish_sensor_node.py, which set or take both
    """)

    def __init__(
        self,
        *,
        sensors: Annotated[
            tuple[Fitted, Fitted, Fitted, Fitted, Fitted], Option("kind of each sensor: three axes, z only, none")
        ] = ("xyz", "xyz", "xyz", "xyz", "xyz"),
        version: Annotated[str, Option("version of the firmware")] = "1.0.0",
        counts_per_newton: CountsPerNewton = 1000.0,
    ):
        self.sensors, self.version = sensors, version.encode("ascii")
        fitted = [slot for slot, kind in enumerate(sensors) if kind != "none"]
        if not fitted:
            raise ValueError("seed_fts3: option sensors: at least one must not be none")
        self.layout = points({f"sensor {slot + 1}": (FINGER_SPACING_M * slot, 0.0, 0.0) for slot in fitted})
        self.columns = xyz(
            "x y z", push=1, unit="N", counts_per_unit=counts_per_newton, low=-MAX_COUNTS, high=MAX_COUNTS
        )
        self.present = np.zeros((len(fitted), 3))
        self.packets = Lines(counters=self.counters, longest=64)
        self.says_time, self.epoch_ms = True, 0

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return x, y, z of each fitted sensor, shape ``(n, 3)``, a push positive; 0 for an axis that is missing."""
        super().measure(reading, t_ns)
        self.counts[[kind == "z" for kind in self.sensors if kind != "none"], :2] = 0
        return self.counts

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return one line."""
        fields = [str(number) for number in divmod(t_ns // 1_000_000 + self.epoch_ms, 1000)] if self.says_time else []
        values = iter(self.layout.on_wire(self.counts).tolist())
        for kind in self.sensors:
            fields += _fields(kind, next(values) if kind != "none" else [])
        return [f"@,{','.join(fields)},\r\n".encode("ascii")]

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Obey commands, which arrive in chunks of any size, with or without a line end."""
        done = super().receive(data, t_ns, port)
        self.wake_ns = t_ns + SILENCE_NS if self.packets.has_partial else None
        return done

    def wake(self, t_ns: int) -> Transmissions:
        """Obey the command that a silence has ended."""
        return [out for line in self.packets.end() for out in self.obey(line, t_ns)]

    @command(b"enabletime", OK_LINE)
    @command(b"disabletime", OK_LINE, name="disabletime")
    def enabletime(self, request: Request):
        """Send lines with the time, or without."""
        self.says_time = request.packet == b"enabletime"

    @command(b"calibrate", OK_LINE)
    def calibrate(self, request: Request):
        """Make the present forces zero."""
        self.zero = self.present

    @command(b"setepoch,1700000000,250", OK_LINE, name="setepoch,1700000000,250")
    @command(b"setepoch,1781003060.4375293,0", OK_LINE, name="setepoch with a fraction")
    @command(pattern=rb"setepoch,(\d{1,10})" + FRACTION + rb",(\d{1,3})" + FRACTION)
    def set_epoch(self, request: Request):
        """Set the time."""
        seconds, ms = map(int, request.values)
        self.epoch_ms = seconds * 1000 + ms - request.t_ns // 1_000_000

    @command(b"setperiod,40", OK_LINE, name="setperiod,40", pattern=rb"setperiod,(\d{1,5})" + FRACTION)
    def set_period(self, request: Request):
        """Set the period of the lines."""
        self.period_ns = max(int(request.value), MIN_PERIOD_MS) * 1_000_000

    @command(b"dumpsensors", OK_LINE)
    @command(b"dumponboard", OK_LINE, name="dumponboard")
    @command(b"resume", OK_LINE, name="resume")
    def dumpsensors(self, request: Request):
        """Answer, without effect."""

    @command(b"getversion", b"#OK,1.0.0\r\n", safe=True)
    @command(b"softwareversion", b"#OK,1.0.0\r\n", name="softwareversion", safe=True)
    def getversion(self, request: Request):
        """Return the version."""
        return b"," + self.version

    def reply(self, request: Request, content: bytes) -> Transmissions:
        """Return the line that answers a command."""
        return [b"#OK%s\r\n" % content]


def _fields(kind: Fitted, values: list[int]) -> list[str]:
    """Return the three fields of a sensor."""
    if kind == "none":
        return ["", "", ""]
    return ["", "", str(values[2])] if kind == "z" else [str(value) for value in values]
