"""`tactemu judge --success`: the rate at which a task succeeds falls as the fault grows."""

import json
import subprocess
import sys

import pytest

from tactemu.errors import TactemuError
from tactemu.judge.success import Point, as_text, curve, read_script

SUCCESS = """
import time
def success(dev):
    end = time.monotonic() + 5.0
    while time.monotonic() < end:
        if dev.device().counters["told"]:
            return True
        time.sleep(0.01)
    return False
"""
DEVICE = '''
"""Told once that five readings in a row came through; ``ok`` from the driver."""
from firmware_protocols import Column, Serial, grid
from firmware_protocols import Device
import numpy as np

class Counter(Device):
    name = "counter"
    title = "counter"
    ports = (Serial(baud=115200),)
'''
TASK = """
import serial, sys
port = serial.Serial(sys.argv[1], 115200, timeout=0.5)
"""


def test_a_point_says_how_sure_it_is():
    low, high = Point("drop", 1.0, tried=3, succeeded=3).interval
    assert 0.4 < low < 0.5 and high == 1.0
    assert Point("drop", 1.0).after(True).after(False) == Point("drop", 1.0, 2, 1)
