"""A short run with every kind of entry."""

from typing import Literal

import numpy as np

from firmware_protocols import CanFrame, WireFrame
from tactemu.truth import Passage, Truth

CAN = CanFrame(arbitration_id=0x18FF0001, data=b"\x11" * 16, is_extended_id=True, is_fd=True, bitrate_switch=True)
COUNTS = np.array([[0.1, -2.5e-30], [1e30, 3.0]], np.float32)
IDEAL = np.array([[0.1, 0.2, -0.3], [np.pi, 1e-300, np.nextafter(1, 2)]])


def passed(t_ns: int, frame: WireFrame, kind: Literal["tx", "rx"] = "tx") -> Passage:
    """Return a frame as a recording has it."""
    return Passage(t_ns, "", kind, frame)


def tell(truth: Truth) -> None:
    """Log the run of two skins on one bus, one of them with two senses."""
    for k in range(3):
        number = truth.sample(10 * k, "thumb", IDEAL * k, IDEAL / 7, COUNTS, number=k, sense="force")
    truth.sample(20, "thumb", np.ones(6, np.float32), np.ones(6, np.float32) / 3, np.arange(6, dtype=">i2"), number=2,
                 sense="imu")  # fmt: skip
    truth.sample(21, "index", np.array([True, False]), np.array([True, True]), np.array([1, 0], np.uint8))
    truth.wrote(22, "thumb", b"\x01\xff", sample=number)
    truth.wrote(23, "index", CAN, sample=0)
    truth.received(24, "thumb+index", CanFrame(arbitration_id=0x27, data=b"\xb1\xc6"))
    truth.inject(25, "thumb+index", "flip", "flip 5% [to_driver]", before=b"\x00", after=[b"\x01", CAN], frame=12)
    truth.inject(26, "thumb", "flip", "byte 3 bit 1")
    truth.inject(27, "thumb", "set", "noise", before="0", after=("0.1",))
    truth.dropped(28, "thumb", b"\x00", "line full")
    truth.event(29, "thumb", "opened")


class Around:
    """A scene with a body that is elsewhere at each of the first calls."""

    names = ("ball",)

    def __init__(self):
        self.looks = 0

    def poses(self) -> np.ndarray:
        """Return the pose, one step further than before."""
        self.looks += self.looks < 2
        return np.array([[0.1 * self.looks, np.pi, -1, 1, 0, 0, 0]])

    def description(self) -> dict:
        """Return the description of a scene."""
        return {"bodies": [{"name": "ball"}], "skins": {}}
