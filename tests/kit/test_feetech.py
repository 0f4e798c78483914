import copy
from collections import Counter

import pytest

from firmware_protocols import RegisterMap, Registers
from firmware_protocols.protocols.feetech import MAX_DATA_BYTES, ServoLine, packet
from tests.kit.saving import restored, saved

MAP = RegisterMap(
    """
    3   <u2           model       = 777          r
    5   u1            id          0..253  = 1    flash
    7   u1            delay                      flash      2 us each
    8   u1            level       0..1  = 1      flash
    31  <u2 sign 11   offset                     flash
    40  u1            torque
    42  <u2 sign 15   goal
    56  <u2 sign 15   position    = 2090         r
    """,
    size=90,
)


class Servo:
    status = 0

    def __init__(self, ident):
        self.registers = Registers(MAP, kept={"id": ident})

    id = property(lambda self: self.registers["id"])
    delay_ns = property(lambda self: 2000 * self.registers["delay"])
    confirms = property(lambda self: self.registers["level"] == 1)

    def read(self, address, n, t_ns):
        return self.registers.read(address, n, t_ns)

    def write(self, address, data, t_ns):
        return self.registers.write(address, data, t_ns)


class Bus:
    def __init__(self, ids=(1, 2, 3, 4, 5, 6)):
        self.counters = Counter()
        self.line, self.servos = ServoLine(counters=self.counters), [Servo(ident) for ident in ids]

    def ask(self, data):
        data = bytes.fromhex(data) if isinstance(data, str) else data
        return self.line.answers(data, 0, self.servos)

    def frames(self, data):
        return [reply.frame.hex(" ").upper() for reply in self.ask(data)]


@pytest.fixture
def bus():
    return Bus()


@pytest.mark.parametrize(
    "request_, reply",
    [
        ("FF FF 01 02 01 FB", "FF FF 01 02 00 FC"),
        ("FF FF 01 04 03 28 01 CE", "FF FF 01 02 00 FC"),
        ("FF FF 01 04 02 03 02 F3", "FF FF 01 04 00 09 03 EE"),
        ("FF FF 01 04 02 38 02 BE", "FF FF 01 04 00 2A 08 C8"),
        ("FF FF 02 05 03 1F 54 09 79", "FF FF 02 02 00 FB"),
        ("FF FF 01 05 04 2A 00 08 C3", "FF FF 01 02 00 FC"),
    ],
)
def test_frames_that_lerobot_exchanged(bus, request_, reply):
    assert bus.frames(request_) == [reply]


def test_a_sign_and_magnitude_offset(bus):
    bus.ask("FF FF 02 05 03 1F 54 09 79")
    assert bus.servos[1].registers["offset"] == -340


def test_a_sync_read_is_answered_in_the_order_of_its_list_with_gaps_for_the_missing(bus):
    answers = bus.ask(packet(0xFE, 0x82, bytes([5, 1, 6, 9, 2])))
    assert [(reply.frame[2], reply.turn) for reply in answers] == [(6, 0), (2, 2)]
    assert len(bus.ask("FF FF FE 0A 82 38 02 01 02 03 04 05 06 26")) == 6


def test_a_sync_write_is_obeyed_and_not_answered(bus):
    assert bus.ask("FF FF FE 0A 83 2A 02 01 00 08 02 64 09 D0") == []
    assert [servo.registers["goal"] for servo in bus.servos[:3]] == [2048, 2404, 0]


def test_a_reg_write_waits_for_the_action(bus):
    bus.ask("FF FF 01 05 04 2A 00 08 C3")
    assert bus.servos[0].registers["goal"] == 0
    assert list(bus.line.pending) == [1]
    assert bus.ask("FF FF FE 02 05 FA") == []
    assert bus.servos[0].registers["goal"] == 2048
    assert not bus.line.pending


def test_a_broadcast_ping_is_answered_by_all_in_turn(bus):
    answers = bus.ask(packet(0xFE, 0x01))
    assert [reply.frame[2] for reply in sorted(answers, key=lambda reply: reply.turn)] == [1, 2, 3, 4, 5, 6]
    assert len({reply.turn for reply in answers}) == 6


def test_a_new_id_is_answered_by_the_old_one(bus):
    assert bus.frames(packet(1, 3, bytes([5, 20]))) == ["FF FF 01 02 00 FC"]
    assert bus.ask(packet(1, 1)) == []
    assert len(bus.ask(packet(20, 1))) == 1


