"""SUN fingertip of 5 x 5 taxels.

Source: marcocostanzo/tactile_sensor_ros@149032e.
A reading is the voltage of every taxel, row by row: V = x * 3.3 / 4096.

Options: baud rate (500000 or 1000000).
Not settled by the description: the order of the values (taken as row by row); what the four high bits hold (must be 0
here).
"""

import struct

from host import exactly, expect, open_serial, run

ROWS = COLUMNS = 5


def read(port, baud="1000000"):
    line = open_serial(port, int(baud))
    while True:
        line.write(b"a")
        values = struct.unpack(f"<{ROWS * COLUMNS}H", exactly(line, 2 * ROWS * COLUMNS))
        expect(max(values) < 4096, f"a value of {max(values)}, more than 12 bits")
        yield [value * 3.3 / 4096 for value in values]


if __name__ == "__main__":
    run(read, pause=0.01)
