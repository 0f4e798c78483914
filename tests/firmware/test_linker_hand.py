"""LinkerHand: identity, matrices of one sample, joints, the older touch sensor, what is not for this hand."""

import numpy as np
import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

L6, L10, O6 = "linker_hand_l6", "linker_hand_l10", "linker_hand_o6"
HANDS = pytest.mark.parametrize(
    ("name", "rows", "columns", "selector"), [(L6, 12, 6, "C6"), (L10, 12, 6, "C6"), (O6, 10, 4, "A4")]
)


def hand(name: str, **options) -> fp.Device:
    device = fp.create(name, **options)
    sample(device)
    return device


def ask(device: fp.Device, request: str) -> list[str]:
    return [str(answer) for answer in send(device, request)]


@HANDS
def test_each_finger_sends_its_own_matrix(name, rows, columns, selector):
    device = fp.create(name)
    sample(device, np.arange(len(device.layout)) / 1000)
    for finger in range(5):
        answers = [bytes.fromhex(a.partition("#")[2]) for a in ask(device, f"028#B{finger + 1}{selector}")]
        assert [a[1] for a in answers] == [row << 4 for row in range(rows)]
        sent = np.array([list(a[2:]) for a in answers])
        assert np.array_equal(sent, device.counts.reshape(5, rows, columns)[finger])


@HANDS
def test_a_picture_on_one_finger_is_its_matrix(name, rows, columns, selector):
    device, picture = fp.create(name), np.zeros((rows, columns))
    picture[2, 1] = 0.2
    sample(device, {"ring": picture})
    touched = {
        finger: "64" in "".join(a[8:] for a in ask(device, f"028#B{finger}{selector}")) for finger in range(1, 6)
    }
    assert touched == {1: False, 2: False, 3: False, 4: True, 5: False}
    assert ask(device, f"028#B4{selector}")[2] == "028#B420" + "00" + "64" + "00" * (columns - 2)
    assert device.layout.patches[3].link == "ring"


@HANDS
def test_every_finger_says_its_size_without_a_selector(name, rows, columns, selector):
    for finger in range(1, 6):
        assert ask(hand(name), f"028#B{finger}") == [f"028#B{finger}{rows:02X}{columns:02X}"]


def test_counts_saturate_and_never_pull():
    device = fp.create(L6)
    for newtons, counts in ((100.0, 255), (-100.0, 0), (0.2, 100)):
        sample(device, newtons)
        assert set(device.counts.tolist()) == {counts}


def test_sides_do_not_hear_each_other():
    left, right = hand(L6), hand(L6, side="right")
    assert ask(left, "027#C2") == [] and left.counters["ignored"] == 1
    assert ask(right, "027#C2") == ["027#C2010203"]
    assert left.ports[0].hears == ((0x28, 0x7FF),) and right.ports[0].hears == ((0x27, 0x7FF),)


@pytest.mark.parametrize(
    "request_",
    [
        "028#B1A4",
        "028#B6C6",
        "028#",
        "028#C102",
        "028#20",
        "028#B1C600",
        "028#FF",
        "028#04",
        "028#330102030405",
        "028#R",
    ],
)
def test_what_is_no_request_gets_silence(request_):
    device = hand(L6)
    assert ask(device, request_) == []
    assert device.counters["unknown_command"] + device.counters["ignored"] == 1


def test_bare_c1_is_a_ping():
    assert ask(hand(L6), "028#C1") == ask(hand(L10), "028#C1") == ask(hand(O6), "028#C1") == ["028#C1010004"]
    assert ask(hand(L6), "028#C101") == ["028#C101010004"] and ask(hand(O6), "028#C101") == []


