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

import re
from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    USB, Column, Counts, Device, Lines, Option, Reading, Serial, Transmissions, command_table, fact_table, points,
    quantize,
)  # fmt: skip

FINGER_SPACING_M = 0.02
MIN_PERIOD_MS = 20
SILENCE_NS = 100_000_000
MAX_COUNTS = 0x7FFF

OK_LINE = b"#OK\r\n"
FRACTION = rb"(?:\.\d*)?"
EPOCH = re.compile(rb"setepoch,(\d{1,10})" + FRACTION + rb",(\d{1,3})" + FRACTION)
PERIOD = re.compile(rb"setperiod,(\d{1,5})" + FRACTION)
DUMPS = (b"dumpsensors", b"dumponboard", b"resume")

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
    documented = command_table("""
        @ SensorTools@a4b7613 SensorTool.py
        enabletime                 656e61626c6574696d65                                        23 4F 4B 0D 0A
        disabletime                64697361626c6574696d65                                      23 4F 4B 0D 0A
        calibrate                  63616c696272617465                                          23 4F 4B 0D 0A
        setepoch,1700000000,250    73657465706f63682c313730303030303030302c323530              23 4F 4B 0D 0A
        setperiod,40               736574706572696f642c3430                                    23 4F 4B 0D 0A
        dumpsensors                64756d7073656e736f7273                                      23 4F 4B 0D 0A
        dumponboard                64756d706f6e626f617264                                      23 4F 4B 0D 0A
        resume                     726573756d65                                                23 4F 4B 0D 0A
        ? getversion               67657476657273696f6e
            23 4F 4B 2C 312e302e30 0D 0A
        ? softwareversion          736f66747761726576657273696f6e
            23 4F 4B 2C 312e302e30 0D 0A
        setepoch with a fraction   73657465706f63682c313738313030333036302e343337353239332c30  23 4F 4B 0D 0A
        @ ros2_sensor_pkg@a920d6c read_publish_sensor_node.py
        setperiod,20, with CR LF   73 65 74 70 65 72 69 6F 64 2C 32 30 0D 0A                   23 4F 4B 0D 0A
        setperiod with a fraction  736574706572696f642c35302e30                                23 4F 4B 0D 0A
    """)
    documented_with = ("sensors", "counts_per_newton")
    facts = fact_table("""
        stated touch: whole numbers in mN, up to 3 kg; counts by a command that is not in the model @
            kb.seedrobotics.com fts3_pressuresensor; ros_fts README.md:63
        assumed touch: -32767..32767; z counts a push as positive, x and y act on the skin; fingertips 20 mm apart @
            kb.seedrobotics.com, SensorTools, ros2_sensor_pkg, ros_fts, all files
        assumed identity: the version, and that nothing else stands behind #OK @ read_publish_sensor_node.py:213,
            SensorTool.py, which look at #OK alone
        stated configuration: five sensors in each line; empty: a missing sensor, x and y of one with z alone @
            SensorTools README.md (Data Format), read_publish_sensor_node.py:150-180
        stated configuration: enabletime, disabletime, calibrate, setepoch, setperiod @ SensorTools README.md
        stated configuration: seconds of setepoch and milliseconds of setperiod may have a fraction @ SensorTool.py:98,
            read_publish_sensor_node.py:138-140
        stated configuration: 0403:6010, the second port @ SensorTool.py:26-50
        assumed configuration: 100 ms of silence end a command; no answer to an unknown one; fractions are cut off @
            SensorTool.py (waits 0.3 s), read_publish_sensor_node.py; README's example 1781003060, 0
        assumed configuration: dumpsensors and dumponboard write nothing, so that resume has nothing to do @
            read_publish_sensor_node.py:117-126, which logs what comes; README.md, kb.seedrobotics.com
        stated timing: lines from power-up, 50 a second, at 1 Mbaud @ kb.seedrobotics.com fts3_pressuresensor
        stated timing: at most 50 lines a second @ read_publish_sensor_node.py:141-146, ros_fts README.md:86
        assumed timing: after power-up with the time, from 0; less than 20 ms is 20 ms @ SensorTool.py and
            read_publish_sensor_node.py, which set or take both
    """)

    def __init__(
        self,
        *,
        sensors: Annotated[
            tuple[Fitted, Fitted, Fitted, Fitted, Fitted], Option("kind of each sensor: three axes, z only, none")
        ] = ("xyz", "xyz", "xyz", "xyz", "xyz"),
        version: Annotated[str, Option("version of the firmware")] = "1.0.0",
        counts_per_newton: Annotated[float, Option("scale of all axes", unit="1/N", low=1e-6)] = 1000.0,
    ):
        self.sensors, self.version, self.counts_per_newton = sensors, version.encode("ascii"), counts_per_newton
        fitted = [slot for slot, kind in enumerate(sensors) if kind != "none"]
        if not fitted:
            raise ValueError("seed_fts3: option sensors: at least one must not be none")
        self.layout = points({f"sensor {slot + 1}": (FINGER_SPACING_M * slot, 0.0, 0.0) for slot in fitted})
        self.columns = tuple(
            Column(name=axis, axis=axis, unit="N", counts_per_unit=counts_per_newton, low=-MAX_COUNTS, high=MAX_COUNTS,
                   push=1 if axis == "z" else 0)
            for axis in ("x", "y", "z")
        )  # fmt: skip
        self.felt = self.zero = np.zeros((len(fitted), 3))
        self.lines_in = Lines(counters=self.counters, longest=64)
        self.says_time, self.epoch_ms = True, 0

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return x, y, z of each fitted sensor, shape ``(n, 3)``, a push positive; 0 for an axis that is missing."""
        self.felt = self.layout.to_taxel_frame(reading["force"]) * [1, 1, -1]
        self.counts = quantize(self.felt - self.zero, self.counts_per_newton, -MAX_COUNTS, MAX_COUNTS)
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
        lines = self.lines_in.cut(data)
        self.wake_ns = t_ns + SILENCE_NS if self.lines_in.has_partial else None
        return [answer for line in lines for answer in self._obey(line, t_ns)]

    def wake(self, t_ns: int) -> Transmissions:
        """Obey the command that a silence has ended."""
        return [answer for line in self.lines_in.end() for answer in self._obey(line, t_ns)]

    def _obey(self, line: bytes, t_ns: int) -> list[bytes]:
        self.counters["requests"] += 1
        if line in (b"enabletime", b"disabletime"):
            self.says_time = line == b"enabletime"
        elif line == b"calibrate":
            self.zero = self.felt
        elif line in (b"getversion", b"softwareversion"):
            return [b"#OK,%s\r\n" % self.version]
        elif epoch := EPOCH.fullmatch(line):
            self.epoch_ms = int(epoch[1]) * 1000 + int(epoch[2]) - t_ns // 1_000_000
        elif period := PERIOD.fullmatch(line):
            self.period_ns = max(int(period[1]), MIN_PERIOD_MS) * 1_000_000
        elif line not in DUMPS:
            self.counters["unknown_command"] += 1
            return []
        return [OK_LINE]


def _fields(kind: Fitted, values: list[int]) -> list[str]:
    """Return the three fields of a sensor."""
    if kind == "none":
        return ["", "", ""]
    return ["", "", str(values[2])] if kind == "z" else [str(value) for value in values]
