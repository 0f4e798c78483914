"""AgiBot OmniHand Pro 2025 (O12) and OmniHand 2025 (O10): CAN-FD hands whose touch is polled by finger.

Wire: CAN-FD, 29-bit identifiers ``ppppp tttttttt 00000001 w ddddddd`` (p part, t message, w write, d number of the
hand). A driver sends up to 64 bytes; the hand answers under the same identifier with the write bit clear, within 50 ms.

    message  part      data, low byte first
    01       0         ``VENDOR``
    02       0         ``NUMBER``: number of the hand, and the line
    02       1         write: another number, kept; answered under the old one
    03       joint     current threshold, int16
    05       1..7      touch of a finger, thumb first; 6 and 7, of an O10, are its palm and its back
    10       joint     mode: 0 position; O10: 1 servo, 2 velocity, 3 torque; Pro: 1 velocity, 2 torque
    11       joint     torque, int16
    12       joint     velocity, int16
    13       joint     position 0..2000 (O10: to 4096), int16
    14       0         write: joint and mode << 5 in a byte, and two or three int16; a position comes first
    20       joint     errors, two bytes: 1 stalled, 2 hot, 4 current, 8 motor, 10 line
    21       joint     temperature, uint16
    22       joint     current, int16

A joint is 1..12 (O10: 1..10), 0 is all of them, one after the other. A write to 20, 21 or 22 sets a period [ms] at
which the hand reports all joints unasked, as part 0. A write is answered like a read.

Evidence: the vendor's SDKs, run.

Try it: ``tactemu run agibot_omnihand_pro --port can:socketcan:vcan0``, then
``candump vcan0 & cansend vcan0 01050101##1$(printf '00%.0s' {1..64})``.
"""

import numpy as np

from firmware_protocols import Column, Counts, Frame, Reading, fact_table, quantize
from firmware_protocols.devices.agibot_protocol import FINGERS, AgibotOmniHand, shared_facts

COUNTS_PER_NEWTON = 1000 / 9.80665
PRO_COUNTS_PER_NEWTON = 1000.0
PRO = "AgibotTech/OmniHand-Pro-2025@3c7048e "
O10 = "AgibotTech/Omnihand-2025-SDK@bcbccf4 "


class AgibotOmniHandO10(AgibotOmniHand):
    """An O10: 16 taxels on each finger, 25 on the palm and on the back."""

    name = "agibot_omnihand_o10"
    title = "AgiBot OmniHand 2025 (O10)"
    model, reported_model, highest = "O10", "OmniHand2025", 4096
    joint_names = tuple(f"joint {k}" for k in range(1, 11))
    columns = (Column(name="touch", unit="N", counts_per_unit=COUNTS_PER_NEWTON, low=0, high=0xFF, push=1),)
    sources = (
        f"{O10}src/proto.h, src/implementation/c_agibot_hand_can/c_agibot_hand_can.cc, src/kinematics_solver",
        f"{O10}document/pic/tactile_sensor_array.jpg, document/en/API_CPP.md, python/example/demo_tactile_sensor.py",
    )
    judge = "AgibotTech/Omnihand-2025-SDK@bcbccf4"
    facts = (
        *shared_facts(f"all of {O10}src, document, python, node"),
        *fact_table(f"""
        stated touch: one count is one gram @ {O10}python/example/demo_tactile_sensor.py:12
        stated touch: fingers have 8 rows of 2 taxels, from the base on; a left hand is mirrored @
            {O10}document/pic/tactile_sensor_array.jpg
        assumed touch: the taxels of palm and back form squares, row by row @ all of {O10}src, document, python, node
        stated configuration: identifiers, messages and types @ {O10}src/proto.h, src/implementation/c_agibot_hand_can
        stated configuration: positions are 0..2000 in the document, and 0..4096 in the source code @
            {O10}document/en/API_CPP.md:205; src/kinematics_solver.h:92
        stated configuration: bit rates 1 and 5 Mbit/s, with sample points at 80 and 75 % @
            {O10}src/can_bus_device/zlg_usb_canfd/c_zlg_usbcanfd_sdk.cc:67
        """),
    )
    parts = {**dict.fromkeys(FINGERS, (8, 2)), "palm": (5, 5), "back": (5, 5)}
    answers = {
        (8, 2): Frame("""
            finger, row by row from the bottom right, id ppppp 00000101 00000001 w ddddddd (p part, w write, d device)
            0     u1 x 16       channels      [g]; of a right hand from the left
        """),
        (5, 5): Frame("""
            palm or back, row by row, id ppppp 00000101 00000001 w ddddddd (p part, w write, d device)
            0     u1 x 25       channels      [g]
            25    00 x 7        unused
        """),
    }

    def _order(self, side: str, rows: int, cols: int) -> np.ndarray:
        """Return the order on the wire: fingers begin at their base."""
        grid = np.arange(rows * cols).reshape(rows, cols)
        if cols == 2:
            grid = grid[::-1, ::-1] if side == "left" else grid[::-1]
        return grid.ravel()


