"""Mat: a mat of 4 x 4 taxels with an IMU.

Wire: USB-CDC. Device to host only: a stuffed ``FRAME`` 50 times a second.

Evidence: invented for the tests of ``tactemu check``.

Try it: ``tactemu check tests/firmware/planted/mat.py:Mat``.
"""

from firmware_protocols import Column, Device, Frame, Sense, Serial, Stuffing, assumed, grid_layout, points, xyz

STUFFING = Stuffing(head=b"[", tail=b"]", escape=b"\\", codes={b"[": b"(", b"]": b")", b"\\": b"/"})
FRAME = Frame("""
    frame, row by row
    0     u1 x taxels     touch
    ..    >i2 x 3         acceleration    [1 / 4096 g]
    ..    >i2 x 3         gyro            [1 / 131 deg/s]
    last  sum8            sum
""")
CHIP = points({"chip": (0.0, 0.0, -0.002)})
MOTION = {"low": -0x8000, "high": 0x7FFF}


class Mat(Device):
    """A mat with an IMU."""

    name = "mat"
    title = "Mat, 4x4 with an IMU"
    kind = "skin"
    ports = (Serial(baud=115200, usb=True),)
    senses = ("force", Sense("acceleration", at=CHIP), Sense("angular_velocity", at=CHIP))
    rate_hz = 50.0
    columns = (
        Column(name="touch", unit="N", counts_per_unit=100.0, low=0, high=255, push=1),
        *xyz("ax ay az", sense="acceleration", unit="m/s²", counts_per_unit=4096 / 9.80665, **MOTION),
        *xyz("gx gy gz", sense="angular_velocity", unit="rad/s", counts_per_unit=7505.747, **MOTION),
    )
    evidence = ("assumed",)
    sources = ("invented",)
    facts = (assumed("touch", "everything", "nothing: it is invented"),)

    def __init__(self):
        self.layout = grid_layout(4, 4, 0.01, name="mat")
        self.frame = FRAME.bind(wire_order=self.layout.wire_order)

    def stream(self, t_ns: int, name: str):
        """Return one frame."""
        touch, acceleration, gyro = self.counts["force"], self.counts["acceleration"], self.counts["angular_velocity"]
        return [STUFFING.wrap(self.frame.pack(touch=touch, acceleration=acceleration[0], gyro=gyro[0]))]
