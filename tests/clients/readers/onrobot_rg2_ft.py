"""Read an RG2-FT with the laboratory's driver, for ``tests.clients.record``; ROS 2 and its messages are stand-ins.

PYTHONPATH=CHECKOUT/onrobot_rg_control/onrobot_rg_control python onrobot_rg2_ft.py PORT      with pymodbus 2.4.0
"""

import json
import os
import sys
import time
from types import ModuleType, SimpleNamespace


class Node:
    """A stand-in for a node of ROS 2."""

    def __init__(self, name):
        self.name = name


def stand_in(name: str, **names) -> None:
    """Make a module."""
    sys.modules[name] = ModuleType(name)
    vars(sys.modules[name]).update(names)


stand_in("rclpy")
stand_in("rclpy.node", Node=Node)
stand_in("onrobot_rg_msgs")
stand_in("onrobot_rg_msgs.msg", OnRobotRGInput=SimpleNamespace)

from baseOnRobotRG import onrobotbaseRG  # noqa: E402
from comModbusTcp import Communication  # noqa: E402

AXES = [f"{axis}_{side}" for side in "lr" for axis in ("fx", "fy", "fz", "tx", "ty", "tz")]


def main() -> None:
    """Read, grip, zero and read again; all of it twice."""
    rows = []
    for turn, count in enumerate((60, 30)):
        gripper = onrobotbaseRG("rg2ft")
        gripper.client = Communication()
        gripper.client.connectToDevice("127.0.0.1", int(sys.argv[1]))
        gripper.setProximityOffset([230, 170])
        for out_zero in (0, 1):
            gripper.refreshCommand(SimpleNamespace(out_zero=out_zero, r_gfr=200, r_gwd=500 + 100 * turn, r_ctr=1))
            gripper.sendCommand()
            for _ in range(count):
                status = gripper.getStatus()
                rows.append({"as": "wrench", "values": [getattr(status, axis) for axis in AXES]})
                time.sleep(0.01)
        told = [status.g_sta, status.g_gwd, status.busy, status.grip_det, status.in_zero]
        told += [status.prox_off_l, status.prox_off_r, status.prox_l, status.prox_r]
        rows.append({"as": f"status, width, busy, grip, zero, offsets, proximity {turn + 1}", "value": told})
        gripper.client.disconnectFromDevice()
    with open(os.environ["TACTEMU_ROWS"], "a") as file:
        file.writelines(json.dumps(row) + "\n" for row in rows)


main()