class AgibotOmniHandPro(AgibotOmniHand):
    """An O12: nine channels on each finger, and the force that its firmware computes from them."""

    name = "agibot_omnihand_pro"
    title = "AgiBot OmniHand Pro 2025 (O12)"
    model, reported_model, highest = "O12", "OmniHandPro2025", 2000
    joint_names = tuple(f"joint {k}" for k in range(1, 13))
    columns = (
        Column(name="channel", low=0, high=0xFFFF, push=1),
        Column(name="normal", unit="N", counts_per_unit=10.0, low=0, high=3000, push=1),
        Column(name="tangential", unit="N", counts_per_unit=10.0, low=0, high=3000),
        Column(name="angle", low=0, high=359),
    )
    sources = (f"{PRO}src/proto.h, src/c_agibot_hand.cc, src/kinematics_solver, document/API_CPP.md",)
    judge = "AgibotTech/OmniHand-Pro-2025@3c7048e"
    facts = (
        *shared_facts(f"all of {PRO}src, document, python, node"),
        *fact_table(
            f"""
        stated touch: nine channels; the normal force is 0..3000 in 0.1 N; the angle is 0 towards the tip and rises
            clockwise @ {PRO}src/proto.h:55
        assumed touch: the channels are 3 x 3 taxels, row by row, with 1000 counts/N
        assumed touch: forces are sums over all channels of the finger, tangential ones in 0.1 N like the normal one;
            the online flag is 1, proximity 0
        stated configuration: identifiers, messages and types @ {PRO}src/proto.h, src/c_agibot_hand.cc:430, 1234
        stated configuration: positions 0..2000 @ {PRO}src/kinematics_solver/kinematics_solver.h:100
        stated configuration: bit rates 1 and 5 Mbit/s, with sample points at 80 and 75 % @
            {PRO}src/can_bus_device/zlg_usb_canfd/c_zlg_usbcanfd_sdk.cc:67
        """,
            looked=f"all of {PRO}src, document, python, node",
        ),  # fmt: skip,
    )
    parts = dict.fromkeys(FINGERS, (3, 3))
    answers = {
        (3, 3): Frame("""
            finger, row by row, id ppppp 00000101 00000001 w ddddddd (p part, w write, d device)
            0     u1            online
            1     <u2 x 9       channels
            19    <u2           normal        0..3000 [0.1 N]
            21    <u2           tangential
            23    <u2           angle         of the tangential force [deg], 0 towards the tip, clockwise
            25    u1 x 4        proximity
            29    00 x 3        unused
        """)
    }

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return each taxel's raw normal force, and normal, tangential [0.1 N] and angle [deg] of its finger."""
        force = self.layout.to_taxel_frame(reading["force"])
        x, y, z = force.reshape(len(FINGERS), -1, 3).sum(axis=1).T
        forces = quantize(np.stack([-z, np.hypot(x, y)]), 10.0, 0, 3000)
        angle = np.rint(np.degrees(np.arctan2(x, y))).astype(int) % 360
        of_finger = np.stack([*forces, angle], axis=1).repeat(len(force) // len(FINGERS), axis=0)
        self.counts = np.column_stack([quantize(-force[:, 2], PRO_COUNTS_PER_NEWTON), of_finger])
        return self.counts

    def _touch(self, table: Frame, counts: np.ndarray) -> bytes:
        _, normal, tangential, angle = counts[0].tolist()
        return table.pack(
            online=1, channels=counts[:, 0], normal=normal, tangential=tangential, angle=angle, proximity=[0] * 4
        )
