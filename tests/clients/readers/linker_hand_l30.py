"""Read a LinkerHand L30 with the vendor's SDK over SocketCAN, for ``tests.clients.record``.

The argument is the folder of ``LinkerHandL30API``.
"""

import importlib
import json
import os
import sys

sys.path.insert(0, sys.argv[1])
driver = importlib.import_module("LinkerHandL30API.core.linker_hand_l30_v6_2_canfd")
FINGERS = {"thumb": 1, "index": 2, "middle": 3, "ring": 4, "little": 5}


def main() -> None:
    """Ask for everything, set and read back, read the matrices; then connect once more."""
    rows, said = [], {}
    for count in (16, 4):
        hand = driver.L30CANFDProtocol(comm_type="socketcan", channel="can0", auto_setup=False)
        assert hand.initialize()
        said["information"], said["product code"] = hand.get_device_info(), hand.get_product_code()
        said["id"], said["hand"] = hand.get_node_id(), hand.get_hand_type()
        for name in ("positions", "currents", "velocities", "temperatures", "error_codes"):
            said[name.replace("_", " ")] = getattr(hand, f"get_joint_{name}")()
        said["zero while locked"] = hand.calibrate_zero()
        said["zero"] = [hand.unlock(), hand.disable_all_joints(), hand.calibrate_zero(), hand.enable_all_joints()]
        said["hand set"] = [hand.set_hand_type(0), hand.set_device_info(170, 2)]
        hand.set_joint_torques([100] * 17)
        hand.set_joint_velocities([250] * 17)
        hand.set_joint_positions([20] * 17)
        said["one joint"] = hand.set_single_joint_position(1, 100)
        said["reports"] = hand.config_periodic_report(1, True, 50)
        said["reported"] = [hand.read_periodic_report(1, 17, timeout_ms=1000) for _ in range(5)][-1]
        said["no reports"] = hand.stop_periodic_report(1)
        said["moved"] = hand.get_joint_positions()
        for _ in range(count):
            for name, part in FINGERS.items():
                matrix = hand._process_touch_matrix(hand.get_finger_touch(part, timeout_ms=500), name)
                rows.append({"as": name, "values": matrix.ravel().tolist()})
        hand.close()
    with open(os.environ["TACTEMU_ROWS"], "a") as file:
        file.writelines(json.dumps(row) + "\n" for row in rows)
        file.writelines(json.dumps({"as": name, "value": str(value)}) + "\n" for name, value in said.items())


main()
