"""3D-ViTac, 16 x 16, which prints its scan as text.

Source: binghao-huang/3D-ViTac_Tactile_Hardware@e151ea6 (arduino_code/MatrixArray.ino loop();
python/multi_thread_contact.py).
A reading is 16 numbers of each of 16 lines.

Numbers are bytes, and a space stands behind each, the last too.
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
        lines = [text(line) for _ in range(ROWS)]
        expect(all(each.endswith(" ") for each in lines), "no space behind the last number")
        scan = [[int(word) for word in each.split()] for each in lines]
        expect(all(len(row) == COLUMNS for row in scan), f"lines of {[len(row) for row in scan]} numbers")
        expect(all(0 <= value <= 255 for row in scan for value in row), "a number that is no byte")
        expect(text(line) == "", "no empty line behind 16 lines")
        yield [value for row in scan for value in row]


if __name__ == "__main__":
    run(read)
