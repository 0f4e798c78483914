"""Read a LinkerHand with the vendor's Python SDK, for ``tests.clients.record``: ``linker_hand.py CHECKOUT L7``."""

import json
import os
import sys

sys.path.insert(0, os.path.join(sys.argv[1], "LinkerHand"))
from linker_hand_api import LinkerHandApi  # pyright: ignore[reportMissingImports]

FINGERS = ("thumb", "index", "middle", "ring", "little")
JOINTS = {"L7": 7, "L21": 25}


def main(model: str) -> None:
    """Ask for everything, set and read back, read the matrices; then connect once more."""
    hand = LinkerHandApi(hand_type="left", hand_joint=model, can="can0")
    said = {"version": hand.get_embedded_version(), "serial number": hand.get_serial_number()}
    for _ in range(3):
        said |= ask(hand)
    joints = JOINTS[model]
    hand.set_speed([90 + k for k in range(7 if model == "L7" else 5)])
    hand.set_torque([80 + k for k in range(7 if model == "L7" else 5)])
    hand.finger_move([100 + k for k in range(joints)])
    for _ in range(3):
        said["moved"] = hand.get_state()
    rows = []
    for _ in range(30):
        matrices = hand.get_matrix_touch() if model == "L21" else [one(hand, finger) for finger in FINGERS]
        for finger, matrix in zip(FINGERS, matrices):
            rows.append({"as": finger, "values": [int(value) for row in matrix for value in row]})
    hand.hand.close_can_interface()
    hand = LinkerHandApi(hand_type="left", hand_joint=model, can="can0")
    ask(hand)
    hand.hand.close_can_interface()
    with open(os.environ["TACTEMU_ROWS"], "a") as file:
        file.writelines(json.dumps(row) + "\n" for row in rows)
        file.writelines(json.dumps({"as": name, "value": str(value)}) + "\n" for name, value in said.items())


def one(hand: LinkerHandApi, finger: str):
    """Return the matrix of a finger, which has come by the end of the call."""
    return getattr(hand, f"get_{finger}_matrix_touch")(sleep_time=0.15)


def ask(hand: LinkerHandApi) -> dict:
    """Return what the hand says of itself and its joints."""
    names = ("touch_type", "state", "speed", "torque", "temperature", "fault")
    return {name.replace("_", " "): getattr(hand, f"get_{name}")() for name in names}


main(sys.argv[2])