def test_older_touch_sensor_answers_four_quantities():
    device = fp.create(L6, touch="quantities")
    force = np.zeros((360, 3))
    force[72:144] = (0.0, 0.002, -0.004)
    sample(device, force=force)
    assert ask(device, "028#20") == ["028#200090000000"]  # 72 * 0.004 N * 500 counts/N = 144
    assert ask(device, "028#21") == ["028#210048000000"]
    assert ask(device, "028#22") == ["028#220040000000"]  # along y: a quarter turn
    assert ask(device, "028#B1") == [] == ask(device, "028#B1C6")


def test_joints_remember():
    device = hand(L6)
    assert ask(device, "028#01010203040506") == []
    assert ask(device, "028#01") == ["028#01010203040506"]
    device.power_cycle()
    assert ask(device, "028#01") == ["028#01808080808080"]


def test_ten_joints_come_in_two_parts():
    device = hand(L10)
    for request in ("028#01010203040506", "028#0407080910", "028#021112131415", "028#031617181920", "028#052122232425"):
        assert ask(device, request) == [] and ask(device, request[:6]) == [request]
    assert ask(device, "028#35") == ["028#350000000000"] and ask(device, "028#36") == ["028#360000000000"]
    assert ask(device, "028#34") == ["028#341E1E1E1E1E"] and ask(device, "028#06") == ["028#06FFFFFFFFFF"]
    device.counters.clear()
    assert ask(device, "028#020102030405FF") == [] and device.counters["unknown_command"] == 1, "five torques, not six"


def test_a_serial_number_of_ones_own():
    answers = ask(hand(L10, serial_number="LHL10-07-123-L-F-2-B"), "028#C0")
    assert [a[6:8] for a in answers] == ["00", "06", "0C", "12"]
    assert b"".join(bytes.fromhex(a[8:]) for a in answers) == b"LHL10-07-123-L-F-2-B" + bytes(4)


def test_joints_by_finger_are_set_and_their_faults_cleared():
    device = hand("linker_hand_l25")
    assert ask(device, "028#41") == ["028#41808080000080"] and ask(device, "028#64") == ["028#641E001E00001E"]
    assert ask(device, "028#52102030405060") == [] and ask(device, "028#52") == ["028#52102030405060"]
    assert ask(device, "028#5D010101010101") == [] and ask(device, "028#5D") == ["028#5D000000000000"]
    device.counters.clear()
    assert ask(device, "028#5D010101010102") == [] == ask(device, "028#61010101010101")
    assert device.counters["unknown_command"] == 2


def test_a_palm_answers_without_a_selector():
    device = fp.create("linker_hand_g20")
    sample(device, {"palm": np.arange(72).reshape(12, 6) / 500})
    rows = [f"028#B6{row << 4:02X}" + bytes(range(6 * row, 6 * row + 6)).hex().upper() for row in range(12)]
    assert ask(device, "028#B6") == rows and ask(device, "028#B6C6") == []
    assert device.layout.patches[5].link == "palm"
    assert ask(hand("linker_hand_g20", palm=False), "028#B6") == [] == ask(hand("linker_hand_l25"), "028#B6")
    assert len(ask(hand(L6, palm=True), "028#B6")) == 12 and len(ask(hand(O6, palm=True), "028#B6")) == 10


def test_another_matrix_has_its_selector_and_its_letter():
    device = hand("linker_hand_l20", touch="10x4")
    assert len(ask(device, "028#B1A4")) == 10 and ask(device, "028#B1C6") == []
    assert bytes.fromhex(ask(device, "028#C0")[2][8:]) == b"-L-F-1"


def test_quantities_of_the_newer_hands_have_other_commands():
    device = hand("linker_hand_l20", touch="quantities")
    assert ask(device, "028#90") == ["028#900000000000"] and ask(device, "028#20") == []


@pytest.mark.parametrize(
    "options", [{"side": "up"}, {"touch": "capacitive"}, {"serial_number": "X" * 25}, {"serial_number": "Ł"}]
)
def test_bad_options_are_refused(options):
    with pytest.raises(ValueError, match=next(iter(options))):
        fp.create(L6, **options)
