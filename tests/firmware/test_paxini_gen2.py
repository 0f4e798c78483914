"""PaXini GEN2 control box: framing, ports, modes, errors."""

import struct

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols import Sent
from tests.firmware.feeding import sample, send


def ask(device, main, sub, data=b"", t_ns=0):
    body = struct.pack(">BBBH", 0x0E, 9, main, sub) + struct.pack("<H", len(data)) + data
    wire = bytes.fromhex("55aa7b7b") + body + bytes([-sum(body) & 0xFF]) + bytes.fromhex("55aa7d7d")
    (reply,) = send(device, wire, t_ns)
    assert reply[:4].hex() == "55aa7b7b" and reply[-4:].hex() == "55aa7d7d" and sum(reply[4:-4]) & 0xFF == 0
    assert reply[4:6] == b"\x0e\x09" and struct.unpack_from(">BH", reply, 6) == (main, sub)
    assert struct.unpack_from("<H", reply, 10)[0] == len(reply) - 17
    return reply[9], reply[12:-5]


def read(device, start, count):
    where = struct.pack("<BHH", 0x7B, start, count)
    error, data = ask(device, 0x70, 0xC006, where)
    assert error == 0 and data[0] == 0 and data[1:6] == where
    return data[6:]


def test_the_360_bytes_that_the_driver_reads():
    device = fp.create("paxini_gen2")
    force = np.zeros((120, 3))
    force[119] = (0.5, -0.6, -1.0)
    sample(device, force=force)
    data = read(device, 1038, 360)
    assert not any(data[:-3]) and data[-3:] == bytes([5, 256 - 6, 10])


def test_ports_select_modules():
    device = fp.create("paxini_gen2", models=["M2020", "S1610"], places=[0, 4])
    force = np.zeros((34, 3))
    force[9:, 2] = -0.3
    sample(device, force=force)
    assert read(device, 1038, 27) == bytes(27)
    assert ask(device, 0x70, 0xB10A, b"\x04") == (0, b"")
    assert read(device, 1038, 75) == bytes([0, 0, 3] * 25)
    ask(device, 0x70, 0xB10A, b"\x05")
    assert ask(device, 0x70, 0xC006, struct.pack("<BHH", 0x7B, 1038, 3)) == (7, b"")


def test_mode_takes_its_time_once():
    device = fp.create("paxini_gen2", mode_time_s=2.0)
    request = bytes.fromhex("55aa7b7b 0e0170c00c010002 b2 55aa7d7d".replace(" ", ""))
    (answer,) = device.receive(request, 0, "")
    assert isinstance(answer, Sent) and answer.delay_ns == 2_000_000_000
    (answer,) = device.receive(request, 10**10, "")
    assert answer.delay_ns == 0
    assert ask(device, 0x70, 0xC00D) == (0, b"\x02")
    assert ask(device, 0x70, 0xC00C, b"\x09")[0] == 6


def test_zero_obeys_although_its_answer_says_error_6():
    device = fp.create("paxini_gen2")
    sample(device, 1.0)
    assert ask(device, 0x70, 0xB002, b"\x03\x01") == (6, b"\0")
    assert read(device, 1008, 33) == bytes(33)


def test_its_version_comes_before_the_driver_looks_for_it():
    # 10 ms after asking, once: its port is USB, where nothing is paced.
    device = fp.create("paxini_gen2")
    (answer,) = device.receive(bytes.fromhex("55aa7b7b0e0160a0010000f055aa7d7d"), 0, "")
    assert answer.delay_ns == 0 and device.ports[0].usb


@pytest.mark.parametrize(
    ("wire", "error"),
    [
        ("55aa7b7b 0e01 60 a001 0000 f1 55aa7d7d", 2),
        ("55aa7b7b 0e01 60 a001 0000 f0 55aa7d7e", 1),
        ("55aa7b7b 0e01 60 a001 ffff", 5),
        ("55aa7b7b 0e01 61 a001 0000 ef 55aa7d7d", 3),
        ("55aa7b7b 0e01 60 a101 0000 ef 55aa7d7d", 4),
        ("55aa7b7b 0e01 60 a001 0100 00 ef 55aa7d7d", 1),
    ],
    ids=["LRC", "tail", "longer than the buffer", "main command", "sub command", "data length"],
)
def test_errors_are_the_vendors(wire, error):
    device = fp.create("paxini_gen2")
    (reply,) = send(device, wire)
    assert reply[9] == error
    assert ask(device, 0x70, 0xC00D, t_ns=10**9) == (0, b"\x05")


def test_a_port_without_a_module_has_no_data():
    # The vendor PDF's example of "no data".
    device = fp.create("paxini_gen2", places=[1])
    send(device, "55aa7b7b 0e01 70 b10a 0100 00 c5 55aa7d7d")
    (reply,) = send(device, "55aa7b7b 0e00 70 c006 0500 7b0e041e00 0c 55aa7d7d")
    assert reply.hex() == "55aa7b7b0e0070c006070000b555aa7d7d"
