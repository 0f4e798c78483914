#!/usr/bin/env python3
"""A driver that opens the first serial port that it finds, and prints what comes for half a second."""

import time

import serial
from serial.tools import list_ports

port = serial.Serial(min(each.device for each in list_ports.comports()), 115200, timeout=0.2)
end = time.monotonic() + 0.5
while time.monotonic() < end:
    print(port.read(64).hex(), flush=True)
