import copy
import timeit
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocols import Refused, RegisterMap, Registers
from firmware_protocols.protocols.modbus import Banks, Mbap, Rtu, answer, mbap, rtu, silence_ns
from tests.kit.saving import restored, saved

HOLDING = RegisterMap("0  >u2 x 200  words\n400  >i2  goal  -5..1000", size=500)
INPUTS = RegisterMap("0  >u2 x 8  readings  r")
BITS = RegisterMap("0  u1 x 40  bits  0..1")
LITTLE = RegisterMap("1000  <i2 x 6  angles\n2000  u1  unit", size=6000)


class Unit:
    def __init__(self):
        self.holding, self.inputs = Registers(HOLDING), Registers(INPUTS)
        self.coils, self.discretes = Registers(BITS), Registers(BITS)

    @property
    def banks(self):
        return Banks(holding=self.holding, inputs=self.inputs, coils=self.coils, discretes=self.discretes)


def ask(banks, text: str) -> str:
    return answer(bytes.fromhex(text), banks, 0).hex(" ").upper()


@pytest.fixture
def unit():
    return Unit()


def test_registers_are_read_and_written(unit):
    assert ask(unit.banks, "06 00 01 00 03") == "06 00 01 00 03"
    assert ask(unit.banks, "10 00 02 00 02 04 00 0A 01 02") == "10 00 02 00 02"
    assert ask(unit.banks, "03 00 00 00 04") == "03 08 00 00 00 03 00 0A 01 02"
    unit.inputs["readings"] = range(8)
    assert ask(unit.banks, "04 00 07 00 01") == "04 02 00 07"


def test_coils_are_packed_low_bit_first(unit):
    # The examples of the specification, 6.1 and 6.11.
    unit.coils["bits"] = [0] * 19 + [int(bit) for bit in "1011001111010110101"] + [0, 0]
    assert ask(unit.banks, "01 00 13 00 13") == "01 03 CD 6B 05"
    assert ask(unit.banks, "0F 00 13 00 0A 02 CD 01") == "0F 00 13 00 0A"
    assert ask(unit.banks, "01 00 13 00 0A") == "01 02 CD 01"
    assert ask(unit.banks, "05 00 00 FF 00") == "05 00 00 FF 00"
    assert unit.coils["bits"] == 1
    assert ask(unit.banks, "02 00 00 00 01") == "02 01 00"


def test_a_firmware_may_know_few_functions(unit):
    few = Banks(holding=unit.holding, functions=(3, 6))
    assert ask(few, "06 00 01 00 03") == "06 00 01 00 03"
    assert ask(few, "10 00 02 00 02 04 00 0A 01 02") == "90 01"
    assert ask(few, "16 00 01 00 F2 00 25") == "96 01"


def test_a_mask_write_changes_bits(unit):
    # The example of the specification, 6.16.
    unit.holding["words"] = 0x12
    assert ask(unit.banks, "16 00 04 00 F2 00 25") == "16 00 04 00 F2 00 25"
    assert unit.holding.all("words")[3:6] == [0x12, 0x17, 0x12]


def test_read_and_write_in_one_writes_first(unit):
    assert ask(unit.banks, "17 00 00 00 02 00 01 00 01 02 00 FF") == "17 04 00 00 00 FF"


@pytest.mark.parametrize(
    "request_, code",
    [
        ("07", 1),
        ("2B 0E 01 00", 1),
        ("03 00 FA 00 01", 2),
        ("03 FF FF 00 02", 2),
        ("01 00 28 00 01", 2),
        ("06 01 00 00 00", 2),
        ("03 00 00 00 00", 3),
        ("03 00 00 00 7E", 3),
        ("03 00 00 00", 3),
        ("01 00 00 07 D1", 3),
        ("05 00 00 00 01", 3),
        ("0F 00 00 00 09 01 FF", 3),
        ("10 00 00 00 02 02 00 00", 3),
        ("10 00 00 00 00 00", 3),
        ("17 00 00 00 7E 00 00 00 01 02 00 00", 3),
        ("06 00 C8 03 E9", 3),
    ],
)
def test_what_cannot_be_done_is_answered_with_its_exception(unit, request_, code):
    before = saved(unit.holding)
    function = bytes.fromhex(request_)[0]
    assert ask(unit.banks, request_) == bytes([function | 0x80, code]).hex(" ").upper()
    assert saved(unit.holding) == before


def test_functions_of_a_missing_bank_are_unknown():
    banks = Banks(holding=Registers(HOLDING))
    assert [ask(banks, request)[3:] for request in ("01 00 00 00 01", "04 00 00 00 01", "05 00 00 00 00")] == ["01"] * 3


class Stubborn:
    def read(self, address, n, t_ns):
        raise Refused("busy")

    def write(self, address, data, t_ns):
        raise Refused("failure")


def test_a_memory_may_be_busy_or_fail():
    banks = Banks(holding=Stubborn())
    assert ask(banks, "03 00 00 00 01") == "83 06"
    assert ask(banks, "06 00 00 00 01") == "86 04"


