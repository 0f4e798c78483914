"""Wonik Allegro Hand V5 and V5 Plus with fingertips that measure the pressure of the air in them, on CAN.

Wire: classic CAN, 1 Mbit/s, standard ids: the messages of the manual times four.

    id        message  data             direction   about
    200       80       remote           to hand     information: ``INFORMATION`` under the same id
    220       88       remote           to hand     serial number: 8 ASCII, the third B of a Plus, the fourth the side
    204       81       ``<u2 x 3``      to hand     periods [ms] of reports, IMU and temperatures; 0 stops them
    100, 104  40, 41   -                to hand     servo on, off: reports come only while it is on
    180 ..    60 ..    ``<i2 x 4``      to hand     currents [mA] of a finger: index, middle, ring, thumb
    380 ..    E0 ..    ``<i2 x 4``      to hand     positions of a finger: ignored
    80 .. 8C  20 .. 23 ``POSE``         to host     joints of a finger; on remote, too
    3C0, 3C8  F0, F2   ``PRESSURES``    to host     of index and middle finger, of ring finger and thumb
    0C0       30       remote           to hand     IMU: six bytes 0
    0E0 ..    38 ..    remote           to hand     temperatures of a finger [deg C], a byte each
    044, 048  11, 12   -                to hand     pick, place: ignored
    224       89       -                to hand     the present pose becomes 0; 248, without data, when that is done

The manual has the pressures under 50 and 52 (option ``pressures``), as old firmware sent them. A tip reads 0 under the
pressure of the air; the driver shows values below 0 or above 5000 Pa as 0.

Evidence: manual v1.3, chapter 11; a public driver, run, which was written on a V5 Plus.

Try it: ``tactemu exec allegro_v5_plus -- python examples/read_state.py`` of allegro_hand_v5_plus_python.
"""

from typing import Annotated, Literal

from firmware_protocols import (
    CanFrame, Column, Frame, Option, Request, Transmissions, command, fact_table, points, stack,
)  # fmt: skip
from firmware_protocols.devices.allegro_v5 import FINGER_SPACING_M, FINGERS, POSITIONS, TORQUES, AllegroV5

PRESSURES = Frame("""
    pressures of two fingertips
    0     <i4 x 2    pressures    [Pa] above that of the air
""")
INFORMATION = Frame("""
    information
    0     <u2        hardware
    2     <u2        firmware
    4     00 00      reserved
    6     01         reserved
""")
PRESSURE_IDS = {"F0": (0x3C0, 0x3C8), "50": (0x140, 0x148)}
PASCAL_PER_NEWTON = 300.0
COUNTS_PER_S_PER_MA = 10.0
IMU, TEMPERATURES, CALIBRATED = 0x0C0, range(0x0E0, 0x0F0, 4), 0x248
MANUAL = "Allegro Hand V5 (4F) user manual v1.3"
DRIVER = "ian-chuang/allegro_hand_v5_plus_python@649a5d4"
BUS = f"{DRIVER} src/allegro_hand_v5/bus.py"


