"""The joints, servos and identity of the hands of the Allegro V5 family, on CAN.

Their datasheets are :mod:`firmware_protocols.devices.allegro_v5_sense` and
:mod:`firmware_protocols.devices.allegro_v5_plus`.
"""

import numpy as np

from firmware_protocols import Can, CanFrame, CanRequests, Device, Frame, Motors, Request, command, quantize

POSE = Frame("""
    joints of a finger
    0     <i2 x 4    joints       [0.088 deg], from the palm to the tip
""")
JOINTS, TORQUES, POSITIONS = (range(first, first + 0x10, 4) for first in (0x80, 0x180, 0x380))
"""The identifiers of the fingers."""
RAD_PER_COUNT = np.radians(0.088)
STOP_COUNTS = 2045
SPEED_COUNTS_PER_S = 4000.0
FINGERS = ("index", "middle", "ring", "thumb")
FINGER_SPACING_M = 0.03


class AllegroV5(Device[CanFrame]):
    """The joints, servos and serial number that the hands share."""

    kind = "hand"
    ports = (Can(),)

    def _power_up(self, serial: str) -> None:
        self.serial = serial.encode("ascii")
        self.packets, self.servo, self.rest = CanRequests(), False, np.zeros(16)
        names = [f"{finger} {k}" for finger in FINGERS for k in range(4)]
        self.motors = Motors(
            [0.0] * 16, low=-STOP_COUNTS, high=STOP_COUNTS, time_constant_s=0.0, speed_limit=SPEED_COUNTS_PER_S,
            names=names, unit=RAD_PER_COUNT,
        )  # fmt: skip

    @command("220#R", "220#..{8}", safe=True)
    def serial_number(self, request: Request):
        """Return the serial number."""
        return self.serial

    @command("08C#R", "08C#..{8}", name="joints of the thumb", on=JOINTS, safe=True)
    def joints_of_finger(self, request: Request):
        """Return the joints of a finger."""
        return self._pose(JOINTS.index(request.id), request.t_ns)

    def poses(self, t_ns: int) -> list[CanFrame]:
        """Return the joints of all fingers."""
        return [self.packets.frame(ident, self._pose(k, t_ns)) for k, ident in enumerate(JOINTS)]

    def _pose(self, finger: int, t_ns: int) -> bytes:
        counts = quantize(self.motors.positions(t_ns) - self.rest, 1.0, -0x8000, 0x7FFF)
        return POSE.pack(joints=counts[4 * finger :][:4])

    @command("100#")
    def servo_on(self, request: Request):
        """Switch the servos on."""
        self.servo = True

    @command("104#")
    def servo_off(self, request: Request):
        """Switch the servos off."""
        self.servo = False

    def _go(self, finger: int, request: Request) -> None:
        own = slice(4 * finger, 4 * finger + 4)
        self.motors.go(request.values + self.rest[own], request.t_ns, at=own)
