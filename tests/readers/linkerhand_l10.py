"""LinkerHand L10 over RS-485.

Source: linker-bot/linkerhand-python-sdk@b371361 (LinkerHand/core/rs485/linker_hand_l10_rs485.py:110-170,
LinkerHand/linker_hand_api.py:22-24).
A reading is 12 rows x 6 columns of each finger, thumb to little, 0..255.

Options: right or left.
Not settled by the description: the ten values before the matrix, the fourteen behind it, and the high bytes (all
dropped); registers 60 and 62 of the driver's own comment (its code uses 70 and 72, and so does this).
"""

import time

from host import open_serial, run
from modbus import Client


def read(port, side="right"):
    hand = Client(open_serial(port, 115200), {"right": 0x27, "left": 0x28}[side])
    while True:
        reading = []
        for finger in range(1, 6):
            hand.write(70, finger)
            time.sleep(0.008)
            reading += [value & 0xFF for value in hand.registers(4, 72, 96)][10:82]
        yield reading


if __name__ == "__main__":
    run(read, pause=0.01)
