"""LinkerHand: identity, matrices of one sample, joints, the older touch sensor, what is not for this hand."""

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols.options import declared
from tests.firmware.feeding import sample, send

L6, L10, O6 = "linker_hand_l6", "linker_hand_l10", "linker_hand_o6"
HANDS = pytest.mark.parametrize(
    ("name", "rows", "columns", "selector"), [(L6, 12, 6, "C6"), (L10, 12, 6, "C6"), (O6, 10, 4, "A4")]
)
TABLE_HANDS = pytest.mark.parametrize(
    ("name", "options"), [("linker_hand_g20", {}), ("linker_hand_l25", {}), ("linker_hand_l20", {"hardware": "V10"})]
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
def test_every_finger_says_its_sum_without_a_selector(name, rows, columns, selector):
    device = fp.create(name)
    sample(device, {"thumb": np.full((rows, columns), 0.2), "little": np.full((rows, columns), 0.002)})
    assert ask(device, "028#B1") == ["028#B1" + (100 * rows * columns).to_bytes(2, "little").hex().upper()]
    assert ask(device, "028#B2") == ["028#B20000"] and ask(device, "028#B5") == [f"028#B5{rows * columns:02X}00"]


def test_counts_saturate_and_never_pull():
    device = fp.create(L6)
    for newtons, counts in ((100.0, 255), (-100.0, 0), (0.2, 100)):
        sample(device, newtons)
        assert set(device.counts.tolist()) == {counts}


def test_sides_do_not_hear_each_other():
    left, right = hand(L6), hand(L6, side="right")
    assert ask(left, "027#C2") == [] and left.counters["ignored"] == 1
    assert ask(right, "027#C2") == ["027#C2010203"]
    assert left.ports[0].filters == ((0x28, 0x7FF),) and right.ports[0].filters == ((0x27, 0x7FF),)


@pytest.mark.parametrize(
    "request_",
    [
        "028#B1A4",
        "028#B6C6",
        "028#",
        "028#C102",
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


def test_a_hand_with_a_matrix_answers_nothing_to_the_older_probe():
    device = hand(L6)
    assert ask(device, "028#20") == [] and device.counters["unknown_command"] == 0


def test_a_set_is_answered_and_remembered():
    device = hand(L6)
    assert ask(device, "028#01010203040506") == ["028#01010203040506"] == ask(device, "028#01")
    device.power_cycle()
    assert ask(device, "028#01") == ["028#01808080808080"]


def test_ten_joints_come_in_two_parts():
    device = hand(L10)
    for request in ("028#01010203040506", "028#0407080910", "028#021112131415", "028#031617181920", "028#052122232425"):
        assert ask(device, request) == [request] == ask(device, request[:6])
    assert ask(device, "028#35") == ["028#350000000000"] and ask(device, "028#36") == ["028#360000000000"]
    assert ask(device, "028#34") == ["028#341E1E1E1E1E"] and ask(device, "028#06") == ["028#06FFFFFFFFFF"]
    assert ask(device, "028#09") == ["028#01010203040506", "028#0407080910", "028#021112131415", "028#031617181920"]
    device.counters.clear()
    assert ask(device, "028#020102030405FF") == [] and device.counters["unknown_command"] == 1, "five torques, not six"


def test_twenty_joints_are_five_bytes_each_and_silent_from_11_on():
    device = hand("linker_hand_l20")
    assert ask(device, "028#0201020304FF") == ["028#0201020304FF"]
    assert ask(device, "028#120504030201") == [] and ask(device, "028#02") == ["028#020504030201"]
    assert ask(device, "028#01") == ["028#018080808080"] and ask(device, "028#0D") == ["028#0D1E1E1E1E1E"]
    assert ask(device, "028#0500") == ["028#05FFFFFFFFFF"] and ask(device, "028#C300") == ["028#C328"]
    assert ask(device, "028#0A") == [] and device.counters["unknown_command"] == 1


@TABLE_HANDS
def test_three_ways_lead_to_a_joint(name, options):
    device = hand(name, shown="set", **options)
    assert ask(device, "028#06A1A2A3A4A5") == ["028#06A1A2A3A4A5"]
    assert [ask(device, f"028#4{finger}")[0][-2:] for finger in range(1, 6)] == ["A1", "A2", "A3", "A4", "A5"]
    assert ask(device, "028#41010203040506") == ["028#41010203040506"]
    first = [ask(device, f"028#{code:02X}")[0][6:8] for code in range(1, 7)]
    assert first == ["02", "01", "03", "04", "05", "06"], "roll before yaw, but in a finger yaw before roll"
    assert ask(device, "028#8110203040FF") == ["028#8110203040FF"]
    assert ask(device, "028#49") == ["028#49101010FFFF10"], "the two that are no joints keep theirs"
    assert ask(device, "028#0A") == ["028#0A10203040FF"]
    assert ask(device, "028#0107") == ["028#010780808080"], "the thumb alone has a roll joint"
    assert ask(device, "028#84") == ["028#841E1E1E1E1E"] and ask(device, "028#24") == ["028#240000000000"]
    for wrong in ("028#02010203", "028#21010101010101", "028#84010101010101", "028#C3FF"):
        assert ask(device, wrong) == [], wrong


@TABLE_HANDS
def test_speeds_and_torques_answer_what_is_unless_asked_otherwise(name, options):
    device = hand(name, **options)
    assert ask(device, "028#8110203040FF") == ["028#810000000000"] == ask(device, "028#81")
    assert ask(device, "028#51") == ["028#51000000000000"]


@TABLE_HANDS
def test_an_id_is_set_for_the_next_power_up_and_asked_of_all(name, options):
    device = hand(name, **options)
    assert ask(device, "028#C302") == ["028#C328"] and ask(device, "0FF#C3") == ["028#C328"]
    device.power_cycle()
    assert ask(device, "028#C3") == [] and ask(device, "0FF#C3") == ["002#C302"] == ask(device, "002#C3")
    assert device.ports[0].filters == ((2, 0x7FF), (0xFF, 0x7FF))


def test_an_l25_takes_five_speeds_of_a_finger():
    device = hand("linker_hand_l25", shown="set", version_numbers=4)
    assert ask(device, "028#4A1415161718") == ["028#4A14151617" + "18FF"]
    assert ask(device, "028#850100000000") == ["028#850100000000"] == ask(device, "028#85")
    assert ask(device, "028#C2") == ["028#C201020300"]
    assert ask(hand("linker_hand_g20"), "028#4A1415161718") == []


def test_faults_are_cleared_by_one_and_by_nothing_else():
    device = hand("linker_hand_g20")
    device.state["faults"][:] = bytes(range(30))
    assert ask(device, "028#19") == ["028#1901070D1319"], "roll is the second of a finger"
    assert ask(device, "028#83") == ["028#83070F1F171F"]
    assert ask(device, "028#5D000000000001") == ["028#5D18191A1B1C00"]
    assert ask(device, "028#5D000000000002") == [] and device.counters["unknown_command"] == 1
    assert ask(device, "028#830001010101") == ["028#830700000000"] and device.state["faults"][9] == 9, "no joint"


def test_an_l6_clears_faults_by_83_and_an_o6_has_accelerations():
    device = hand(L6)
    device.state["faults"][2] = 4
    assert ask(device, "028#35") == ["028#35000004000000"]
    assert ask(device, "028#83010101010101") == ["028#83000000000000"] and ask(device, "028#35010101010101") == []
    assert ask(hand(O6), "028#87010203040506") == ["028#87010203040506"] and ask(hand(O6), "028#83") == []


def test_a_serial_number_of_ones_own():
    answers = ask(hand(L10, serial_number="LHL10-07-123-L-F-2-B"), "028#C0")
    assert [a[6:8] for a in answers] == ["00", "06", "0C", "12"]
    assert b"".join(bytes.fromhex(a[8:]) for a in answers) == b"LHL10-07-123-L-F-2-B" + bytes(4)


WITH_PALM = [
    ("linker_hand_g20", {"palm": True}, 7, (12, 6), (14, 16), (12,), (14,)),
    ("linker_hand_l20", {"palm": True, "hardware": "V10"}, 7, (12, 6), (14, 16), (12,), (14,)),
    ("linker_hand_l25", {"touch": "23x9"}, 5, (23, 9), (28, 20), (11, 6, 6), (14, 14)),
    (L6, {"palm": True}, 2, None, (14, 15), (), ()),
    (O6, {"palm": True}, 4, None, (10, 10), (), ()),
]


@pytest.mark.parametrize(("name", "options", "sensor", "finger", "palm", "parts", "palm_parts"), WITH_PALM)
def test_a_matrix_with_places_and_sums(name, options, sensor, finger, palm, parts, palm_parts):
    device = fp.create(name, **options)
    sample(device, np.arange(len(device.layout)) % 241 / 500)
    assert ask(device, "028#B0") == [f"028#B0{sensor:02X}"]
    for code, size, rows in ((0xB1, finger, parts), (0xB5, finger, parts), (0xB6, palm, palm_parts)):
        if size is None:
            continue
        patch = device.layout.patches[code - 0xB1]
        felt, request = device.counts[patch.taxels].reshape(size), f"028#{code:02X}{size[0]:02X}{size[1]:02X}"
        frames = [bytes.fromhex(frame[4:]) for frame in ask(device, request)]
        assert [divmod(5 * k, size[1]) for k in range(len(frames))] == [tuple(frame[1:3]) for frame in frames]
        assert b"".join(frame[3:] for frame in frames) == felt.astype("u1").tobytes()
        with_sums = [bytes.fromhex(frame[4:]) for frame in ask(device, request + "01")]
        if not rows:
            assert with_sums == []
            continue
        assert with_sums[:-1] == frames and with_sums[-1][:2] == bytes([code, 0xFF])
        wanted = [min(int(part.sum()), 0xFFFF) for part in np.split(felt, np.cumsum(rows)[:-1])]
        assert np.frombuffer(with_sums[-1][2:], "<u2").tolist() == wanted
    rows, columns = palm
    felt = device.counts[device.layout.patches[5].taxels].reshape(palm)
    turned = ask(device, f"028#B6{columns:02X}{rows:02X}" + "01" * bool(palm_parts))
    turned_felt = felt if rows == columns else felt.T
    assert (
        b"".join(bytes.fromhex(frame[10:]) for frame in turned if frame[6:8] != "FF")
        == turned_felt.astype("u1").tobytes()
    )
    assert not palm_parts or turned[-1] == ask(device, f"028#B6{rows:02X}{columns:02X}01")[-1]
    assert device.layout.patches[5].link == "palm"


def test_no_palm_no_answer():
    assert ask(hand("linker_hand_g20"), "028#B6") == [] == ask(hand("linker_hand_l25"), "028#B60E1001")
    assert ask(hand("linker_hand_g20", palm=True), "028#B1C6") == [], "that sensor wants two bytes"


def test_another_matrix_has_its_selector_and_its_letter():
    device = hand("linker_hand_l20", touch="10x4")
    assert len(ask(device, "028#B1A4")) == 10 and ask(device, "028#B1C6") == []
    assert bytes.fromhex(ask(device, "028#C0")[2][8:]) == b"-L-F-1"


def test_quantities_of_the_newer_hands_have_other_commands():
    device = hand("linker_hand_g20", touch="quantities")
    assert ask(device, "028#90") == ["028#900000000000"] and ask(device, "028#20") == []


@pytest.mark.parametrize(
    "options",
    [{"side": "up"}, {"touch": "capacitive"}, {"touch": "23x9"}, {"serial_number": "X" * 25}, {"serial_number": "Ł"}],
)
def test_bad_options_are_refused(options):
    with pytest.raises(ValueError, match=next(iter(options))):
        fp.create(L6, **options)


def test_a_hand_has_the_options_of_its_base_class_before_its_own():
    names = ["side", "touch", "palm", "serial_number", "shown", "version_numbers"]
    assert list(declared(fp.device_class("linker_hand_l25"))) == names
    with pytest.raises(ValueError, match="shown"):
        fp.create("linker_hand_l6", shown="set")
