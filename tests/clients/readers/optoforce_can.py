"""Read an OptoForce on CAN with python_blmc, for ``tests.clients.record``: ``PYTHONPATH=CHECKOUT optoforce_can.py``."""

import json
import os

import can  # pyright: ignore[reportMissingImports]
from blmc.motor_data import ArbitrationIds  # pyright: ignore[reportMissingImports]
from blmc.optoforce import OptoForcePacketReceiver  # pyright: ignore[reportMissingImports]


def main() -> None:
    """Read packets, as the driver's scripts do; open the bus twice."""
    rows = []
    for count in (120, 60):
        with can.interface.Bus(interface="socketcan", channel="can0", bitrate=1e6) as bus:
            receiver, before = OptoForcePacketReceiver(), len(rows)
            while len(rows) < before + count:
                message = bus.recv(5)
                assert message is not None
                if message.arbitration_id == ArbitrationIds.optoforce_trans:
                    receiver.receive_frame(message.data)
                if receiver.data is not None:
                    packet, receiver.data = receiver.data, None
                    assert packet.status.all == 0
                    rows.append([packet.fx, packet.fy, packet.fz])
    with open(os.environ["TACTEMU_ROWS"], "a") as file:
        file.writelines(json.dumps({"as": "force", "values": row}) + "\n" for row in rows)


main()
