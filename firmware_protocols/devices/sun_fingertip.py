"""SUN fingertip: 5 x 5 taxels, one frame for each letter.

Wire: 1 000 000 8N1 for wired fingers; the driver's default is 500 000 (option ``baud``). The host sends ``a`` and gets
``FRAME``; a count is 3.3 V / 4096. A frame has no start mark and no sum. The driver sets its port to low latency, for
500 frames a second.

Try it: ``tactemu run sun_fingertip``, then send ``a``.
"""

from typing import Annotated, Literal

from firmware_protocols import (
    Column, Device, Frame, Option, Serial, Transmissions, command_table, fact_table, grid_layout,
)  # fmt: skip

FRAME = Frame("""
    frame, row by row
    0     <u2 x taxels    counts    0 to 4095
""")
READ_LETTER = b"a"
DRIVER = "sun_tactile_driver"
ROWS = COLS = 5
PITCH_M = 0.0035


class SunFingertip(Device):
    """Twenty-five taxels, which a driver polls."""

    name = "sun_fingertip"
    kind = "fingertip"
    title = "SUN fingertip, 5x5"
    rate_hz = 500.0
    evidence = ("driver",)
    sources = ("marcocostanzo/tactile_sensor_ros@149032e",)
    judge = "marcocostanzo/tactile_sensor_ros@149032e"
    documented = command_table("? read  61  ..{50}", origin="marcocostanzo/tactile_sensor_ros@149032e")
    documented_with = None
    facts = fact_table(f"""
        stated touch: 25 values of 12 bits, low byte first, of x * 3.3 / 4096 V; the numbers of rows and columns are
            parameters @ {DRIVER} src/read_tactile_serial_node.cpp:115-121
        assumed touch: row by row from the upper left, at a pitch of 3.5 mm; the high bits, which the driver masks, are
            0 @ marcocostanzo/tactile_sensor_ros@149032e, all files (the network of read_wrench_node has no file)
        assumed touch: 600 counts at rest, and 400 counts/N along each taxel's normal @ remove_bias_node.cpp,
            read_wrench_node.cpp, gen_net_files.m: less a bias, a network does the rest
        stated configuration: 1 000 000 baud for wired fingers; 500 000 without a parameter @ README.md (Run), {DRIVER}
            launch/tactile_serial.launch:5, read_tactile_serial_node.cpp:61
        assumed configuration: letters other than a get no answer; there is no version and no serial number @
            read_tactile_serial_node.cpp, which sends a alone
        stated timing: 500 frames a second is the full speed @ README.md (Setup)
        assumed timing: 500 conversions a second; a frame has the latest one @ README.md, all of src
    """)

    def __init__(
        self,
        *,
        baud: Annotated[Literal[500_000, 1_000_000], Option("line speed of the firmware")] = 1_000_000,
        baseline: Annotated[int, Option("counts of an untouched taxel", low=0, high=4095)] = 600,
        counts_per_newton: Annotated[float, Option("scale of a taxel", unit="1/N", low=1e-6)] = 400.0,
    ):
        self.ports = (Serial(baud=baud),)
        self.columns = (
            Column(name="voltage", low=0, high=4095, rest=baseline, assumed_per_unit=counts_per_newton, push=1),
        )
        self.layout = grid_layout(ROWS, COLS, PITCH_M)
        self.frame = FRAME.bind(wire_order=self.layout.wire_order)

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Answer letters, one frame each."""
        asked = data.count(READ_LETTER)
        self.counters["requests"] += asked
        self.counters["unknown_command"] += len(data) - asked
        return [self.frame.pack(counts=self.counts)] * asked
