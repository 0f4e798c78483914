"""Unitree Dex3-1: the three-fingered hand of the G1, with nine pressure pads, over DDS.

Wire: DDS, domain 0, default QoS; one topic each way, with the types of ``IDL`` in CDR. The robot turns the hand's own
RS-485 line into them.

    topic                     type         about
    rt/dex3/left/state        HandState_   state, unasked
    rt/lf/dex3/left/state     HandState_   a slower copy, port "lf", which the vendor's C++ example reads instead:
                                           ``--port lf=dds:0``
    rt/dex3/left/cmd          HandCmd_     orders; no answer

``left`` or ``right``. Motors: thumb 0, 1, 2, middle 0, 1, index 0, 1. Mode byte of an order: bits 3..0 the motor, 6..4
status (0 locked, 1 on), 7 timeout: the motor stops 1 s after the last order. A motor that is on goes to ``q`` [rad],
between its stops; without stiffness (``kp`` 0, as the vendor's example stops) it stays, as one that is off does.

A pad has twelve slots of float32: 30000 where there is no cell, about 100000 at rest, more under a press (users take
150000 and more for a press; the vendor divides by 10000 for display). Nine pads of twelve, of which a hand has 33
cells: one user's notes have slots 0, 2, 9 and 11 of the pads 0, 2, 4, 6, 7, 8 and slots 3, 6, 8 of the pads 1, 3, 5
(options ``cells``, ``odd_cells``).

The SDK's default sample has seven pads, hands send nine. Its reader blocks on a silent topic.

Try it: ``tactemu run unitree_dex3``, then ``ChannelFactoryInitialize(0, "lo")`` and a ``ChannelSubscriber`` of
``rt/dex3/left/state``.
"""

from collections.abc import Mapping
from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    Column, Dds, Device, Layout, Motors, Option, Patch, Sent, Topic, Transmissions, command_table, fact_table,
)  # fmt: skip
from firmware_protocols.idl import layout

IDL = """
module unitree_hg { module msg { module dds_ {
    struct MotorState_ {
        uint8 mode; float q; float dq; float ddq; float tau_est; int16 temperature[2]; float vol; uint32 sensor[2];
        uint32 motorstate; uint32 reserve[4];
    };
    struct PressSensorState_ { float pressure[12]; float temperature[12]; uint32 lost; uint32 reserve; };
    struct IMUState_ {
        float quaternion[4]; float gyroscope[3]; float accelerometer[3]; float rpy[3]; int16 temperature;
    };
    struct HandState_ {
        sequence<MotorState_> motor_state; sequence<PressSensorState_> press_sensor_state; IMUState_ imu_state;
        float power_v; float power_a; float system_v; float device_v; uint32 error[2]; uint32 reserve[2];
    };
    struct MotorCmd_ { uint8 mode; float q; float dq; float tau; float kp; float kd; uint32 reserve; };
    struct HandCmd_ { sequence<MotorCmd_> motor_cmd; uint32 reserve[4]; };
}; }; };
"""
IDL_MODULE = "unitree_hg::msg::dds_"
MOTORS = 7
PADS = 9
SLOTS_PER_PAD = 12
STATE = layout(IDL, "HandState_", motor_state=MOTORS, press_sensor_state=PADS)
COMMAND = layout(IDL, "HandCmd_", motor_cmd=MOTORS)
NO_CELL_PRESSURE = 30_000.0
REST_PRESSURE = 100_000.0
MAX_PRESSURE = 400_000.0
ODD_PADS = (1, 3, 5)
STATUS_BITS = 0x70
STATUS_ON = 0x10
TIMEOUT_BIT = 0x80
TIMEOUT_NS = 1_000_000_000
STOPS_RAD = {
    "left": ((-1.05, -0.724, 0.0, -1.57, -1.75, -1.57, -1.75), (1.05, 1.05, 1.75, 0.0, 0.0, 0.0, 0.0)),
    "right": ((-1.05, -1.05, -1.75, 0.0, 0.0, 0.0, 0.0), (1.05, 0.742, 0.0, 1.57, 1.75, 1.57, 1.75)),
}
"""The least and the greatest angle of each motor."""
ROOM_DEG_C = 25
STATES_PER_SLOW_COPY = 25
"""The number of states for each message of the slower copy."""
COLS = 3
PITCH_M = 0.005
PAD_PITCH_M = 0.025
Cells = tuple[int, ...]


