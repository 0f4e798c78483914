"""iCub skin and inertial sensors: the boards of the skin (MTB4, MTB), which send acceleration and rotation beside it.

Wire: as ``icub_skin``, and a message more, host to board b, id 0x200 | b, never answered:

    4F sensors period    2 accelerometer on the board, 8 beside it, 4 gyroscope, 0 none; each sends ``AXES`` every so
                         many ms, the accelerometer's first

An MTB4 has a BNO055, 100 per m/s2 and 16 per deg/s; it sends nothing at a period of 0. An MTB (option ``firmware=old``)
has a LIS331DLH, 1000 steps of 16 per g, and a L3G4200D, 8.75 mdeg/s; it sends the gyroscope's first, every ms after
power-up; a period of 0 changes nothing of that, and every 4F recalibrates its triangles. The robot's driver sends 0.

Evidence: firmware of the boards and the robot's own driver (YARP ``canBusInertialMTB``), run on an MTB.

Try it: ``tactemu run icub_inertials part=hand --port can:socketcan:vcan0``, then
``cansend vcan0 201#4F0C0A; candump vcan0``
"""

from math import pi
from typing import Any

import numpy as np

from firmware_protocols import (
    CanFrame, Column, Command, Counts, Frame, Quantity, Reading, Sense, Stream, Transmissions, command_table,
    fact_table, points, quantize, xyz,
)  # fmt: skip
from firmware_protocols.devices.icub_board import HEAD, OLD_CLASS, TAIL
from firmware_protocols.devices.icub_skin import IcubSkin

AXES = Frame("""
    three axes, id 101 bbbb 000s (b board, s sensor)
    0    <i2 x 3   axes    x y z; sensor 0: angular velocity, 1: acceleration
""")
INERTIAL_CLASS, SET_UP = 5, 0x4F
ANGULAR_VELOCITY, ACCELERATION = 0, 1
"""The sensors in the identifiers."""
GYROSCOPE_BIT, ACCELEROMETER_BITS, OLD_ACCELEROMETER_BITS = 0x04, 0x0B, 0x0A
"""The bits of message 4F that enable a sensor; bit 0 of an MTB is an analogue accelerometer, which is not modelled."""
NS_PER_MS = 1_000_000
PER_M_S2, PER_RAD_S = 100.0, 16 * 180 / pi
OLD_STEPS_PER_M_S2, OLD_STEP, OLD_PER_RAD_S = 1000 / 9.80665, 16, 1 / 0.00875 * 180 / pi
"""The scales of an MTB; its accelerometer has 12 bits, left-justified."""
POWER_UP_HZ = 20.0
"""The rate at which a silent board samples; no frame shows it."""
LIMITS: dict[str, Any] = {"low": -0x8000, "high": 0x7FFF}
SKIN: tuple[Quantity, ...] = ("force", "temperature")
INERTIAL: tuple[Quantity, ...] = ("acceleration", "angular_velocity")
DRIVER = "icub-main@24c1a00 CanBusInertialMTB.cpp"
MTB4 = "icub-firmware embot_app_application_theIMU.cpp"


class Inertials:
    """The accelerometer and the gyroscope of one board, silent after power-up."""

    def __init__(self, address: int, is_old: bool):
        self.address, self.is_old = address, is_old
        self.enabled, self.period_ns = 0, NS_PER_MS
        self.axes = {key: np.zeros((1, 3), int) for key in self.keys}

    @property
    def keys(self) -> tuple[str, str]:
        """The keys of the senses: acceleration, angular velocity."""
        return f"acceleration {self.address}", f"angular_velocity {self.address}"

    def senses(self, place: np.ndarray) -> tuple[Sense, ...]:
        """Return the senses of sensors at ``place`` [m], in the axes of the link."""
        at = points({f"board {self.address}": place.tolist()})
        return tuple(Sense(quantity, at=at, name=key) for quantity, key in zip(INERTIAL, self.keys))

    def columns(self) -> tuple[Column, ...]:
        """Return the columns of both sensors."""
        per_m_s2 = OLD_STEPS_PER_M_S2 * OLD_STEP if self.is_old else PER_M_S2
        per_rad_s = OLD_PER_RAD_S if self.is_old else PER_RAD_S
        acceleration, rotation = self.keys
        return (
            *xyz("ax ay az", sense=acceleration, unit="m/s²", counts_per_unit=per_m_s2, **LIMITS),
            *xyz("gx gy gz", sense=rotation, unit="rad/s", counts_per_unit=per_rad_s, **LIMITS),
        )

    def set_up(self, data: bytes) -> None:
        """Enable sensors at a period [ms]; a period of 0 leaves that of an MTB as it is, and stops an MTB4."""
        self.enabled, period = (*data[1:3], 0, 0)[:2]
        if period:
            self.period_ns = period * NS_PER_MS
        elif not self.is_old:
            self.enabled = 0

    def convert(self, reading: Reading) -> dict[str, np.ndarray]:
        """Return the counts of acceleration and angular velocity, each shape ``(1, 3)``."""
        acceleration, rotation = (reading[key] for key in self.keys)
        if self.is_old:
            steps = quantize(acceleration, OLD_STEPS_PER_M_S2, -2048, 2047)
            counts = steps * OLD_STEP, quantize(rotation, OLD_PER_RAD_S, **LIMITS)
        else:
            counts = quantize(acceleration, PER_M_S2, **LIMITS), quantize(rotation, PER_RAD_S, **LIMITS)
        self.axes = dict(zip(self.keys, counts))
        return self.axes

    def frames(self) -> list[CanFrame]:
        """Return a frame for each enabled sensor, in the order of the firmware."""
        bits = OLD_ACCELEROMETER_BITS if self.is_old else ACCELEROMETER_BITS
        sent = [
            CanFrame(arbitration_id=INERTIAL_CLASS << 8 | self.address << 4 | sensor, data=AXES.pack(axes=axes[0]))
            for sensor, bits, axes in zip((ACCELERATION, ANGULAR_VELOCITY), (bits, GYROSCOPE_BIT), self.axes.values())
            if self.enabled & bits
        ]
        return sent[::-1] if self.is_old else sent