def test_a_memory_in_bytes_with_the_low_byte_first_is_seen_in_words():
    registers = Registers(LITTLE)
    registers["angles"] = [1, -2, 3, 4, 5, 6]
    banks = Banks(holding=registers, step=1, low_first=True)
    assert ask(banks, "03 03 E8 00 02") == "03 04 00 01 FF FE"
    assert ask(banks, "06 03 EA 01 02") == "06 03 EA 01 02"
    assert registers.all("angles")[1] == 0x0102


# -- RTU ---------------------------------------------------------------------------------------------------------------

READ = rtu(1, bytes.fromhex("03 00 00 00 02"))
WRITE = rtu(1, bytes.fromhex("10 00 02 00 02 04 00 0A 01 02"))


def line(**options):
    counters = Counter()
    return Rtu(counters=counters, **options), counters


def test_the_exception_of_a_captured_frame():
    heard, _ = line()
    banks = Banks(holding=Registers(LITTLE), step=1, low_first=True)
    assert heard.answers(bytes.fromhex("01 03 17 6F 00 01 B1 A3"), 0, {1: banks}) == [bytes.fromhex("01 83 02 C0 F1")]


def test_several_units_answer_on_one_line_and_others_are_left_alone():
    heard, counters = line()
    units = {1: Unit(), 9: Unit()}
    banks = {number: unit.banks for number, unit in units.items()}
    units[9].holding["words"] = 7
    third = rtu(3, bytes.fromhex("03 00 00 00 02"))
    answers = heard.answers(READ + third + rtu(9, READ[1:-2]), 0, banks)
    assert answers == [rtu(1, bytes.fromhex("03 04 00 00 00 00")), rtu(9, bytes.fromhex("03 04 00 07 00 07"))]
    assert counters == {"requests": 2, "other_unit": 1}


def test_a_broadcast_is_obeyed_by_all_and_answered_by_none():
    heard, _ = line()
    units = {1: Unit(), 2: Unit()}
    assert heard.answers(rtu(0, bytes.fromhex("06 00 00 00 05")), 0, {k: u.banks for k, u in units.items()}) == []
    assert [unit.holding["words"] for unit in units.values()] == [5, 5]


def test_another_unit_s_answer_does_not_swallow_our_request(unit):
    heard, counters = line()
    for words in (1, 2, 5):
        theirs = rtu(2, bytes([3, 2 * words]) + b"\x12" * 2 * words)
        assert heard.answers(theirs, 0, {1: unit.banks}) == []
        assert len(heard.answers(READ, 0, {1: unit.banks})) == 1
    assert counters == {"other_unit": 3, "requests": 3}


def test_a_silence_forgets_half_a_frame_and_a_wrong_crc_all_of_it(unit):
    heard, counters = line(gap_ns=silence_ns(115200))
    assert heard.answers(READ[:5], 0, {1: unit.banks}) == []
    assert len(heard.answers(READ, 1_750_001, {1: unit.banks})) == 1
    assert heard.answers(READ[:-1] + b"\0", 2_000_000, {1: unit.banks}) == []
    assert len(heard.answers(READ, 2_000_000, {1: unit.banks})) == 1
    assert counters == {"broken_frames": 1, "bad_checksum": 1, "requests": 2}
    assert silence_ns(9600) == pytest.approx(4.01e6, rel=1e-3)


def test_an_unknown_function_ends_where_its_crc_fits(unit):
    heard, counters = line()
    assert heard.answers(rtu(1, bytes.fromhex("41 01 02 03")), 0, {1: unit.banks}) == [rtu(1, b"\xc1\x01")]
    assert counters == {"requests": 1, "refused": 1}


def test_an_exception_heard_is_not_answered(unit):
    heard, counters = line()
    assert heard.answers(rtu(1, b"\x83\x02"), 0, {1: unit.banks}) == []
    assert counters == {"broken_frames": 1}


@given(st.lists(st.sampled_from([READ, WRITE, rtu(1, b"\x16" + bytes(6)), rtu(2, READ[1:-2])]), max_size=6))
def test_byte_by_byte_is_the_same_as_whole(frames):
    data = b"".join(frames)
    (whole, whole_counters), (slow, slow_counters) = line(), line()
    first, second = Unit(), Unit()
    expected = whole.answers(data, 0, {1: first.banks})
    assert [a for b in data for a in slow.answers(bytes([b]), 0, {1: second.banks})] == expected
    assert whole_counters == slow_counters
    assert saved(first.holding) == saved(second.holding)


@given(st.binary(max_size=2000))
def test_garbage_is_bounded_and_a_request_after_a_silence_is_answered(garbage):
    unit = Unit()
    for heard, framed in ((line()[0], READ), (Mbap(counters=Counter()), mbap(1, READ[1:-2]))):
        units = {1: unit.banks}
        heard.answers(garbage, 0, units)
        assert len(saved(heard)) < 6000
        heard.reset()
        assert len(heard.answers(framed, 1, units)) == 1


