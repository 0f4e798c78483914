#!/usr/bin/env python3
"""A driver of an AnySkin: ``anyskin.py [PORT]`` prints its values; of the first port, for half a second."""

import struct
import sys
import time

import numpy as np
import serial
from serial.tools import list_ports

SIZE = 82


class MyDriver:
    def __init__(self, port):
        self.port = serial.Serial(port, 115200, timeout=0.5)

    def latest(self):
        """Return T, Bx, By, Bz of five chips, of the next frame."""
        self.port.reset_input_buffer()
        self.port.read_until(b"\r\n")
        while True:
            frame = self.port.read_until(b"\r\n")
            if len(frame) == SIZE:
                return np.array(struct.unpack("<20f", frame[: SIZE - 2]))


def read(port):
    """Yield readings without end."""
    driver = MyDriver(port)
    while True:
        yield driver.latest()


def main():
    port = sys.argv[1] if len(sys.argv) > 1 else min(each.device for each in list_ports.comports())
    end = time.monotonic() + 0.5
    for reading in read(port):
        print(*reading, sep=",", flush=True)
        if len(sys.argv) == 1 and time.monotonic() > end:
            break


if __name__ == "__main__":
    main()