class IcubInertials(IcubSkin):
    """The skin of one part, with an accelerometer and a gyroscope on each of its boards."""

    name = "icub_inertials"
    tables = (HEAD, TAIL, AXES)
    sources = (
        *IcubSkin.sources,
        f"{DRIVER}, embObjIMU/eo_imu_privData.cpp",
        f"{MTB4}, embot_prot_can_inertial_periodic.cpp; MTB3 main.c, can_interface.c (2.10.14)",
        "icub-firmware-shared@62f2818 can/canProtocolLib/iCubCanProto_types.h",
    )
    facts = (
        *IcubSkin.facts,
        *fact_table(f"""
        stated touch: the axes of inertial sensors are sent low byte first @ {DRIVER} run;
            embot_prot_can_inertial_periodic.cpp
        stated touch: the bit that enables each sensor @ iCubCanProto_types.h; {MTB4} set
        stated touch: the acceleration is sent first by an MTB4 and last by an MTB @ {MTB4} processdata; MTB3 main.c
        stated touch: MTB4: 100 counts per m/s2, 16 counts per deg/s @ icub-main@24c1a00 eo_imu_privData.cpp:162-168
        stated touch: MTB: 1 mg per step, 12 bits, left-justified, range 2 g; 8.75 mdeg/s per count, range 250 deg/s @
            MTB3 lis331dlh.c, l3g4200d.c; linux drivers/iio st_accel_core.c, st_gyro_core.c
        assumed touch: an inertial sensor sits in the middle of its board's taxels, with the axes of the link @ all of
            these
        stated configuration: silent after power-up; message 4F sets sensors and period, and gets no answer @ {MTB4}
            set; MTB3 can_interface.c
        stated configuration: a period of 0 stops an MTB4 and has no effect on an MTB @ {MTB4} set; MTB3 can_interface.c
        stated configuration: 4F recalibrates the triangles of an MTB @ MTB3 can_interface.c
        assumed configuration: other messages for an IMU (orientation, magnetometer) get no answer @ left out; {MTB4}
        stated timing: a reading is sent every n ms; by an MTB every 1 ms after power-up @ {MTB4} start; MTB3 main.c
            TIMER_VALUE2
    """, looked="theIMU.cpp, MTB3 main.c"),
    )  # fmt: skip

    def __init__(self, **options):
        super().__init__(**options)
        self.title = self.title.replace("iCub skin", "iCub skin and inertial sensors")
        is_old = next(iter(self.boards.values())).family == OLD_CLASS
        self.inertials = {f"inertials {each.address}": Inertials(each.address, is_old) for each in self.boards.values()}
        places = [self.layout.positions[board.taxels].mean(axis=0) for board in self.boards.values()]
        own = list(self.inertials.values())
        self.senses = (*SKIN, *(sense for each, place in zip(own, places) for sense in each.senses(place)))
        self.columns = (*self.columns, *(column for each in own for column in each.columns()))
        skin = {name: Stream(each.rate_hz, SKIN) for name, each in self.streams.items()}
        self.streams = {**skin, **{name: Stream(POWER_UP_HZ, each.keys) for name, each in self.inertials.items()}}

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return, by sense, each taxel's value, other boards as before; or the axes of one board, shape ``(1, 3)``."""
        if own := self.inertials.get(reading.stream):
            return own.convert(reading)
        return {"force": np.asarray(super().measure(reading, t_ns))}

    def stream(self, t_ns: int, name: str) -> Transmissions[CanFrame]:
        """Return the frames of a board's triangles, or of its inertial sensors."""
        if own := self.inertials.get(name):
            return own.frames()
        return super().stream(t_ns, name)

    def set_up(self, name: str, data: bytes) -> bool:
        """Obey one message to a board; return False if it does not know it."""
        if data[:1] != bytes([SET_UP]):
            return super().set_up(name, data)
        board = self.boards[name]
        stream = f"inertials {board.address}"
        own = self.inertials[stream]
        own.set_up(data)
        if own.enabled:
            self.periods[stream] = own.period_ns
        if own.is_old:
            board.calibrate()
        return True

    @property
    def commands(self) -> tuple[Command, ...]:
        """The commands of the skin, and those of the inertial sensors' driver, to the first board."""
        b = f"{next(iter(self.boards.values())).address:X}"
        own = command_table(f"""
            @ {DRIVER}
            accelerometer of the board   20{b}#4F 02 00  -
            sensors beside the board     20{b}#4F 0C 0A  -  every 10 ms
            no inertial sensors          20{b}#4F 00 01  -
        """)
        return (*super().commands, *own)
