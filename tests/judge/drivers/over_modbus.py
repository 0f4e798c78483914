"""``over_modbus.py VARIANT PORT [MODEL]``: drivers of dfrobot_tactile and robotiq_ft300 (ft300), in Modbus RTU."""

import struct
import sys
import termios
import time

import serial
from planted_defects import Defect, hand_out, say

MODELS = {
    # unit, function, first register, number of registers, line speed, format
    "dfrobot": (1, 4, 7, 32, 115200, ">32H"),
    "ft300": (9, 3, 180, 6, 19200, ">6h"),
}
NAMES = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
IN_UNITS = ("ten", "thousand", "kilogram", "percent", "units")

GONE = (OSError, termios.error)
"""Exceptions that pyserial raises for a lost port."""


def crc_modbus(data):
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0xA001 if crc & 1 else crc >> 1
    return crc.to_bytes(2, "little")


def quiet(line):
    """Drop the data that still arrive: they belong to the failed question."""
    while line.read(1):
        line.reset_input_buffer()


def open_again(port, baud):
    """Return the port once it can be opened again."""
    while True:
        try:
            return serial.Serial(port, baud, timeout=0.15)
        except serial.SerialException:
            time.sleep(0.02)


class Driver:
    """A driver that asks for the registers in a loop."""

    def __init__(self, variant, port, model):
        self.variant, self.model = variant, model
        self.unit, self.function, address, self.count, self.baud, self.format = MODELS[model]
        self.line = serial.Serial(port, self.baud, timeout=0.15)
        ask = struct.pack(">BBHH", self.unit, self.function, address, self.count)
        self.ask = ask + crc_modbus(ask)
        self.defect = Defect(variant, exchange=(3, 4))
        self.old, self.unplugged = None, 0

    def answer(self):
        """Ask, and return the answer and True if it is good."""
        variant, line = self.variant, self.line
        if variant != "noresync":
            line.reset_input_buffer()
        line.write(self.ask)
        if variant == "noresync":
            answer = line.read(5 + 2 * self.count)
        else:
            answer = line.read(3)
            while variant == "deaf" and len(answer) < 3:
                answer += line.read(3 - len(answer))  # it waits for the answer forever
            if len(answer) == 3:
                answer += line.read(2 if answer[1] & 0x80 else answer[2] + 2)
        good = len(answer) >= 5 and (answer[-2:] == crc_modbus(answer[:-2]) or variant == "nocrc")
        return answer, good and (answer[0] == self.unit or variant == "unit")

    def read(self):
        """Ask once, and hand out the answer."""
        variant, size = self.variant, 2 * self.count
        answer, good = self.answer()
        if good and answer[1] == self.function | 0x80:
            if variant == "exception" and self.old is not None:
                hand_out(**self.old)
            elif variant == "dies":
                raise RuntimeError("the device says that it failed")
            else:
                say("the device says that it failed")
            time.sleep(0.01)
            return
        if not good or answer[1] != self.function or (answer[2] != size and variant != "short"):
            if variant == "timeout" and self.old is not None:
                hand_out(**self.old)
            else:
                say("no good answer")
                if variant not in ("noresync", "deaf"):
                    quiet(self.line)
            return
        counts = struct.unpack(self.format, answer[3:-2].ljust(size, b"\0")[:size])
        values = self.defect.values(counts)
        if variant in IN_UNITS:
            values = [self.defect.in_unit(value, 100.0 if k < 3 else 1000.0) for k, value in enumerate(values)]
        self.old = dict(zip(NAMES, values)) if self.model == "ft300" else {"v": values}
        self.defect.hand_out(**self.old)
        time.sleep(0.008)


def main(variant, port, model="dfrobot"):
    driver = Driver(variant, port, model)
    while True:
        try:
            driver.read()
        except GONE as error:
            driver.unplugged += 1
            if variant != "second":
                say(f"port lost: {error}")
                sys.exit(1)
            if driver.unplugged == 1:
                say("port lost, opening it again")
                driver.line = open_again(port, driver.baud)
            else:
                sys.exit(0)


if __name__ == "__main__":
    main(*sys.argv[1:])
