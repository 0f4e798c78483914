"""The memory of the Inspire RH56DFTP, and the places of its tactile matrices, in the order of that memory.

The datasheet of the hand is :mod:`firmware_protocols.devices.inspire_rh56dftp`.
"""

from dataclasses import replace

import numpy as np

from firmware_protocols import Layout, RegisterMap, grid_layout, place, stack

MAP = RegisterMap(
    """
    1000  u1          unit           1..254  = 1  flash            from the next power-up
    1002  u1          baud           0..4  flash                   0 115200, 1 57600, 2 19200, 3 and 4 921600; likewise
    1004  u1          clear_errors   0..1                          orders: 1, reads 0 again
    1005  u1          save           0..1                          what the flash keeps
    1006  u1          restore        0..1                          factory settings
    1009  u1          zero_force     0..1
    1032  <i2 x 6     speed_default  0..1000  = 1000  flash        at power-up
    1044  <i2 x 6     force_default  0..3000  = 500  flash         at power-up
    1474  <i2 x 6     position_set   -1..2000  = -1                -1: stay
    1486  <i2 x 6     angle_set      -1..1000  = -1                -1: stay; 1000 is open
    1498  <i2 x 6     force_set      0..3000  = 500                limit [g]
    1522  <i2 x 6     speed_set      0..1000  = 1000
    1534  <i2 x 6     position       0..2000  r                    2000 - 2 angle
    1546  <i2 x 6     angle          0..1000  r
    1582  <i2 x 6     force          -4000..4000  r                [g]
    1594  <i2 x 6     current        0..2000  r                    [mA]
    1606  u1 x 6      errors         r
    1612  u1 x 6      status         r                             0 opening, 1 closing, 2 there
    1618  u1 x 6      temperature    0..100  = 25  r               [deg C]
    1700  u1 x 4      ip             = 192, 168, 11, 210  flash    from the next power-up
    2320  u1 x 4      gesture                                      number and run: two registers as written
    3000  <i2 x 1062  touch          r
    """,
    size=6000,
    writable=((1000, 1060), (1464, 1534)),
)
TOUCH_ADDRESS = MAP.by_name["touch"].address
BAUDS = (115200, 57600, 19200, 921600, 921600)

FINGER_PITCH_M = 0.0015
PALM_PITCH_M = 0.004
FINGER_MATRICES = (("tip", 3, 3, 0.033), ("top", 12, 8, 0.021), ("pad", 10, 8, 0.0))
THUMB_MATRICES = (("tip", 3, 3, 0.048), ("top", 12, 8, 0.036), ("middle", 3, 3, 0.023), ("pad", 12, 8, 0.01))
"""The matrices along a thumb, as those above along a finger: name, rows, columns, height above the base [m]."""
FINGER_BASES_M = {
    "little": (-0.033, 0.065), "ring": (-0.011, 0.075), "middle": (0.011, 0.08), "index": (0.033, 0.075),
    "thumb": (0.06, -0.01),
}  # fmt: skip


def matrices() -> Layout:
    """Return all matrices in wire order, each on its finger's link; x across the hand, y to the tips, z out of it."""
    pads = [
        place(grid_layout(rows, cols, FINGER_PITCH_M, name=f"{finger} {name}", link=finger), (x, y + height, 0.0))
        for finger, (x, y) in FINGER_BASES_M.items()
        for name, rows, cols, height in (THUMB_MATRICES if finger == "thumb" else FINGER_MATRICES)
    ]
    palm = grid_layout(8, 14, PALM_PITCH_M, name="palm", link="palm")
    return stack(*pads, replace(palm, wire_order=np.arange(8 * 14).reshape(8, 14)[::-1].T.ravel()))
