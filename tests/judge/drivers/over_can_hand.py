"""``over_can_hand.py VARIANT INTERFACE CHANNEL``: drivers of dexrobot_dexhand, forces in newtons over CAN-FD."""

import struct
import sys

import can
from planted_defects import Defect, say

BOARDS = (1, 3, 4, 5, 6)
SCAN_S = 0.005
"""Longest time from the first finger of a scan to the last [s]: half a period."""
IN_UNITS = ("ten", "thousand", "kilogram", "percent", "units")


def start(bus):
    """Make all fingers send every 10 ms."""
    for board in BOARDS:
        data = [3, 0x74, 1, 1, 1]
        bus.send(can.Message(arbitration_id=board, data=data, is_extended_id=False, is_fd=True, bitrate_switch=True))


def main(variant, interface, channel):
    bus = can.Bus(interface=interface, channel=channel, fd=True)
    start(bus)
    defect, row, began = Defect(variant, limit=20.0), {}, 0.0
    while True:
        message = bus.recv(0.5)
        if message is None:
            say("nothing comes")
            start(bus)
            continue
        board = message.arbitration_id - 0x180
        if message.is_error_frame or message.is_extended_id or board not in BOARDS or len(message.data) < 48:
            continue
        if board == BOARDS[0]:
            row, began = {}, message.timestamp
        elif BOARDS[len(row)] != board or message.timestamp - began > SCAN_S:  # in order, and close together
            row = {}
            continue
        normal, tangential = struct.unpack_from("<f4xf", bytes(message.data), 16)
        row[board] = normal, tangential
        if len(row) == len(BOARDS):
            normals = [defect.in_unit(row[k][0], 1.0) for k in BOARDS]
            tangentials = [defect.in_unit(row[k][1], 1.0) for k in BOARDS]
            if variant == "exchanged":
                normals, tangentials = tangentials, normals
            defect.hand_out(normal=defect.values(normals), tangential=tangentials)
            row = {}


if __name__ == "__main__":
    main(*sys.argv[1:])
