"""OmniHand: what each part answers, which number it has, what is no request."""

import numpy as np
import pytest

import firmware_protocols as fp
from tactemu.wire.line_models.can import CanLine
from tests.firmware.feeding import sample, send

PRO, O10 = "agibot_omnihand_pro", "agibot_omnihand_o10"
ZEROS = "00" * 64


def hand(name: str, **options) -> fp.Device:
    device = fp.create(name, **options)
    sample(device)
    return device


def test_a_force_on_one_finger_is_its_normal_tangential_and_angle():
    device = fp.create(PRO)
    for x, y, angle in ((0.0, 1.0, 0), (1.0, 0.0, 90), (0.0, -1.0, 180), (-1.0, 0.0, 270)):
        force = np.zeros((45, 3))
        force[9:18] = (x / 9, y / 9, -3 / 9)
        sample(device, force=force)
        assert device.counts[9:18, 1:].tolist() == [[30, 10, angle]] * 9, "clockwise from the tip, seen from outside"
        assert not device.counts[18:].any() and not device.counts[:9].any()


def test_forces_saturate_at_3000_and_channels_at_16_bits():
    device = fp.create(PRO)
    sample(device, 1e6)
    assert device.counts[0].tolist() == [65535, 3000, 0, 0]
    sample(device, -1e6)
    assert not device.counts.any()
    device = fp.create(O10)
    sample(device, 1e6)
    assert set(device.counts.tolist()) == {255}


@pytest.mark.parametrize(("name", "parts"), [(PRO, 5), (O10, 7)])
def test_parts_that_it_does_not_have_get_silence(name, parts):
    device = hand(name)
    answered = [part for part in range(32) if send(device, f"{part << 24 | 0x050101:08X}##1{ZEROS}")]
    assert answered == list(range(1, parts + 1))
    assert device.counters["refused"] == 32 - parts and device.counters["requests"] == 32


def test_the_write_bit_is_clear_in_the_answer_and_the_number_is_its_own():
    device = hand(O10, device=5)
    assert [f.arbitration_id for f in send(device, f"01050185##1{ZEROS}")] == [0x01050105]
    assert send(device, f"01050101##1{ZEROS}") == [] and device.counters["other_address"] == 1
    ident, mask = device.ports[0].filters[0]
    assert 0x07130185 & mask == ident and 0x07130284 & mask != ident


def test_the_carriers_filter_is_one_for_29_bits():
    (taken,) = CanLine(hand(O10).ports[0]).filters(hand(O10).ports)
    assert taken.passes(0x00130101, True) and not taken.passes(0x101, False)


def test_a_new_number_is_kept():
    device = hand(PRO)
    assert [str(f) for f in send(device, f"01020181##103{'00' * 63}")] == ["01020101##10302010300"]
    assert not send(device, f"00010101##1{ZEROS}") and send(device, f"00010103##1{ZEROS}")
    device.power_cycle()
    sample(device)
    assert send(device, f"00010103##1{ZEROS}")


def test_a_finger_of_an_o10_begins_at_its_base_and_a_left_hand_is_mirrored():
    for side, first in (("left", (7, 1)), ("right", (7, 0))):
        device = fp.create(O10, side=side)
        force = np.zeros(len(device.layout))
        force[first[0] * 2 + first[1]] = 10 * 9.80665e-3
        sample(device, force)
        (answer,) = send(device, f"01050101##1{ZEROS}")
        assert answer.data[0] == 10 and not any(answer.data[1:]), "ten grams at the first place"


@pytest.mark.parametrize(("name", "joints"), [(PRO, 12), (O10, 10)])
def test_joints_are_asked_and_told_one_by_one_or_all_at_once(name, joints):
    device = hand(name)
    for message, size in ((0x03, 2), (0x10, 1), (0x11, 2), (0x12, 2), (0x13, 2), (0x20, 2), (0x21, 2), (0x22, 2)):
        (answer,) = send(device, f"00{message:02X}0101##1{ZEROS}")
        padded = {10: 12, 12: 12, 20: 20, 24: 24}[joints * size]
        assert len(answer.data) == padded
        assert len(send(device, f"{joints:02X}{message:02X}0101##1{ZEROS}")[0].data) == size
        assert send(device, f"{joints + 1:02X}{message:02X}0101##1{ZEROS}") == []
    send(device, f"02100181##103{'00' * 63}")
    assert send(device, f"00100101##1{ZEROS}")[0].data[:3] == b"\0\3\0"
    send(device, f"02130181##1E803{'00' * 62}")
    assert send(device, f"02130101##1{ZEROS}", 2 * 10**9)[0].data == (1000).to_bytes(2, "little")


def test_a_mixed_order_begins_with_the_position():
    for name, mode in ((PRO, 5), (O10, 6)):
        device = hand(name)
        entry = bytes([3 | mode << 5]) + b"".join(n.to_bytes(2, "little") for n in (700, 1, 2))
        other = bytes([4 | mode << 5]) + b"".join(n.to_bytes(2, "little") for n in (800, 1, 2))
        send(device, f"00140181##1{(entry + other).ljust(64, bytes(1)).hex()}")
        assert np.rint(device.motors.positions(3 * 10**9)).tolist()[:5] == [2000, 2000, 700, 800, 2000]


def test_reports_come_unasked_in_the_shortest_period():
    device = hand(PRO)
    assert device.wake_ns is None
    send(device, f"03210181##11E00{'00' * 62}")
    send(device, f"04220181##10A00{'00' * 62}")
    due = []
    while (at := device.wake_ns) <= 60_000_000:
        due += [(at // 1_000_000, str(f)[:8], len(f.data)) for f in device.wake(at)]
    assert [each for each in due if each[1] == "00210101"] == [(30, "00210101", 24), (60, "00210101", 24)]
    assert len([each for each in due if each[1] == "00220101"]) == 6
    send(device, f"00210181##1{ZEROS}")
    send(device, f"00220181##1{ZEROS}")
    assert device.wake_ns is None


@pytest.mark.parametrize("request_", ["105##100", "01050101#00", "01050201##100", "01050101#R"])
def test_what_is_no_request_is_ignored(request_):
    device = hand(PRO)
    assert send(device, request_) == [] and device.counters["ignored"] == 1
