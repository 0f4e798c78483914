"""Dynamixel protocol 2.0 on three nodes, judged by ROBOTIS's own SDK."""

import copy
from collections import Counter

import pytest

from firmware_protocols import RegisterMap, Registers
from firmware_protocols.protocols.dynamixel import DynamixelLine, packet
from tests.kit.saving import restored, saved

MAP = RegisterMap(
    """
    0    <u2        model  = 1020  r
    6    u1         firmware  = 45  r
    7    u1         id     0..252
    9    u1         delay
    68   u1         level  0..2  = 2
    116  <u4        goal
    132  u1 x 9     touch
    """,
    size=200,
)


class Node:
    ping = b"\xfc\x03\x2d"

    def __init__(self, ident):
        self.registers = Registers(MAP, kept={"id": ident})
        self.alert = 0

    id = property(lambda self: self.registers["id"])
    delay_ns = property(lambda self: 2000 * self.registers["delay"])
    level = property(lambda self: self.registers["level"])

    def read(self, address, n, t_ns):
        return self.registers.read(address, n)

    def write(self, address, data, t_ns):
        return self.registers.write(address, data)

    def reboot(self, t_ns):
        self.registers = Registers(MAP, kept={"id": self.id})


class Bus:
    def __init__(self, ids=(1, 2, 3)):
        self.counters = Counter()
        self.line, self.nodes = DynamixelLine(counters=self.counters), [Node(ident) for ident in ids]

    def ask(self, data):
        return self.line.answers(data, 0, self.nodes)


@pytest.fixture
def bus():
    return Bus()


def error_of(bus, ident, instruction, params=b""):
    (reply,) = bus.ask(packet(ident, instruction, params))
    assert reply.frame[4] == ident and reply.frame[7] == 0x55
    return reply.frame[8]


def test_frames_of_the_description(bus):
    bus.nodes.append(Node(110))
    assert packet(0x6E, 1).hex(" ").upper() == "FF FF FD 00 6E 03 00 01 08 82"
    (reply,) = bus.ask(packet(0x6E, 2, b"\xda\x07\x09\x00"))
    assert reply.frame.hex(" ").upper() == "FF FF FD 00 6E 04 00 55 04 12 9F"


@pytest.mark.parametrize(
    "instruction, params, error",
    [
        (2, b"\0\0\2\0\0", 5), (2, b"\xff\0\1\0", 4), (3, b"\x07\0", 5), (3, b"\0\0\1\0", 7), (3, b"\x07\0\xfd", 6),
        (3, b"\x90\0\0", 4), (8, b"", 0), (8, b"\1", 5), (6, b"\xff", 2), (0x82, b"", 2),
    ],
)  # fmt: skip
def test_errors(bus, instruction, params, error):
    assert error_of(bus, 1, instruction, params) == error


def test_a_bad_crc_is_answered_by_who_is_meant_and_by_nobody_else(bus):
    for ident, wanted in ((2, [(2, 3)]), (0xFE, []), (9, [])):
        broken = bytearray(packet(ident, 1))
        broken[-1] ^= 1
        assert [(reply.frame[4], reply.frame[8]) for reply in bus.ask(bytes(broken))] == wanted
    assert bus.counters["bad_checksum"] == 3


def test_an_alert_is_in_every_error(bus):
    bus.nodes[0].alert = 0x80
    assert error_of(bus, 1, 1) == 0x80 and error_of(bus, 1, 6) == 0x82


def test_what_is_answered_and_when(bus):
    bus.nodes[0].registers["delay"] = 250
    assert bus.ask(packet(1, 1))[0].delay_ns == 500_000
    bus.nodes[0].registers["level"] = 1
    assert bus.ask(packet(1, 3, b"\x07\0\x14")) == []
    assert len(bus.ask(packet(20, 2, b"\0\0\1\0"))) == 1, "the new id"
    bus.nodes[0].registers["level"] = 0
    assert bus.ask(packet(20, 2, b"\0\0\1\0")) == [] and len(bus.ask(packet(20, 1))) == 1


def test_a_new_id_is_answered_by_the_old_one(bus):
    assert error_of(bus, 1, 3, b"\x07\0\x14") == 0
    assert bus.ask(packet(1, 1)) == []


