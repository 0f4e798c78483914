#!/usr/bin/env python3
"""A driver that looks for a Robotiq TSF-85 by its USB ids, and reads some bytes of it."""

import serial
from serial.tools import list_ports

found = [port.device for port in list_ports.comports() if (port.vid, port.pid) == (0x16D0, 0x14CC)]
print(serial.Serial(found[0], 115200, timeout=5).read(64).hex())