def test_half_a_frame_survives_a_copy_and_a_file(unit):
    heard, counters = line()
    heard.answers(WRITE[:7], 0, {1: unit.banks})
    for other, _ in (copy.deepcopy((heard, counters)), restored(saved((heard, counters)))):
        assert len(other.answers(WRITE[7:], 0, {1: unit.banks})) == 1


# -- TCP ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [0, 1, 255])
def test_over_tcp_any_unit_is_answered_and_echoed(unit, number):
    message = mbap(number, READ[1:-2], transaction=0x1234)
    for chunks in ([message], [bytes([byte]) for byte in message]):
        heard = Mbap(counters=Counter())
        answers = [reply for chunk in chunks for reply in heard.answers(chunk, 0, unit.banks)]
        assert answers == [bytes.fromhex("12 34 00 00 00 07") + bytes([number]) + bytes.fromhex("03 04 00 00 00 00")]


def test_a_gateway_has_the_units_that_it_names(unit):
    counters = Counter()
    heard = Mbap(counters=counters)
    assert heard.answers(mbap(2, READ[1:-2]), 0, {1: unit.banks}) == []
    assert len(heard.answers(mbap(1, READ[1:-2]), 0, {1: unit.banks})) == 1
    assert counters == {"other_unit": 1, "requests": 1}


@pytest.mark.parametrize("header", ["0001 0001 0006 01", "0001 0000 0001 01", "0001 0000 00FF 01"])
def test_a_header_that_cannot_be_one_forgets_what_came(unit, header):
    counters = Counter()
    heard = Mbap(counters=counters)
    assert heard.answers(bytes.fromhex(header), 0, unit.banks) == []
    assert len(heard.answers(mbap(1, READ[1:-2]), 0, unit.banks)) == 1
    assert counters["broken_frames"] == 1


# -- pymodbus as the judge ---------------------------------------------------------------------------------------------


@pytest.fixture
def judge():
    pytest.importorskip("pymodbus")
    from pymodbus.framer import FramerRTU, FramerSocket
    from pymodbus.pdu import DecodePDU

    class Client:
        """Frames requests and decodes answers with pymodbus alone."""

        def __init__(self, framer, heard, units):
            self.framer, self.heard, self.units = framer(DecodePDU(is_server=False)), heard, units

        def ask(self, request):
            [frame] = self.heard.answers(self.framer.buildFrame(request), 0, self.units)
            size, reply = self.framer.handleFrame(frame, request.dev_id, request.transaction_id)
            assert size == len(frame)
            return reply

    unit = Unit()
    rtu_line = Client(FramerRTU, Rtu(counters=Counter()), {1: unit.banks})
    return rtu_line, Client(FramerSocket, Mbap(counters=Counter()), unit.banks)


@pytest.mark.parametrize("over", [0, 1], ids=["rtu", "tcp"])
def test_pymodbus_writes_and_reads_everything_back(judge, over):
    from pymodbus.pdu import bit_message as bits
    from pymodbus.pdu import register_message as words

    client = judge[over]
    at = {"address": 3, "dev_id": 1, "transaction_id": 7 * over}
    client.ask(words.WriteMultipleRegistersRequest(registers=[1, 2, 65535], **at))
    client.ask(words.WriteSingleRegisterRequest(registers=[9], **at))
    client.ask(words.MaskWriteRegisterRequest(address=4, and_mask=0xFFF0, or_mask=5, dev_id=1, transaction_id=7 * over))
    assert client.ask(words.ReadHoldingRegistersRequest(count=3, **at)).registers == [9, 5, 65535]
    both = words.ReadWriteMultipleRegistersRequest(
        read_address=3, read_count=2, write_address=4, write_registers=[77], dev_id=1, transaction_id=7 * over
    )
    assert client.ask(both).registers == [9, 77]
    assert client.ask(words.ReadInputRegistersRequest(count=2, **at)).registers == [0, 0]
    client.ask(bits.WriteMultipleCoilsRequest(bits=[True, False, True], **at))
    client.ask(bits.WriteSingleCoilRequest(bits=[True], address=4, dev_id=1, transaction_id=7 * over))
    assert client.ask(bits.ReadCoilsRequest(count=4, **at)).bits[:4] == [True, True, True, False]
    assert client.ask(bits.ReadDiscreteInputsRequest(count=4, **at)).bits[:4] == [False] * 4
    refused = client.ask(words.ReadHoldingRegistersRequest(address=5000, count=1, dev_id=1, transaction_id=7 * over))
    assert refused.isError() and refused.exception_code == 2


def test_125_registers_through_rtu_take_microseconds(unit):
    heard, _ = line()
    banks, frame = {1: unit.banks}, rtu(1, bytes.fromhex("03 00 00 00 7D"))
    assert len(heard.answers(frame, 0, banks)[0]) == 255
    assert min(timeit.repeat(lambda: heard.answers(frame, 0, banks), number=100, repeat=20)) / 100 < 100e-6
