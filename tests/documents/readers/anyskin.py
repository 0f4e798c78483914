#!/usr/bin/env python3
"""A driver of an AnySkin: ``anyskin.py [PORT]`` prints its values for half a second; default: the first port."""

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


def main():
    driver = MyDriver(sys.argv[1] if len(sys.argv) > 1 else min(port.device for port in list_ports.comports()))
    end = time.monotonic() + 0.5
    while time.monotonic() < end:
        print(*driver.latest(), sep=",", flush=True)


if __name__ == "__main__":
    main()
