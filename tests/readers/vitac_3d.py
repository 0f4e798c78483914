"""3D-ViTac, 16 x 16, which prints its scan as text.

Source: binghao-huang/3D-ViTac_Tactile_Hardware@e151ea6 (arduino_code/MatrixArray.ino loop();
python/multi_thread_contact.py).
A reading is 16 numbers of each of 16 lines.

Not settled by the description: how wide the numbers are and whether a space stands behind the last (both are read);
the range of a number (10 bits here, as the sibling board's converter has).
"""

from host import expect, open_serial, run

ROWS = COLUMNS = 16


def text(line):
    got = line.readline()
    expect(got.endswith(b"\r\n"), f"a line without CR LF: {got!r}")
    return got[:-2].decode("ascii")


def read(port):
    line = open_serial(port, 2_000_000)
    line.readline()  # the first may have begun anywhere
    while len(text(line)) >= 10:
        pass  # the driver takes what is shorter for the end of a scan
    while True:
        scan = [[int(word) for word in text(line).split()] for _ in range(ROWS)]
        expect(all(len(row) == COLUMNS for row in scan), f"lines of {[len(row) for row in scan]} numbers")
        expect(all(0 <= value <= 1023 for row in scan for value in row), "a number that is none of 10 bits")
        expect(text(line) == "", "no empty line behind 16 lines")
        yield [value for row in scan for value in row]


if __name__ == "__main__":
    run(read)