def test_a_servo_may_answer_later_and_only_reads(bus):
    bus.servos[0].registers["delay"], bus.servos[0].registers["level"] = 250, 0
    assert [reply.delay_ns for reply in bus.ask(packet(1, 1))] == [500_000]
    assert bus.ask(packet(1, 3, bytes([40, 1]))) == []
    assert bus.servos[0].registers["torque"] == 1


def test_what_cannot_be_read_is_zero_and_what_cannot_be_written_is_counted(bus):
    assert bus.frames(packet(1, 2, bytes([200, 2]))) == ["FF FF 01 04 00 00 00 FA"]
    assert len(bus.ask(packet(1, 3, bytes([3, 1])))) == 1
    assert bus.counters["refused"] == 1


@pytest.mark.parametrize(
    "to, instruction, params",
    [(1, 0x77, ""), (1, 2, "05"), (1, 2, "05 FF"), (1, 3, "05"), (0xFE, 0x82, ""), (0xFE, 0x83, "2A 02 01 00")],
)
def test_an_instruction_that_makes_no_sense_is_silent_and_counted(bus, to, instruction, params):
    assert bus.ask(packet(to, instruction, bytes.fromhex(params))) == []
    assert bus.counters["unknown_command"] == 1


def test_the_longest_read_fits_its_length_byte(bus):
    assert len(bus.ask(packet(1, 2, bytes([0, MAX_DATA_BYTES])))[0].frame) == MAX_DATA_BYTES + 6


def test_garbage_byte_by_byte_and_across_a_file(bus):
    ping = packet(1, 1)
    assert [reply for byte in b"\xff\x00" + ping for reply in bus.ask(bytes([byte]))] == bus.ask(ping)
    bus.ask("FF FF 01 05 04 2A 00 08 C3")
    bus.ask(ping[:3])
    for other in (copy.deepcopy(bus), restored(saved(bus))):
        assert len(other.ask(ping[3:])) == 1
        other.ask("FF FF FE 02 05 FA")
        assert other.servos[0].registers["goal"] == 2048


# -- Feetech's own SDK as the judge ------------------------------------------------------------------------------------


class Wire:
    """What the SDK takes for pyserial's port."""

    def __init__(self, bus):
        self.bus, self.waiting = bus, b""

    def write(self, data):
        answers = sorted(self.bus.ask(bytes(data)), key=lambda reply: reply.turn)
        self.waiting += b"".join(reply.frame for reply in answers)
        return len(data)

    def read(self, n):
        data, self.waiting = self.waiting[:n], self.waiting[n:]
        return data

    def flush(self):
        pass


@pytest.fixture
def sdk(bus):
    scservo_sdk = pytest.importorskip("scservo_sdk", reason="feetech-servo-sdk, of the drivers extra, is not installed")
    port = scservo_sdk.PortHandler("nowhere")
    port.ser = Wire(bus)
    return scservo_sdk, port, scservo_sdk.PacketHandler(0)


def test_the_vendor_s_sdk_pings_reads_and_writes(sdk, bus):
    scservo_sdk, port, handler = sdk
    assert handler.ping(port, 3) == (777, scservo_sdk.COMM_SUCCESS, 0)
    assert handler.write2ByteTxRx(port, 3, 42, 1500) == (scservo_sdk.COMM_SUCCESS, 0)
    assert handler.read2ByteTxRx(port, 3, 42) == (1500, scservo_sdk.COMM_SUCCESS, 0)
    assert handler.regWriteTxRx(port, 4, 42, 2, [0, 8])[0] == scservo_sdk.COMM_SUCCESS
    assert handler.action(port, 0xFE) == scservo_sdk.COMM_SUCCESS
    assert bus.servos[3].registers["goal"] == 2048


def test_the_vendor_s_sdk_reads_and_writes_in_groups(sdk, bus):
    scservo_sdk, port, handler = sdk
    write = scservo_sdk.GroupSyncWrite(port, handler, 42, 2)
    read = scservo_sdk.GroupSyncRead(port, handler, 42, 2)
    for ident in (5, 2, 6):
        assert write.addParam(ident, [ident, 1]) and read.addParam(ident)
    assert write.txPacket() == scservo_sdk.COMM_SUCCESS
    assert read.txRxPacket() == scservo_sdk.COMM_SUCCESS
    assert [read.getData(ident, 42, 2) for ident in (5, 2, 6)] == [0x105, 0x102, 0x106]
