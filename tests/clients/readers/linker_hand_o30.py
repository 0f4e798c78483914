"""Read a LinkerHand O30 with the vendor's SDK over SocketCAN, for ``tests.clients.record``.

The argument is the folder of ``LinkerHandL30API``.
"""

import importlib
import json
import os
import sys
import time

sys.path.insert(0, sys.argv[1])
driver = importlib.import_module("LinkerHandL30API.core.linker_hand_o30i_control")
FINGERS = ("thumb", "index", "middle", "ring", "little")


def main() -> None:
    """Ask for everything, enable, move and read back, read the matrices; then connect once more."""
    rows, said = [], {}
    for count in (16, 4):
        hand = driver.LinkerHandO30IController("right", comm_type="socketcan", channel="can0", auto_setup=False)
        said["information"] = hand.get_device_info()
        said["side"], said["online"], said["joints"] = hand.get_hand_side(), hand.is_online(), hand.get_valid_joints()
        said["set up"] = hand.setup(verify_joints=True)
        hand.set_target_velocity([100] * 20)
        hand.set_target_torque([200] * 20)
        hand.set_target_position([40 + k for k in range(20)])
        hand.set_joint_position("thumb_tip", 90)
        time.sleep(1)
        said["positions"], said["goals"] = hand.get_current_position(), hand.get_target_position()
        said["currents"], said["temperatures"] = hand.get_motor_current(), hand.get_temperature()
        said["error"] = hand.get_last_error()
        hand.save_to_flash()
        for _ in range(count):
            for number, name in enumerate(FINGERS, 1):
                hand.select_sensor(number)
                time.sleep(0.01)
                while len(raw := hand.read_tactile_raw() or b"") < 72:
                    pass  # the driver waits 0.3 s, which a busy machine may exceed
                rows.append({"as": name, "values": list(raw)})
        said["sensor"], matrix = hand.get_sensor_info(), hand.read_tactile_matrix(1)
        said["rows"] = [len(row) for row in matrix]
        hand.close()
    with open(os.environ["TACTEMU_ROWS"], "a") as file:
        file.writelines(json.dumps(row) + "\n" for row in rows)
        file.writelines(json.dumps({"as": name, "value": str(value)}) + "\n" for name, value in said.items())


main()
