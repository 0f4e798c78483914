"""Read a LinkerHand O20 with the vendor's ROS 2 driver, for ``tests.clients.record``: ``linker_hand_o20.py CORE``.

CORE is the folder of ``linker_hand_o20_canfd.py``. Its adapter's library, ``libcanbus.so``, needs the adapter: a
stand-in here has the same calls over SocketCAN's can0. Windows and drawings, which the file imports too, are left out.
"""

import ctypes
import importlib
import json
import os
import sys
import time
from types import SimpleNamespace
from unittest.mock import MagicMock

import can

LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)
FINGERS = ("thumb", "index", "middle", "ring", "pinky")


class Library:
    """The calls of the adapter's library that the driver makes."""

    def CAN_ScanDevice(self):
        return 1

    def CAN_OpenDevice(self, device, channel):
        self.bus = can.Bus(interface="socketcan", channel="can0", fd=True)
        return 0

    def CAN_CloseDevice(self, device, channel):
        self.bus.shutdown()

    def CAN_ReadDevInfo(self, device, info):
        return 1

    def CANFD_Init(self, device, channel, config):
        return 0

    def CAN_SetFilter(self, *numbers):
        return 0

    def CANFD_Transmit(self, device, channel, reference, count, timeout_ms):
        frame = reference._obj
        data = bytes(frame.Data[: LENGTHS[frame.DLC]])
        self.bus.send(can.Message(arbitration_id=frame.ID, data=data, is_fd=True, bitrate_switch=True))
        return 1

    def CANFD_Receive(self, device, channel, reference, count, timeout_ms):
        first = reference._obj
        frames = (type(first) * count).from_address(ctypes.addressof(first))
        received = 0
        while received < count and (message := self.bus.recv(0 if received else timeout_ms / 1000)) is not None:
            frame = frames[received]
            frame.ID, frame.DLC = message.arbitration_id, LENGTHS.index(len(message.data))
            frame.Data[: len(message.data)] = message.data
            received += 1
        return received


for name in ("tkinter", "matplotlib", "matplotlib.pyplot", "matplotlib.backends.backend_tkagg", "matplotlib.figure"):
    sys.modules[name] = MagicMock()
ctypes.CDLL = MagicMock()
ctypes.cdll = SimpleNamespace(LoadLibrary=lambda path: Library())
sys.path.insert(0, sys.argv[1])
driver = importlib.import_module("linker_hand_o20_canfd")


def main() -> None:
    """Connect, read, set speeds, torques and goals, watch the touch; then connect once more."""
    rows, said = [], {}
    for count in (20, 5):
        hand = driver.LinkerHandO20Controller(hand_type="right")
        connected, kind = hand.connect()
        assert connected
        taken = hand.model.update_tactile_data

        def update(finger, data, taken=taken):
            taken(finger, data)
            rows.append({"as": finger, "values": data.ravel().tolist()})

        hand.start_monitoring()
        time.sleep(0.1)
        said |= {"kind": kind, "serial number": str(hand.read_serial_number())}
        hand.set_default_velocity(50)
        hand.set_default_torque(400)
        hand.set_joint_positions([10 + k for k in range(4)] + [5] * 13)
        hand.set_joint_offsets([0] * 17)
        hand.clear_error_status()
        time.sleep(0.3)
        joints = hand.model.joints.values()
        said["positions"] = str([joint.current_pos for joint in joints])
        said["currents"] = str([joint.current_current for joint in joints])
        enough = len(rows) + 5 * count
        hand.model.update_tactile_data = update
        while len(rows) < enough:
            time.sleep(0.01)
        hand.model.update_tactile_data = taken
        hand.disconnect()
    with open(os.environ["TACTEMU_ROWS"], "a") as file:
        file.writelines(json.dumps(row) + "\n" for row in rows)
        file.writelines(json.dumps({"as": name, "value": value}) + "\n" for name, value in said.items())


main()
