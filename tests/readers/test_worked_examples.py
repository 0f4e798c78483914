"""The readers against the examples that come with the descriptions of the wire, not against our devices."""

import importlib
from pathlib import Path

import pytest

HEX = bytes.fromhex


class Line:
    """A port from which ``heard`` can be read; it keeps what is written."""

    timeout = 0.0

    def __init__(self, heard):
        self.heard, self.written = HEX(heard), b""

    def read(self, count):
        data, self.heard = self.heard[:count], self.heard[count:]
        return data

    def write(self, data):
        self.written += data

    def reset_input_buffer(self):
        pass


@pytest.fixture
def module(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    return importlib.import_module


def test_modbus(module):
    line = Line("27 06 00 46 00 02 EE D8")
    module("modbus").Client(line, 0x27).write(70, 2)
    assert line.written == HEX("27 06 00 46 00 02 EE D8")
    line = Line("02 10 03 F8 00 01 80 4F")
    module("modbus").Client(line, 2).write_many(1016, [1])
    assert line.written == HEX("02 10 03 F8 00 01 02 00 01 55 D8")
    with pytest.raises(module("host").Broken, match="exception 2"):
        module("modbus").Client(Line("01 83 02 C0 F1"), 1).registers(3, 9, 1)


def test_rohand(module):
    line = Line("02 03 0C D2 04 38 00 5A 00 FF FF FF FF FF FF FB E1")
    registers = module("modbus").Client(line, 2).registers(3, 2100, 6)
    assert module("rohand").swapped(registers) == [1234, 56, 90, None, None, None]


def test_ghand5(module):
    for request in ("31 04 10 80 00 10 F1 1E", "31 04 10 90 00 39 31 05"):
        assert module("modbus").crc16(HEX(request)[:-2]) == HEX(request)[-2:]


def test_paxini_gen2(module):
    paxini = module("paxini_gen2")
    line = Line("55 AA 7B 7B 0E 00 70 C0 06 00 0C 00 00 7B 0E 04 06 00 FF 02 32 00 00 03 E7 55 AA 7D 7D")
    assert paxini.ask(line, HEX("70 C0 06"), HEX("7B 0E 04 1E 00"))[6:] == HEX("FF 02 32 00 00 03")
    assert line.written == HEX("55 AA 7B 7B 0E 00 70 C0 06 05 00 7B 0E 04 1E 00 0C 55 AA 7D 7D")
    with pytest.raises(module("host").Broken, match="error 07"):
        paxini.ask(Line("55 AA 7B 7B 0E 00 70 C0 06 07 00 00 B5 55 AA 7D 7D"), HEX("70 C0 06"))


def test_robotera_xhand(module):
    xhand = module("robotera_xhand")
    line = Line("55 AA 80 FE 13 00 00" + xhand.crc16(HEX("55 AA 80 FE 13 00 00")).hex())
    assert xhand.ask(line, 0x13) == b""
    assert line.written == HEX("55 AA FE 80 13 00 00 EF C3")


def test_eflesh_binary(module, monkeypatch):
    eflesh = module("eflesh_binary")
    rest = """
        AA 55 05 00 00 00 00 00 00 00 00 00 C0 F3 45 00 00 00 00 00 00 00 00 00 C0 C1 45 00 00 00 00 00 00 00 00
        00 80 BB 45 00 00 00 00 00 00 00 00 00 40 67 C5 00 00 00 00 00 00 00 00 00 80 89 45 E7
    """
    monkeypatch.setattr(eflesh, "open_serial", lambda port, baud: Line(rest))
    monkeypatch.setattr(eflesh.time, "sleep", lambda seconds: None)
    assert next(eflesh.read("")) == [0, 0, 7800, 0, 0, 6200, 0, 0, 6000, 0, 0, -3700, 0, 0, 4400]


def test_revo2_canfd(module):
    """The CRC over RS-485 is the one over CAN FD."""
    request = HEX("01 04 10 68 00 1E F5 1E")
    assert module("modbus").crc16(request[:-2]) == request[-2:]
