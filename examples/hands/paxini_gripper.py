"""The gripper of paxini_gripper.toml: two Feetech servos and two PaXini pads, driven by their vendors' SDKs alone.

One servo closes both fingers by a pinion of 40 mm, another moves the gripper along x. Measure the numbers below on a
real gripper.
"""

import math
import time
from collections.abc import Iterator

import scservo_sdk
from paxini_sdk import HighSpeedHandBoard

CARRIAGE, FINGERS = 1, 6  # ids of the servos
GOAL, TORQUE_ON, POSITION, MIDDLE = 42, 40, 56, 2048  # registers; position at 0 m
STEPS_PER_METRE = 4096 / (2 * math.pi) / 0.02
COUNTS_PER_NEWTON = 2 * 0.02 / 2.94 * 1000  # torque limit per newton on each pad
TOUCH, CLOSING, SPEED = 0.3, 0.8, 250  # [N] on a pad in contact; [N] and [steps/s] before contact
NEWTONS_PER_NEWTON_S = 4.0  # speed of the correction per newton of error
PADS = ("Thumb-Tip", "Index-Tip")

Force = tuple[float, float, float]


class Gripper:
    """The servos and pads of the gripper, each on its port.

    Args:
        servos, pads: names of the ports.
    """

    def __init__(self, servos: str, pads: str):
        self._port, self._bus = scservo_sdk.PortHandler(servos), scservo_sdk.PacketHandler(0)
        if not (self._port.openPort() and self._port.setBaudRate(1_000_000)):
            raise SystemExit(f"{servos}: cannot be opened")
        self._board = HighSpeedHandBoard(pads).open()
        self.newtons = CLOSING
        for servo in (FINGERS, CARRIAGE):
            while self._bus.write1ByteTxRx(self._port, servo, TORQUE_ON, 1)[0] != scservo_sdk.COMM_SUCCESS:
                pass

    def close(self) -> None:
        """Close both ports; the servos continue."""
        self._board.close()
        self._port.closePort()

    def go(self, servo: int, metres: float, speed: float, newtons: float = 30.0) -> None:
        """Send a servo to a position, with a speed [steps/s] and a force limit per pad; the servo does not answer."""
        steps, torque = round(MIDDLE + metres * STEPS_PER_METRE), round(newtons * COUNTS_PER_NEWTON)
        group = scservo_sdk.GroupSyncWrite(self._port, self._bus, GOAL, 8)  # goal, pwm, speed, torque limit
        values = (steps, 0, round(speed), min(max(torque, 1), 1000))
        group.addParam(servo, [byte for value in values for byte in value.to_bytes(2, "little")])
        group.txPacket()

    def press(self, newtons: float) -> None:
        """Close with a force [N]."""
        self.newtons = newtons
        self.go(FINGERS, 0.045, SPEED, newtons)

    def correct(self, wanted: float, measured: float, seconds: float) -> None:
        """Close a little harder or softer, to approach the wanted force [N]."""
        self.press(min(max(self.newtons + NEWTONS_PER_NEWTON_S * seconds * (wanted - measured), 0.1), 30.0))

    def carriage(self) -> float:
        """Return the position of the gripper [m]."""
        while True:
            data, result, _ = self._bus.readTxRx(self._port, CARRIAGE, POSITION, 2)
            if result == scservo_sdk.COMM_SUCCESS and len(data) == 2:  # not a late answer to another request
                return (int.from_bytes(bytes(data), "little") - MIDDLE) / STEPS_PER_METRE

    def readings(self) -> Iterator[tuple[float, list[Force], list[list[Force]]]]:
        """Yield the time since the last reading [s], the forces on both pads, and on all taxels of each [N]; 90 times a
        second."""
        last = time.monotonic()
        for frame in self._board.stream_auto_push():
            now = time.monotonic()
            sums, taxels = frame.resultant_forces_newtons, frame.distributed_forces_newtons
            yield min(now - last, 0.1), [sums[pad] for pad in PADS], [taxels[pad] for pad in PADS]
            last = now
