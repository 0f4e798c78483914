#!/usr/bin/env python3
"""A driver that asks a hand on can0 for a row of its matrix, and prints an answer."""

import can

with can.Bus(interface="socketcan", channel="can0") as bus:
    bus.send(can.Message(arbitration_id=0x28, data=[0xB1, 0xC6], is_extended_id=False))
    print(bus.recv(5.0) or exit("no answer"))
