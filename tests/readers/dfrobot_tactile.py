"""DFRobot tactile sensor, 4 x 8 or 6 x 6.

Source: DFRobot/DFRobot_TactileSensor@962a7b3 (python/raspberrypi/DFRobot_Tactile_Sensor.py:88, 120-150).
A reading is the ADC value of every point, row by row, the last row of the registers first as the driver turns it.

Options: unit and baud rate, which the driver leaves to its caller (1 and 115200 here are not from the description).
Not settled by the description: whether 4 x 8 is 4 rows of 8 (so read here).
"""

from host import expect, open_serial, run
from modbus import Client


def read(port, unit="1", baud="115200"):
    sensor = Client(open_serial(port, int(baud)), int(unit, 0))
    product = sensor.registers(4, 1, 1)[0]
    expect(product == 0x3343, f"product {product:04X}, expected 3343")
    model = sensor.registers(4, 0x2B, 1)[0]
    expect(model in (0, 1), f"model {model}")
    rows, columns = [(4, 8), (6, 6)][model]
    while True:
        values = sensor.registers(4, 7, rows * columns)
        expect(max(values) <= 4095, f"a value of {max(values)}")
        yield [v for row in reversed(range(rows)) for v in values[row * columns : (row + 1) * columns]]


if __name__ == "__main__":
    run(read, pause=0.01)