def test_in_turn_with_gaps_and_fast_up_to_the_first_that_is_missing(bus):
    params = b"\x84\0\2\0" + bytes([3, 9, 1])
    assert [(reply.frame[4], reply.turn) for reply in bus.ask(packet(0xFE, 0x82, params))] == [(3, 0), (1, 2)]
    (fast,) = bus.ask(packet(0xFE, 0x8A, params))
    assert len(fast.frame) == 8 + 6 and int.from_bytes(fast.frame[5:7], "little") == 19
    assert bus.ask(packet(0xFE, 0x8A, b"\x84\0\2\0\x09")) == []
    assert [reply.turn for reply in bus.ask(packet(0xFE, 1))] == [1, 2, 3]


@pytest.mark.parametrize(
    "instruction, params",
    [(0x82, "84 00"), (0x92, "01 84 00"), (0x8A, "00 00 FF FF 01"), (0x83, "84 00 00 00 01"), (0x93, "01 84 00")],
)
def test_nonsense_to_all_is_silent(bus, instruction, params):
    assert bus.ask(packet(0xFE, instruction, bytes.fromhex(params))) == []


def test_pieces_garbage_and_a_saved_line(bus):
    ping = packet(1, 1)
    assert [reply for byte in b"\xff\xff\xff" + ping for reply in bus.ask(bytes([byte]))] == bus.ask(ping)
    bus.ask(ping[:5])
    for other in (copy.deepcopy(bus), restored(saved(bus))):
        assert len(other.ask(ping[5:])) == 1
    assert bus.ask(b"\xff\xff\xfd\x00\x01\xff\xff" + ping[5:]) == [] and bus.counters["bad_length"]


# -- ROBOTIS's own SDK as the judge ------------------------------------------------------------------------------------


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

    def reset_input_buffer(self):
        self.waiting = b""


@pytest.fixture
def sdk(bus):
    package = pytest.importorskip("dynamixel_sdk", reason="dynamixel-sdk, of the drivers extra, is not installed")
    port = package.PortHandler("nowhere")
    port.ser = Wire(bus)
    port.tx_time_per_byte = 0.01
    return package, port, package.PacketHandler(2.0)


def test_the_vendor_s_sdk_pings_reads_and_writes(sdk, bus):
    package, port, handler = sdk
    assert handler.ping(port, 3) == (1020, package.COMM_SUCCESS, 0)
    assert handler.broadcastPing(port)[0] == {ident: [1020, 45] for ident in (1, 2, 3)}
    assert handler.write4ByteTxRx(port, 2, 116, 0x01020304) == (package.COMM_SUCCESS, 0)
    assert handler.read4ByteTxRx(port, 2, 116) == (0x01020304, package.COMM_SUCCESS, 0)
    assert handler.write1ByteTxRx(port, 2, 0, 1) == (package.COMM_SUCCESS, 7)
    bus.nodes[0].registers["touch"] = [255, 255, 253, 0, 255, 255, 253, 253, 1]
    assert handler.readTxRx(port, 1, 132, 9)[0] == [255, 255, 253, 0, 255, 255, 253, 253, 1]


def test_the_vendor_s_sdk_reads_and_writes_in_groups(sdk, bus):
    package, port, handler = sdk
    write, bulk_write = package.GroupSyncWrite(port, handler, 116, 4), package.GroupBulkWrite(port, handler)
    read, bulk_read = package.GroupSyncRead(port, handler, 116, 4), package.GroupBulkRead(port, handler)
    for ident in (3, 1, 2):
        assert write.addParam(ident, [ident, 7, 0, 0]) and read.addParam(ident)
        assert bulk_read.addParam(ident, 116, 4) and bulk_write.addParam(ident, 118, 1, [ident])
    assert write.txPacket() == bulk_write.txPacket() == package.COMM_SUCCESS
    for group, ask in ((read, read.txRxPacket), (read, read.fastSyncRead), (bulk_read, bulk_read.txRxPacket),
                       (bulk_read, bulk_read.fastBulkRead)):  # fmt: skip
        assert ask() == package.COMM_SUCCESS
        assert [group.getData(ident, 116, 4) for ident in (3, 1, 2)] == [0x30703, 0x10701, 0x20702]
