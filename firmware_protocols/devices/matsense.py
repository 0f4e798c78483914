r"""MatSense mat: a matrix of resistive taxels with a motion chip, on a microcontroller.

Wire: serial, 500000 8N1. Device to host only. The secure protocol stuffs each ``FRAME``: 5B begins it, 5D ends it; in
the content 5C 00 stands for 5C, 5C 01 for 5B, 5C 02 for 5D. The simple protocol (option ``protocol``) sends the taxels
alone, 0 to 254, and ends a frame with FF.

The reader drops a frame of another length, and the bytes before the next 5B. Without ``-i`` it expects no motion.

Evidence: the reader, run.

Try it: ``tactemu run matsense``, then ``matsense-server -p PORT --imu -r``, configured with ``protocol: secure``.
"""

from typing import Annotated, Any, Literal

from firmware_protocols import (
    Column, CountsPerNewton, Device, Frame, Option, Sense, Serial, Stuffing, Transmissions, fact_table, grid_layout,
    points, xyz,
)  # fmt: skip

STUFFING = Stuffing(head=b"\x5b", tail=b"\x5d", escape=b"\x5c", codes={b"\x5c": b"\0", b"\x5b": b"\1", b"\x5d": b"\2"})
FRAME = Frame("""
    frame, row by row
    0     u1 x taxels    touch            of the ADC
    ..    <i2 x 3        acceleration     x, y, z
    ..    <i2 x 3        rotation         angular velocity: x, y, z
""")
CHIP = points({"chip": (0.0, 0.0, -0.002)})
INT16: dict[str, Any] = {"low": -0x8000, "high": 0x7FFF}


class MatSense(Device):
    """A mat of 16 x 16 taxels that streams."""

    name = "matsense"
    title = "MatSense 16x16 mat with IMU"
    kind = "skin"
    ports = (Serial(baud=500_000),)
    senses = ("force", Sense("acceleration", at=CHIP), Sense("angular_velocity", at=CHIP))
    rate_hz = 100.0
    evidence = ("driver",)
    sources = ("MatSense 0.4.1 datasetter.py, server.py, tools.py, process/data_handler.py",)
    judge = "MatSense 0.4.1"
    facts = fact_table("""
        stated touch: each taxel has one byte, 255 at most; there are 16 x 16 taxels @ MatSense 0.4.1 datasetter.py,
            server.py:24
        stated touch: six int16 follow the taxels, in the byte order of the reading machine @ MatSense 0.4.1
            datasetter.py:104
        assumed touch: taxels are sent row by row and lie 5 mm apart; 50 counts/N, 0 at rest; 16384 counts per g and 131
            per deg/s, acceleration first @ MatSense 0.4.1, all files
        stated configuration: 500000 baud; the special bytes 5B, 5D and 5C, and three escape codes @ MatSense 0.4.1
            server.py:25, datasetter.py:20
        assumed timing: 100 frames a second from power-up on @ MatSense 0.4.1, all files
    """)

    def __init__(
        self,
        *,
        protocol: Annotated[Literal["secure", "simple"], Option("stuffed with motion, or ended by FF")] = "secure",
        counts_per_newton: CountsPerNewton = 50.0,
    ):
        self.layout = grid_layout(16, 16, 0.005, name="mat")
        self.columns = (
            Column(name="touch", low=0, high=255 - (protocol == "simple"), assumed_per_unit=counts_per_newton, push=1),
            *xyz("ax ay az", sense="acceleration", assumed_per_unit=16384 / 9.80665, **INT16),
            *xyz("gx gy gz", sense="angular_velocity", assumed_per_unit=7505.75, **INT16),
        )
        self.stuffed, self.frame = protocol == "secure", FRAME.bind(wire_order=self.layout.wire_order)

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return one frame."""
        touch, (acceleration,), (rotation,) = self.counts.values()
        if not self.stuffed:
            return [self.layout.on_wire(touch).astype("u1").tobytes() + b"\xff"]
        return [STUFFING.wrap(self.frame.pack(touch=touch, acceleration=acceleration, rotation=rotation))]