class AllegroV5Plus(AllegroV5):
    """Four fingertips that report with sixteen joints."""

    name = "allegro_v5_plus"
    title = "Wonik Allegro Hand V5 Plus, fingertip pressure"
    columns = (Column(name="pressure", low=-71_300, high=23_700, assumed_per_unit=PASCAL_PER_NEWTON, push=1),)
    evidence = ("vendor document", "driver")
    sources = (f"{MANUAL} chapters 3, 11 (in {DRIVER} docs)", f"{DRIVER} src/allegro_hand_v5/protocol.py, bus.py")
    judge = DRIVER
    origin = BUS
    facts = fact_table(f"""
        stated touch: each frame has two int32 pressures [Pa]; the sensors measure 30 to 125 kPa, and ambient pressure
            reads 0 @ {MANUAL} 3, 11.3.7
        stated touch: the hand's messages F0 and F2, and 50 and 52 @ {DRIVER} protocol.py:82; {MANUAL} 11.2
        assumed touch: {PASCAL_PER_NEWTON:.0f} Pa/N; each sensor is one point, {FINGER_SPACING_M * 1000:.0f} mm from the
            next, all in one plane
        stated identity: the serial number has B for a Plus, and R or L for the side; one hand is 5TBR0017 @ {DRIVER}
            protocol.py:142; calibration_data
        assumed identity: 5TBR0001; hardware 0500, firmware 0100 (hex)
        stated identity: some hands do not answer a request for information @ {DRIVER} protocol.py:158
        stated configuration: the hand is silent until the servos are on and the periods are set @ {BUS}:230; docs,
            summary
        assumed configuration: pick, place and position commands have no effect; calibration makes the present pose 0
        assumed configuration: the IMU reads 0 and temperatures 25 deg C, both only on request; no error is sent
        assumed timing: pressures are sent with each report of the joints; a joint turns at
            {COUNTS_PER_S_PER_MA * 0.088:.2f} deg/s per mA
    """, looked=f"{MANUAL}; all of {DRIVER}")  # fmt: skip

    def __init__(
        self,
        *,
        side: Annotated[Literal["right", "left"], Option("which hand: a letter of the serial number")] = "right",
        pressures: Annotated[Literal["F0", "50"], Option("first message of the pressures")] = "F0",
    ):
        tips = {finger: ((k - 1.5) * FINGER_SPACING_M, 0.0, 0.0) for k, finger in enumerate(FINGERS)}
        self.layout = stack(*(points({f"{f} tip": at}, pitch=0.012, link=f) for f, at in tips.items()))
        self.pressure_ids, self.reports = PRESSURE_IDS[pressures], False
        self._power_up(f"5TB{'R' if side == 'right' else 'L'}0001")

    def stream(self, t_ns: int, name: str) -> Transmissions[CanFrame]:
        """Return the joints and the pressures, once each period while the servo is on."""
        if not (self.servo and self.reports):
            return ()
        pairs = zip(self.pressure_ids, self.layout.on_wire(self.counts).reshape(2, 2))
        pressures = [self.packets.frame(ident, PRESSURES.pack(pressures=pair)) for ident, pair in pairs]
        return [*self.poses(t_ns), *pressures]

    @command("200#R", "200#00050001000001", safe=True)
    def information(self, request: Request):
        """Return versions."""
        return INFORMATION.pack(hardware=0x0500, firmware=0x0100)

    @command("204#030000000000", name="reports every 3 ms", data="<3H")
    @command("204#000000000000", name="no reports")
    def periods_ms(self, request: Request):
        """Set the period of the reports."""
        self.reports = request.value > 0
        if self.reports:
            self.period_ns = request.value * 1_000_000

    @command("180#0A0014001E002800", name="currents of the index", on=TORQUES, data="<4h")
    def currents(self, request: Request):
        """Turn the joints of a finger while the servo is on."""
        if self.servo:
            first = 4 * TORQUES.index(request.id)
            speeds = [COUNTS_PER_S_PER_MA * current for current in request.values]
            self.motors.drive(speeds, request.t_ns, at=slice(first, first + 4))

    @command("100#")
    @command("100#", name="servo on, reporting", after=("204#030000000000",))
    def servo_on(self, request: Request):
        """Switch the servos on, and with them the reports."""
        self.servo = True

    @command("104#")
    def servo_off(self, request: Request):
        """Switch the servos off; the joints stand."""
        self.servo = False
        self.motors.drive(0.0, request.t_ns)

    @command("0C0#R", "0C0#000000000000", name="IMU", safe=True)
    def imu(self, request: Request):
        """Return the IMU's bytes."""
        return bytes(6)

    @command("0E0#R", "0E0#19191919", name="temperatures of the index", on=TEMPERATURES, safe=True)
    def temperatures(self, request: Request):
        """Return the temperatures of a finger's motors."""
        return bytes([25] * 4)

    @command("224#", "248#")
    def calibration(self, request: Request):
        """Make the present pose 0."""
        self.rest = self.motors.positions(request.t_ns)
        return [self.packets.frame(CALIBRATED)]

    @command("044#", name="pick", on=(0x044, 0x048, *POSITIONS), data="*")
    def ignored(self, request: Request):
        """Ignore pick, place and positions."""
