r"""OptoForce (OnRobot) OMD force sensors: domes of 3 axes, one or four of them, or 6 axes, behind the DAQ.

Wire: USB-CDC, 04D8:000A "OptoForce DAQ", opened at 1 000 000 8N1. All numbers big-endian; every packet ends in the
16-bit sum of the bytes before it. Host to device ``CONFIGURE``, answered by ``CONFIGURED``, and AB 00 12 08 and its
sum, answered by ``SERIAL_NUMBER``; ``DATA`` unasked, its length 0A with 3 axes, 1C with 4 x 3, 10 with 6.

    speed   0 stops, 1, 3, 10, 33, 100: period [ms]
    cutoff  0 none, 1..6: low-pass at 500, 150, 50, 15, 5, 1.5 Hz
    zero    FF: what is measured now becomes zero, 00: no zero

Status: bits 9..4 overload of Fx Fy Fz Tx Ty Tz, bit 3 more than one sensor, bits 2..0 the sensor. The manual of the
same vendor's Ethernet converter (``onrobot_hex``) has the axes in reverse, Fx in bit 4; the driver's author had the
DAQ's manual, but no sensor to test it.

On CAN (``optoforce_can``, 1 Mbit/s) the packet of 3 axes comes in two frames of eight bytes, 100; a configuration goes
in two frames, of eight bytes and of one, to 101, and no driver reads an answer.

The driver checks the sum but leaves the decision to its user (``valid_checksum``), and skips the answer to a
configuration.

Try it: ``tactemu exec optoforce -- python``, then ``OptoForce16(speed_hz=100).connect()``, which finds it by its USB
text.
"""

import re
from typing import Annotated, Any, Literal

import numpy as np

from firmware_protocols import (
    NO_PACKET, SOUND, USB, Can, CanFrame, Device, Frame, Layout, LowPass, Option, Packets, Patch, Refused, Request,
    Rollover, Sense, Serial, Transmissions, command, command_table, fact_table, points, xyz,
)  # fmt: skip
from firmware_protocols.sums import sum16

DATA = Frame("""
    data, dome by dome
    0     AA 07 08        head
    3     u1              length = total - 6
    4     >u2             counter    of packets, or of samples [ms]
    6     >u2             status
    8     >i2 x values    values     Fx Fy Fz of each dome, or Fx Fy Fz Tx Ty Tz
    last  >sum16          sum
""")
CONFIGURE = Frame("""
    configure
    0     AA 00 32 03     head
    4     u1              speed
    5     u1              cutoff
    6     u1              zero
    last  >sum16          sum
""")
CONFIGURED = Frame("""
    answer to it
    0     AA 00 50 01     head
    4     u1              code       0 accepted, 1 wrong sum, 2 wrong value
    last  >sum16          sum
""")
SERIAL_NUMBER = Frame("""
    answer to the serial number's request
    0     AA 00 12 08     head
    4     bytes x 8       characters
    last  >sum16          sum
""")
SERIAL_REQUEST = b"\xab\x00\x12\x08"
ACCEPTED, BAD_SUM, BAD_VALUE = range(3)

PERIODS_MS = (0, 1, 3, 10, 33, 100)
CUTOFF_HZ = (None, 500.0, 150.0, 50.0, 15.0, 5.0, 1.5)
ZERO = 0xFF
NO_ZERO = 0x00

COUNTS_PER_NEWTON = (7925 / 300, 8641 / 300, 6049 / 2000)
COUNTS_PER_NEWTON_METRE = 1000.0
CAPACITIES = np.array([300.0, 300.0, 2000.0, 30.0, 30.0, 30.0])
"""The loads on each axis beyond which the status shows overload [N, Nm]."""
FROM_SENSOR, TO_SENSOR = 0x100, 0x101
"""The identifiers on CAN."""
BLMC = "open-dynamic-robot-initiative/python_blmc@401544d"
FORCE_PLACES_M = {
    "3": [(0.0, 0.0, 0.01)],
    "4x3": [(x, y, 0.01) for y in (0.01, -0.01) for x in (-0.01, 0.01)],
    "6": [(0.0, 0.0, 0.05)],
}


