"""Aidin Robotics AFT200-D80-C: a six-axis force-torque sensor on CAN.

Wire: classic CAN, 1 Mbit/s, standard ids. Each conversion is two frames of ``AXES``, high byte first, from power-up on
or after command 03: force under the sensor's id, as delivered 001, and torque under the next one. Commands go to 102,
in three bytes or more; no sensor answers them.

    data of 102     about
    id 01 new       set the id, which is saved
    id 02 01        bias: what is measured then is zero; silence for 1 s, then six frames, the last under id + 5
    id 02 02        no bias
    id 03 01        transmit continuously
    id 05 u16       set the period [us]
    FF FF           set the ids of all sensors to 001

Evidence: a laboratory's driver for Kvaser adapters, the example for python-can that the maker's became.

Try it: ``tactemu run aidin_aft200 --port can:socketcan:vcan0``, then ``candump vcan0``.
"""

from typing import Annotated

from firmware_protocols import (
    Can, CanFrame, CanRequests, Device, Frame, Option, Refused, Request, Sense, Tool, Transmissions, command,
    fact_table, points, wrench,
)  # fmt: skip

AXES = Frame("""
    force, or torque
    0     >u2 x 3     axes        x y z: 0.01 N from -300 N, or 0.002 Nm from -50 Nm
    6     00 00       unused
""")
COMMANDS_ID = 0x102
SET_ID, BIAS, TRANSMIT, PERIOD = 1, 2, 3, 5
ALL_SENSORS = 0xFF
SILENCE_NS = 1_000_000_000
DRIVER = "rise-lab-skku/rise-aft-can@8aceaea"
EXAMPLE = "ddoihyun/Neuromeka_AFT200-D80-C@9f1a11e"
BOTH = "rise_aft_can, example, README.md; sample.py, main.py (all whole)"


class AidinAft200(Device[CanFrame]):
    """A sensor that transmits unasked."""

    name = "aidin_aft200"
    title = "Aidin Robotics AFT200-D80-C force-torque sensor"
    kind = "force-torque sensor"
    ports = (Can(filters=((COMMANDS_ID, 0x7FF),)),)
    senses = (Sense("wrench", at=points({"origin": (0.0, 0.0, 0.0)})),)
    columns = wrench("Fx Fy Fz Tx Ty Tz", per_unit=(100, 500), low=0, high=0xFFFF, rest=[30_000] * 3 + [25_000] * 3)
    evidence = ("driver",)
    sources = (f"{DRIVER} rise_aft_can/sensors.py", f"{EXAMPLE} sample.py, main.py")
    judge = f"{DRIVER}, {EXAMPLE}"
    origin = f"{DRIVER} rise_aft_can/sensors.py:96-166"
    documented_with = ("tool",)
    facts = fact_table(f"""
        stated touch: force is output / 100 - 300 N and torque output / 500 - 50 Nm, high byte first @ {DRIVER}
            rise_aft_can/ sensors.py:68-85; {EXAMPLE} sample.py:86-111
        stated touch: the last two bytes are 00 @ {EXAMPLE} sample.py:33-34
        assumed touch: the tool is touched at the point `tool`, z points out of the tool side; counts saturate at the
            limits of 16 bits @ {BOTH}
        stated identity: force has the CAN id 1, torque the id 2 @ {DRIVER} rise_aft_can/sensors.py:51-55
        stated configuration: the commands sent under the id 102 @ {DRIVER} rise_aft_can/sensors.py:96-166
        stated configuration: it transmits without a command from power-up on @ {EXAMPLE} sample.py:57-59
        stated configuration: setting the bias takes a second; frames with ids up to 6 follow @ {DRIVER} rise_aft_can/
            sensors.py:88-92, 112-141
        assumed configuration: the content of these frames; the bias is lost at power-off, id and period are saved;
            values out of range are refused @ {BOTH}
        assumed timing: 1000 readings a second after power-up, the default of `set_sampling_rate` @ {BOTH}
    """)

    def __init__(
        self,
        *,
        tool: Tool = (0.02, 0.01, 0.05),
        can_id: Annotated[int, Option("id of the force, as delivered", low=1, high=0x7F0)] = 1,
    ):
        self.layout = points({"tool": tool})
        self.packets = CanRequests()
        self.id = self.flash.get("id", can_id)
        self.rate_hz = 1e6 / self.flash.get("period_us", 1000)

    def stream(self, t_ns: int, name: str) -> Transmissions[CanFrame]:
        """Return force and torque, but during a bias."""
        if self.wake_ns is not None:
            return ()
        return [self.packets.frame(self.id + k, AXES.pack(axes=self.counts[0, 3 * k : 3 * k + 3])) for k in (0, 1)]

    def wake(self, t_ns: int) -> Transmissions[CanFrame]:
        """Return what follows a bias."""
        return [self.packets.frame(self.id + k, bytes(8)) for k in range(6)]

    @command("102#0103010000000000", name="transmit", data="3B*")
    @command("102#010301", name="transmit, in three bytes", origin=f"{EXAMPLE} main.py:35-39")
    @command("102#0102010000000000", name="bias")
    @command("102#0102020000000000", name="no bias")
    @command("102#01050FA000000000", name="250 readings a second")
    @command("102#0101020000000000", name="id 2")
    @command("102#FFFF000000000000", name="id 1 of all")
    def execute(self, request: Request) -> None:
        """Execute a command to this sensor, or to all."""
        to, order, *values = request.data
        value = int.from_bytes(bytes(values[:2]), "big")
        if (to, order) == (ALL_SENSORS, ALL_SENSORS):
            self.id = self.flash["id"] = 1
        elif to != self.id & 0xFF:
            self.counters["other_address"] += 1
        elif order == SET_ID and values[0]:
            self.id = self.flash["id"] = values[0]
        elif order == BIAS and values[0] in (1, 2):
            self.zero, self.wake_ns = (self.present, request.t_ns + SILENCE_NS) if values[0] == 1 else (0.0, None)
        elif order == PERIOD and value:
            self.flash["period_us"], self.period_ns = value, 1000 * value
        elif (order, values[0]) != (TRANSMIT, 1):
            raise Refused("value")
