import copy
import timeit

import numpy as np
import pytest

from firmware_protocols import Refused, RegisterMap, Registers
from firmware_protocols.registers import Reg
from tests.kit.saving import restored, saved

TEXT = """
    1000  u1              unit          1..254  = 1        flash    from the next power-up
    1002  u1              speed_code    0..3               flash
    1004  u1              clear_error   0..1
    1005  u1              save          0..1           w
    1006  <f4             ratio         = 0.5
    1486  <i2 x 6         angle_set     -1..1000  = -1              -1: stay
    1582  <i2 x 6         force         -4000..4000        r        [g]
    1600  <u2 sign 11     offset                           flash
    1602  >u2 sign 15 x 3     goals     = -1, 0, 300
    3000  <i2 x 1062      touch         0..4096            r        matrix by matrix, row by row
"""
MAP = RegisterMap(TEXT, size=6000, writable=((1000, 1060),))


def refusal(act, *args) -> str:
    with pytest.raises(Refused) as refused:
        act(*args)
    return refused.value.why


def test_registers_have_their_defaults_and_what_the_flash_kept():
    registers = Registers(MAP, kept={"unit": 7, "offset": -340})
    assert (registers["unit"], registers["offset"], registers["ratio"]) == (7, -340, 0.5)
    assert registers.all("angle_set") == [-1] * 6
    assert registers.all("goals") == [-1, 0, 300]
    assert registers.kept() == {"unit": [7], "speed_code": [0], "offset": [-340]}
    registers.reset("unit")
    assert (registers["unit"], registers["offset"]) == (1, -340)
    assert Registers(MAP, kept=registers.kept())["offset"] == -340


def test_numbers_lie_in_memory_as_the_type_says():
    registers = Registers(MAP)
    registers["force"] = [1, -1, 2.6, 0, 5000, -5000]
    assert registers.all("force") == [1, -1, 3, 0, 4000, -4000]
    assert registers.read(1582, 4) == b"\x01\x00\xff\xff"
    registers["offset"] = -340
    assert registers.read(1600, 2) == b"\x54\x09"
    assert registers.read(1602, 6) == b"\x80\x01\x00\x00\x01\x2c"


def test_one_number_stands_for_all_and_another_count_is_an_error():
    registers = Registers(MAP)
    registers["angle_set"] = 500
    assert registers.all("angle_set") == [500] * 6
    with pytest.raises(ValueError, match="broadcast"):
        registers["angle_set"] = [1, 2, 3]


def test_a_write_names_what_it_touches_in_order():
    registers = Registers(MAP)
    assert registers.write(1486, b"\x01\x00\x02\x00") == ["angle_set"]
    assert registers.all("angle_set") == [1, 2, -1, -1, -1, -1]
    assert registers.write(1000, b"\x05\x00\x02\x00\x01\x01") == ["unit", "speed_code", "clear_error", "save"]
    assert registers.write(1487, b"\x00") == ["angle_set"]
    assert registers.write(1000, b"") == []


def test_gaps_in_a_writable_range_are_stored():
    registers = Registers(MAP)
    assert registers.write(1050, b"\x09") == []
    assert registers.read(1049, 3) == b"\x00\x09\x00"


@pytest.mark.parametrize(
    "address, data, why",
    [
        (1582, b"\0\0", "access"),
        (1061, b"\0", "address"),
        (5999, b"\0\0", "address"),
        (-1, b"\0", "address"),
        (1000, b"\x00", "value"),
        (1486, b"\x01\x00\xff\x7f", "value"),
        (1578, b"\0" * 6, "address"),
    ],
)
def test_a_refused_write_changes_nothing(address, data, why):
    registers = Registers(MAP)
    before = saved(registers)
    assert refusal(registers.write, address, data) == why
    assert saved(registers) == before


def test_reads_beyond_the_memory_or_of_write_only_registers_are_refused():
    registers = Registers(MAP)
    assert registers.read(0, 2) == b"\0\0"
    assert refusal(registers.read, 5999, 2) == "address"
    assert refusal(registers.read, -1, 2) == "address"
    assert refusal(registers.read, 1004, 2) == "access"


def test_a_memory_without_gaps_refuses_to_read_them():
    registers = Registers(RegisterMap([Reg(0, "a"), Reg(4, "b")], gaps=False))
    assert registers.read(4, 2) == b"\0\0"
    assert refusal(registers.read, 0, 4) == "address"


def test_every_register_can_be_walked():
    registers = Registers(MAP)
    for reg in MAP.rows:
        for value in (*reg.range, 0):
            if np.isfinite(value):
                registers[reg.name] = value
                assert registers[reg.name] == min(max(value, reg.range[0]), reg.range[1]), reg
                if reg.access == "rw":
                    assert registers.write(reg.address, registers.read(reg.address, reg.end - reg.address)) == [
                        reg.name
                    ]


def test_text_and_rows_are_the_same():
    row = Reg(1486, "angle_set", "<i2", 6, -1, 1000, -1, about="-1: stay")
    assert MAP.by_name["angle_set"] == row
    assert MAP.by_name["save"].access == "w" and MAP.by_name["force"].about == "[g]"
    assert RegisterMap(str(MAP)).rows == MAP.rows


@pytest.mark.parametrize(
    "text, message",
    [
        ("0  <u2  a\n1  u1  b", "'b' at 1 overlaps 'a', which ends at 1"),
        ("0  <u2  a\n2  <u2  a", "'a' occurs twice"),
        ("0  u2  a", "type 'u2': expected"),
        ("0  <u3  a", "type '<u3': expected"),
        ("a  <u2  a", "expected `address  type  name"),
        ("0 <u2 a", "expected `address  type  name"),
        ("0  <u2  a  1..5  = 9", "default 9 is not in 1..5"),
        ("0  u1 x 3  a  = 1, 2", "2 defaults for 3 numbers"),
        ("9  <u2  a", "ends at 10, beyond the memory's end at 9"),
    ],
)
def test_a_wrong_line_does_not_import_and_is_named(text, message):
    with pytest.raises(ValueError) as error:
        RegisterMap(text, size=10)
    assert message in str(error.value)


def test_a_copy_and_a_file_hold_what_was_written():
    registers = Registers(MAP)
    registers.write(1486, b"\x01\x00")
    copied, other = copy.deepcopy(registers), restored(saved(registers))
    registers["angle_set"] = 0
    for each in (copied, other):
        assert each.all("angle_set")[0] == 1
        assert each.write(1488, b"\x05\x00") == ["angle_set"]


def test_reading_125_registers_takes_microseconds():
    registers = Registers(MAP)
    registers["touch"] = np.arange(1062)
    assert min(timeit.repeat(lambda: registers.read(3000, 250, 0), number=200, repeat=20)) / 200 < 20e-6