def _order(mode: int, q: str, kp: str) -> str:
    motors = (f"{mode | k:02X} 00 00 00 {q} {8 * '00'} {kp} {8 * '00'}" for k in range(MOTORS))
    return "07 00 00 00" + "".join(motors) + "00" * 16


class UnitreeDex3(Device):
    """A Dex3-1 as it appears on DDS."""

    name = "unitree_dex3"
    title = "Unitree Dex3-1 hand"
    kind = "hand"
    rate_hz = 250.0
    evidence = ("driver", "vendor document")
    sources = (
        "unitree-sdk2py-dimos 1.0.3 idl/unitree_hg (types), core/channel.py; unitree_sdk2_python@37116c5",
        "unitree_sdk2@21d0a3b example/g1/dex3/g1_dex3_example.cpp (mode byte, stops, nine pads, topics)",
        "vendor page 'Dexterous Hand' (six places of 3 x 4, 33 cells, mode byte, values, order of the motors)",
    )
    judge = "unitree-sdk2py-dimos 1.0.3"
    documented = command_table(
        f"""
        all to 0.5 rad  {_order(0x10, "00 00 00 3F", "00 00 C0 3F")}
        all stop        {_order(0x90, "00 00 00 00", "00 00 00 00")}
        """,
        origin="g1_dex3_example.cpp l.53-57, 118-121; HandCmd_ as cyclonedds 11.0.1 serialises it",
    )
    documented_with = None
    facts = fact_table("""
        stated touch: 100000 and more is a value, 30000 means no cell; nine pads of twelve slots @ vendor page
            'Dexterous Hand'; unitree_sdk2@21d0a3b g1_dex3_example.cpp:42
        assumed touch: which slots have a cell (by one user's notes; an option changes it): the vendor shows it in a
            picture only @ unitree_sdk2, unitree_sdk2_python, all files; vendor page, its text
        assumed touch: pads lie side by side, 25 mm apart; each has 4 rows of 3 slots, 5 mm apart (according to one user
            3 rows of 4) @ as above
        assumed touch: 100000 at rest, 10000 counts per N, at most 400000 @ as above: 10 g to 2500 g, no law
        stated identity: only the names of its topics contain left or right @ g1_dex3_example.cpp:35-37
        stated configuration: status 0 locks a motor, 1 switches it on; timeout 1: the motor stops after 1 s without a
            command @ vendor page 'Dexterous Hand' (RIS_Mode_t); g1_dex3_example.cpp:45-49
        stated configuration: the stops of each motor @ g1_dex3_example.cpp:26-29
        stated configuration: commands that stop a motor have q 0 and no stiffness @ g1_dex3_example.cpp:179-203
        assumed configuration: motors have a time constant of 0.1 s for any kp and kd; dq and tau are ignored; a motor's
            state repeats the mode of its command; commands for a number of motors other than 7 are ignored @
            unitree_sdk2, unitree_sdk2_python, all files
        assumed configuration: voltages, currents and torques are 0, all temperatures 25 deg C; the IMU is level and at
            rest; no packet is lost, and there are no errors @ as above
        assumed timing: 250 states a second; every 25th is also sent on the slower topic @ as above, and the vendor page
    """)

    def __init__(
        self,
        *,
        side: Annotated[Literal["left", "right"], Option("which hand")] = "left",
        cells: Annotated[Cells, Option("slots 0 to 11 that have a cell, pads 0, 2, 4, 6, 7, 8")] = (0, 2, 9, 11),
        odd_cells: Annotated[Cells, Option("slots 0 to 11 that have a cell, pads 1, 3, 5")] = (3, 6, 8),
        counts_per_newton: Annotated[float, Option("scale of a cell", unit="1/N", low=1e-6)] = 10_000.0,
    ):
        state = f"{IDL_MODULE}::HandState_"
        order = Topic(name=f"rt/dex3/{side}/cmd", type=f"{IDL_MODULE}::HandCmd_")
        self.ports = (
            Dds(name="hand", writes=Topic(name=f"rt/dex3/{side}/state", type=state), reads=order, idl=IDL),
            Dds(name="lf", writes=Topic(name=f"rt/lf/dex3/{side}/state", type=state), idl=IDL, is_plugged=False),
        )
        live = [sorted({k % SLOTS_PER_PAD for k in (odd_cells if pad in ODD_PADS else cells)}) for pad in range(PADS)]
        self.layout = _pads(live)
        self.slots = [pad * SLOTS_PER_PAD + slot for pad, slots in enumerate(live) for slot in slots]
        self.columns = (
            Column(name="pressure", assumed_per_unit=counts_per_newton, is_float=True, push=1, low=REST_PRESSURE,
                   high=MAX_PRESSURE, rest=REST_PRESSURE),
        )  # fmt: skip
        low, high = STOPS_RAD[side]
        self.motors = Motors(np.zeros(MOTORS), low=low, high=high, time_constant_s=0.1)
        self.modes = list(range(MOTORS))
        self.sent = 0

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return a state, every 25th time also to the slower topic."""
        self.sent += 1
        state = self._state(t_ns)
        return [state, Sent(state, port="lf")] if self.sent % STATES_PER_SLOW_COPY == 0 else [state]

    def _state(self, t_ns: int) -> bytes:
        state = np.zeros((), STATE)
        state["n_motor_state"], state["n_press_sensor_state"] = MOTORS, PADS
        motors, pads = state["motor_state"], state["press_sensor_state"]
        motors["mode"], motors["q"] = self.modes, self.motors.positions(t_ns)
        motors["dq"] = self.motors.velocities(t_ns)
        motors["temperature"] = pads["temperature"] = state["imu_state"]["temperature"] = ROOM_DEG_C
        pressure = np.full(PADS * SLOTS_PER_PAD, NO_CELL_PRESSURE)
        pressure[self.slots] = self.layout.on_wire(self.counts)
        pads["pressure"] = pressure.reshape(PADS, SLOTS_PER_PAD)
        state["imu_state"]["quaternion"] = (1, 0, 0, 0)
        return state.tobytes()

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Obey a message of orders, one for each motor."""
        if len(data) != COMMAND.itemsize or (order := np.frombuffer(data, COMMAND)[0])["n_motor_cmd"] != MOTORS:
            self.counters["bad_request"] += 1
            return ()
        self.counters["requests"] += 1
        mode, moves = order["motor_cmd"]["mode"], order["motor_cmd"]["kp"] > 0
        moves &= mode & STATUS_BITS == STATUS_ON
        self.motors.go(np.where(moves, order["motor_cmd"]["q"], self.motors.positions(t_ns)), t_ns)
        self.modes = mode.tolist()
        self.wake_ns = t_ns + TIMEOUT_NS if (mode & TIMEOUT_BIT).any() else None
        return ()

    def wake(self, t_ns: int) -> Transmissions:
        """Stop the motors with the timeout bit, as no order has come for 1 s."""
        here, goals = self.motors.positions(t_ns), self.motors.goals
        self.motors.go(np.where(np.array(self.modes) & TIMEOUT_BIT, here, goals), t_ns)
        return ()

    def joints(self, t_ns: int) -> Mapping[str, float]:
        """Return the angles of the seven motors [rad], by name."""
        return {f"motor {k}": angle for k, angle in enumerate(self.motors.positions(t_ns).tolist())}


def _pads(live: list[list[int]]) -> Layout:
    positions, patches, start = [], [], 0
    for pad, slots in enumerate(live):
        rows, cols = np.divmod(slots, COLS)
        x = (pad - (PADS - 1) / 2) * PAD_PITCH_M + (cols - 1) * PITCH_M
        positions.append(np.stack([x, (1.5 - rows) * PITCH_M, 0 * x], -1))
        patches.append(Patch(name=f"pad {pad}", start=start, rows=0, cols=len(slots), pitch=PITCH_M))
        start += len(slots)
    return Layout(positions=np.concatenate(positions), normals=np.array([0.0, 0.0, 1.0]), patches=tuple(patches))