class OptoForce(Device):
    """Force sensors that stream unasked and obey a configuration packet."""

    name = "optoforce"
    kind = "force-torque sensor"
    ports = (Serial(baud=1_000_000, usb=USB(0x04D8, 0x000A, product="OptoForce DAQ")),)
    evidence = ("captured", "driver")
    sources = (
        "alknemeyer/optoforce@88cfbf5 (optoforce 0.3.0) __init__.py, reading.py, status.py",
        "shadow-robot/optoforce@fe3c086 (an independent driver that agrees), issue 31 (326 captured bytes, 6 axes)",
    )
    judge = "optoforce 0.3.0, shadow-robot/optoforce@fe3c086"
    documented = command_table("""
        @ optoforce@88cfbf5 __init__.py connect()
        100 Hz, 15 Hz filter      AA 00 32 03 0A 04 00 00 ED  AA 00 50 01 00 00 FB
        1000 Hz, no filter, zero  AA 00 32 03 01 00 FF 01 DF  AA 00 50 01 00 00 FB
        stop                      AA 00 32 03 00 04 00 00 E3  AA 00 50 01 00 00 FB
        @ shadow-robot/optoforce@fe3c086
        ? serial number           AB 00 12 08 00 C5           AA 00 12 08 ..{8} ..{2}
    """)
    documented_with = None
    facts = fact_table("""
        stated touch: the counts of each axis, divided by a number from the sensor's sensitivity report, are N @
            optoforce 0.3.0 reading.py:4-6, shadow-robot/optoforce README.md (Quickstart), config/*.yaml
        assumed touch: each dome is a taxel at its top, 10 mm above the base; four domes are 20 mm apart; a push makes
            Fz positive; with 6 axes the force acts 50 mm above the flange @ both drivers, all files; issue 31
        assumed touch: with 6 axes: 1000 counts/Nm, a capacity of 30 Nm, and overload beyond 300, 300 and 2000 N @
            optoforce 0.3.0 __init__.py:211 (it has no sheet for torques), shadow-robot config/*.yaml
        stated identity: USB ids 04D8:000A, name OptoForce DAQ; serial numbers such as ISE174 @ shadow-robot/optoforce
            optoforce.rules, README.md; optoforce 0.3.0 __init__.py:55
        stated identity: the answer to AB 00 12 08 00 C5 has eight characters; the driver strips blanks @
            shadow-robot/optoforce src/optoforce/optoforce.py:83, 191-201, 316-321
        stated configuration: the speeds, cutoffs and zero of CONFIGURE; its answer has seven bytes @ optoforce 0.3.0
            __init__.py:33-52, shadow-robot optoforce.py:53-75
        stated configuration: the bits of the status word @ optoforce 0.3.0 status.py (untested, as it says)
        stated configuration: the maker's Ethernet box starts at 100 Hz with the 15 Hz filter, which are the defaults of
            both drivers @ Optoforce_ethernet_converter_manual.pdf 8.5, 8.6; both drivers
        assumed configuration: the DAQ does so as well; the filter is a first-order low-pass; answers begin AA 00 50 01,
            then 0 for accepted, 1 wrong sum, 2 wrong value @ both drivers, which skip the answer
        measured timing: the counter of a captured 6-axis sensor counts samples at 1 kHz @ shadow-robot/optoforce issue
            31, 326 bytes
        assumed timing: by default it counts packets (option ``counter``) @ both drivers, which do not look at it
    """)

    def __init__(
        self,
        *,
        axes: Annotated[Literal["3", "4x3", "6"], Option("one dome, four domes, or force and torque")] = "3",
        counts_per_newton: Annotated[
            tuple[float, float, float], Option("scale of Fx, Fy, Fz, as on the calibration sheet", unit="1/N", low=1e-6)
        ] = COUNTS_PER_NEWTON,
        serial_number: Annotated[str, Option("serial number of up to eight characters")] = "ISE001",
        counter: Annotated[
            Literal["packets", "samples"], Option("what the counter counts; samples of 1 kHz in a captured sensor")
        ] = "packets",
    ):
        self.title = f"OptoForce / OnRobot OMD force sensor, {axes} axes"
        places = np.array(FORCE_PLACES_M[axes])
        patch = Patch(name="domes", start=0, rows=0, cols=len(places), pitch=0.02)
        self.layout = Layout(positions=places, normals=np.array([0.0, 0.0, 1.0]), patches=(patch,))
        limits: dict[str, Any] = {"low": -0x8000, "high": 0x7FFF}
        self.columns = xyz("Fx Fy Fz", push=1, unit="N", counts_per_unit=counts_per_newton, **limits)
        if axes == "6":
            self.senses = (Sense("wrench", at=points({"flange": (0.0, 0.0, 0.0)})),)
            self.columns += xyz("Tx Ty Tz", unit="Nm", counts_per_unit=COUNTS_PER_NEWTON_METRE, **limits)
        self.rollovers = (Rollover(name="counter", bits=16, step=10 if counter == "samples" else 1, state="counter"),)
        self.serial_number = serial_number.encode("ascii").ljust(8)[:8]
        self.packets = Packets(b"", _size, _check, counters=self.counters, broken=True)
        self.table = DATA.bind(values=len(places) * len(self.columns))
        self.low_pass = LowPass(15.0)
        self.streaming, self.counter = True, 0
        self.counts_samples = counter == "samples"

    def filtered(self, values: np.ndarray, t_ns: int) -> np.ndarray:
        """Return the values behind the low-pass."""
        return self.low_pass(values, t_ns)

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return one data packet."""
        if not self.streaming:
            return ()
        self.counter = (self.counter + (self.period_ns // 1_000_000 if self.counts_samples else 1)) & 0xFFFF
        overloaded = (np.abs(self.present) > CAPACITIES[: len(self.columns)]).any(axis=0)
        status = sum(1 << 9 - axis for axis in np.flatnonzero(overloaded).tolist())
        values = self.layout.on_wire(self.counts).ravel()
        return [self.table.pack(counter=self.counter, status=status, values=values)]

    @command(pattern=SERIAL_REQUEST + b"..")
    def serial(self, request: Request):
        """Return the serial number."""
        return SERIAL_NUMBER.pack(characters=self.serial_number)

    @command(pattern=re.escape(CONFIGURE.head) + b".....")
    def configure(self, request: Request):
        """Set speed, filter and zero."""
        wanted = CONFIGURE.unpack(request.packet) or {}
        speed, cutoff, zero = wanted["speed"], wanted["cutoff"], wanted["zero"]
        if speed not in PERIODS_MS or cutoff >= len(CUTOFF_HZ) or zero not in (ZERO, NO_ZERO):
            raise Refused("value")
        self.streaming = speed > 0  # conversion continues, so that a later zero takes the force at that time
        if speed:
            self.period_ns = speed * 1_000_000
        self.low_pass.cutoff_hz = CUTOFF_HZ[cutoff]
        self.zero = self.present if zero == ZERO else 0.0
        return CONFIGURED.pack(code=ACCEPTED)

    def refused(self, request: Request, why: str) -> Transmissions:
        """Return the answer to a configuration that is wrong."""
        if request.packet.startswith(SERIAL_REQUEST):
            return ()
        return [CONFIGURED.pack(code=BAD_SUM if why == "bad_checksum" else BAD_VALUE)]


class OptoForceCan(OptoForce):
    """A dome on CAN, whose packets come in frames."""

    name = "optoforce_can"
    tables = (DATA, CONFIGURE)
    ports = (Can(filters=((TO_SENSOR, 0x7FF),)),)
    evidence = ("driver",)
    sources = (f"{BLMC} blmc/optoforce.py, scripts/read_optoforce.py", *OptoForce.sources)
    judge = BLMC
    documented = command_table(
        """
        100 Hz, 15 Hz filter      101#AA0032030A040000; 101#ED
        1000 Hz, no filter, zero  101#AA0032030100FF01; 101#DF
        stop                      101#AA00320300040000; 101#E3
        """,
        origin=f"{BLMC} blmc/optoforce.py OptoForceConfig",
    )
    facts = (
        *OptoForce.facts,
        *fact_table(f"""
        stated touch: packets of 3 axes are sent in two frames with id 100; a sensor of 40 N has 16037 counts @ {BLMC}
            blmc/optoforce.py:10, 159-180
        stated configuration: a packet to the sensor has id 101, in a frame of eight bytes and one of one byte @ {BLMC}
            blmc/optoforce.py:124-139
        assumed configuration: the sensor does not answer on CAN; an incomplete packet is dropped when the next one
            begins @ {BLMC}, all files
        """),
    )

    def __init__(
        self,
        *,
        counts_per_newton: Annotated[
            tuple[float, float, float], Option("scale of Fx, Fy, Fz, as on the calibration sheet", unit="1/N", low=1e-6)
        ] = (16037 / 40, 16037 / 40, 16037 / 40),
    ):
        super().__init__(counts_per_newton=counts_per_newton)
        self.title = "OptoForce OMD force sensor on CAN, 3 axes"

    def stream(self, t_ns: int, name: str) -> Transmissions[Any]:
        """Return the frames of one data packet."""
        packet = b"".join(each for each in super().stream(t_ns, name) if isinstance(each, bytes))
        return [CanFrame(arbitration_id=FROM_SENSOR, data=packet[k : k + 8]) for k in range(0, len(packet), 8)]

    def receive(self, data: Any, t_ns: int, port: str) -> Transmissions[Any]:
        """Obey configurations, whose parts are in frames."""
        if data != CanFrame(arbitration_id=TO_SENSOR, data=data.data):
            self.counters["ignored"] += 1
        else:
            super().receive(data.data, t_ns, port)
        return ()


def _size(data: bytes) -> int | str:
    """Return the length of the packet at the start of ``data`` [bytes], or a mark that there is none."""
    for head, size in ((CONFIGURE.head, 9), (SERIAL_REQUEST, 6)):
        if head.startswith(data[:4]):
            return size
    return NO_PACKET


def _check(packet: bytes) -> str:
    return SOUND if sum16(packet[:-2]) == int.from_bytes(packet[-2:], "big") else "bad_checksum"
