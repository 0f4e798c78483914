"""ROHand's packets: on CAN and on a UART, errors, settings, motors, its number."""

import struct

import numpy as np
import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

NAME = "rohand_can"


def packet(command: int, data: bytes = b"", to: int = 2) -> bytes:
    content = bytes([to, 1, command, len(data), *data])
    return b"\x55\xaa" + content + bytes([np.bitwise_xor.reduce(np.frombuffer(content, np.uint8))])


def ask(device, command: int, data: bytes = b"", t_ns: int = 0, to: int = 2) -> tuple[int, bytes]:
    """What the driver makes of the answer: the command and its data."""
    sent = packet(command, data, to)
    got = []
    for k in range(0, len(sent), 8):
        got += device.receive(fp.CanFrame(arbitration_id=to, data=sent[k : k + 8]), t_ns, "")
    frames = [each for each in got if isinstance(each, fp.CanFrame)]
    assert {frame.arbitration_id for frame in frames} <= {1}
    answer = b"".join(frame.data for frame in frames)
    if not answer:
        return -1, b""
    assert answer[:4] == b"\x55\xaa\x01\x02"[:3] + bytes([answer[3]]) and len(answer) == answer[5] + 7
    return answer[4], answer[6:-1]


def test_dots_of_a_part_and_the_zero():
    device = fp.create(NAME)
    sample(device, np.arange(304) % 100 / 50)
    assert ask(device, 0x08, b"\x04") == (0x08, bytes([4, 32, *(np.arange(216, 248) % 100)]))
    assert ask(device, 0x54) == (0x54, b"")
    sample(device, np.arange(304) % 100 / 50)
    assert not any(ask(device, 0x08, b"\x04")[1][2:])


@pytest.mark.parametrize(("command", "data", "code"), [
    (0x7F, b"", 0x11), (0x5F, b"\1", 0x11), (0x08, b"", 0x12), (0x08, b"\x06", 0x13), (0x04, b"\x06", 0x13),
    (0x46, b"\1\2", 0x12), (0x46, b"\x06\1\2", 0x13), (0x4C, b"\x06\0\0\xff", 0x13),
])  # fmt: skip
def test_errors(command, data, code):
    device = fp.create(NAME)
    sample(device)
    assert ask(device, command, data) == (command | 0x80, bytes([code]))


def test_settings_are_stored():
    device = fp.create(NAME)
    assert ask(device, 0x52, b"\3" + struct.pack("<4H", 1, 2, 3, 4)) == (0x52, b"")
    assert ask(device, 0x11, b"\3")[1] == b"\3" + struct.pack("<4H", 1, 2, 3, 4)
    assert ask(device, 0x66, struct.pack("<2Hf", 5, 6, 0.5)) == (0x66, b"")
    assert ask(device, 0x3D)[1] == struct.pack("<2Hf", 5, 6, 0.5)


def test_fingers_go_to_positions_and_angles_and_stop():
    device = fp.create(NAME)
    ask(device, 0x4C, struct.pack("<BHB", 1, 65535, 255))
    assert ask(device, 0x0B, b"\1", 5 * 10**8)[1] == struct.pack("<B2H", 1, 65535, 32768)
    assert ask(device, 0x06, b"\1", 5 * 10**8)[1] == struct.pack("<BH", 1, 200)
    ask(device, 0x4A, b"\x3f", 5 * 10**8)
    assert ask(device, 0x0B, b"\1", 10**9)[1] == struct.pack("<B2H", 1, 32768, 32768)
    ask(device, 0x51, struct.pack("<" + "hB" * 6, *(3670, 255, 13930, 255, 17606, 255, 17656, 255, 17486, 255, 0, 255)))
    goals = struct.unpack("<12h", ask(device, 0x10, t_ns=3 * 10**9)[1])
    assert goals[1] == goals[7] == 13930 and goals[2] == 17606


def test_another_number_is_kept():
    device = fp.create(NAME)
    assert ask(device, 0x42, b"\5") == (0x42, b"")
    assert ask(device, 0x00) == (-1, b"") and ask(device, 0x00, to=5) == (0x00, b"\0\2")
    device.power_cycle()
    assert device.number == 5 and device.ports[0].filters[0] == (5, 0x7FF)


def test_on_a_uart_packets_go_as_they_are():
    device = fp.create(NAME, line="uart")
    sent = packet(0x00) + b"\0" + packet(0x21)
    assert send(device, sent[:9]) + send(device, sent[9:]) == [
        bytes.fromhex("55AA01020002000203"), bytes.fromhex("55AA0102210101" + "22"),
    ]  # fmt: skip
    assert send(fp.create(NAME), "003#55AA0201000003") == []
