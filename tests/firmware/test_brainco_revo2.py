"""BrainCo Revo2 Touch: fingertips and pads, zeros, and Modbus inside CAN-FD frames."""

import struct

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols import CanFrame
from firmware_protocols.protocols.modbus import rtu
from tests.firmware.feeding import sample, send


def ask(device, pdu: bytes, t_ns: int = 0) -> bytes:
    (reply,) = send(device, rtu(device.unit, pdu), t_ns)
    return reply[1:-2]


def read(device, address, count, t_ns: int = 0) -> list[int]:
    return list(struct.unpack(f">{count}H", ask(device, struct.pack(">BHH", 4, address, count), t_ns)[2:]))


def write(device, address, *values, t_ns: int = 0) -> bytes:
    return ask(device, struct.pack(f">BHHB{len(values)}H", 16, address, len(values), 2 * len(values), *values), t_ns)


def test_a_finger_feels_shear_and_nearness():
    device = fp.create("brainco_revo2")
    forces = np.zeros((5, 3))
    forces[2] = (0.0, 0.3, -0.4)
    device.measure(fp.Reading({"force": forces}), 0)
    assert device.counts[2].tolist() == [40, 30, 90, 4000]
    assert read(device, 4200 + 6, 3) == [40, 30, 90] and read(device, 4215 + 4, 2) == [0, 4000]
    assert read(device, 4250 + 12, 6) == [40, 30, 90, 0xA00F, 0, 0], "4000, low byte first"


@pytest.mark.parametrize("order", [4005, 4010])
def test_a_zero_of_some_fingers(order):
    device = fp.create("brainco_revo2")
    sample(device, 1.0)
    write(device, order, 1, 0, 0, 0, 1)
    sample(device, 1.5)
    assert device.counts[:, 0].tolist() == [50, 150, 150, 150, 50] and read(device, order, 5) == [0] * 5
    write(device, 4000, 1, 0, 1, 1, 1)
    sample(device, 1.5)
    assert device.counts[:, 0].tolist() == [50, 0, 150, 150, 50]


def test_pads_and_their_units():
    device = fp.create("brainco_revo2", touch="pressure", side="right")
    write(device, 6310, 0, 0, 0, 0, 0, 1)
    sample(device, 0.5)
    assert read(device, 6010, 3) == [100] * 3 and read(device, 6001, 6) == [900] * 5 + [4600]
    write(device, 6310, 0, 0, 0, 0, 0, 1)
    write(device, 6000, 2)
    sample(device, 0.6)
    assert read(device, 6054, 2) == [600, 100]


@pytest.mark.parametrize(
    ("frame", "counter"),
    [
        ("007F0108##17E030385000 19E68".replace(" ", ""), "ignored"),
        ("007E0108#7E03038500019E68", "ignored"),
        ("007E0108##17E03038500019E69", "bad_checksum"),
        ("007E0107##17E03038500019E68", "bad_checksum"),
        ("007E0130##17E03038500019E68", "bad_checksum"),
        ("007E0100##1", "bad_checksum"),
    ],
)
def test_frames_that_are_not_answered(frame, counter):
    device = fp.create("brainco_revo2_canfd")
    assert send(device, frame) == [] and device.counters[counter] == 1


def test_an_answer_goes_to_the_host_that_asked():
    (reply,) = send(fp.create("brainco_revo2_canfd"), "007E0808##17E03038500019E68")
    assert isinstance(reply, CanFrame) and reply.is_fd and reply.bitrate_switch
    assert reply.arbitration_id == 0x7E0807 and reply.data[:5] == bytes.fromhex("7E03020002")


def test_what_the_hand_says_of_itself():
    for device, unit in ((fp.create("brainco_revo2"), 126), (fp.create("brainco_revo2", side="right"), 127)):
        assert read(device, 1000, 3) == [unit, 3, 10]


def test_another_line_restarts_the_hand_which_keeps_it():
    device = fp.create("brainco_revo2")
    outs = device.receive(rtu(0x7E, bytes.fromhex("06 03E9 0004")), 0, "")
    assert isinstance(outs[-1], fp.Restart)
    device.power_cycle()
    assert device.ports[0].baud == 1_000_000 and read(device, 1001, 1) == [4]
    outs = device.receive(rtu(0x7E, bytes.fromhex("06 03E9 0004")), 0, "")
    assert not any(isinstance(out, fp.Restart) for out in outs), "it is that already"
    write(device, 1000, 5)
    assert device.unit == 5 and read(device, 1000, 1) == [5]


def test_motors_take_the_time_or_the_speed_they_are_given():
    device = fp.create("brainco_revo2")
    write(device, 1010, *[1000] * 6, 100, 200, 400, 800, 1600, 2000)
    assert read(device, 2000, 6, t_ns=10**9)[:4] == [1000] * 4
    assert 600 < read(device, 2000, 6, t_ns=10**9)[4] < 650 and read(device, 2018, 6, t_ns=10**9) == [0, 0, 0, 0, 1, 1]
    write(device, 1055, 1, 0, 500, t_ns=3 * 10**9)
    assert 480 < read(device, 2000, 1, t_ns=4 * 10**9)[0] < 520


def test_a_serial_number_wants_a_key():
    device = fp.create("brainco_revo2")
    write(device, 920, *[0x4141] * 10)
    assert read(device, 3010, 1) == [0x4243]
    write(device, 910, *[0x7374] * 6)
    write(device, 920, *[0x4141] * 10)
    device.power_cycle()
    assert read(device, 3010, 10) == [0x4141] * 10


def test_three_axis_points_saturate_and_are_calibrated_finger_by_finger():
    device = fp.create("brainco_revo2", touch="force3d")
    sample(device, force=(100.0, -100.0, -1e5))
    assert ask(device, struct.pack(">BHH", 4, 7500, 2))[2:] == bytes([127, 128, 255, 255])
    ask(device, struct.pack(">BHHB4H", 16, 7006, 4, 8, 0, 0, 0, 1))
    sample(device, force=(100.0, -100.0, -1e5))
    assert ask(device, struct.pack(">BHH", 4, 7106, 2))[2:] == bytes(4)
    assert ask(device, struct.pack(">BHH", 4, 7100, 2))[2:] == bytes([127, 128, 255, 255])
    ask(device, struct.pack(">BHH", 6, 7001, 0))
    sample(device, force=(100.0, -100.0, -1e5))
    assert not device.counts[:31].any() and device.counts[31].tolist() == [127, -128, 65535]
