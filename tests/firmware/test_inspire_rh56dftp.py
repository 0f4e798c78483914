"""Inspire RH56DFTP: byte addresses, matrices, actuators, orders."""

import struct

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols import Rs485, Sent, Tcp
from firmware_protocols.check.readings import reading_of
from tests.firmware.feeding import sample, send

TABLE = {
    # from the drivers' map: first address of each matrix, rows, columns
    "little tip": (3000, 3, 3), "little top": (3018, 12, 8), "little pad": (3210, 10, 8),
    "ring tip": (3370, 3, 3), "ring top": (3388, 12, 8), "ring pad": (3580, 10, 8),
    "middle tip": (3740, 3, 3), "middle top": (3758, 12, 8), "middle pad": (3950, 10, 8),
    "index tip": (4110, 3, 3), "index top": (4128, 12, 8), "index pad": (4320, 10, 8),
    "thumb tip": (4480, 3, 3), "thumb top": (4498, 12, 8), "thumb middle": (4690, 3, 3), "thumb pad": (4708, 12, 8),
    "palm": (4900, 8, 14),
}  # fmt: skip


COLUMNS_FROM_THE_BOTTOM = [14 * row + column for column in range(14) for row in range(7, -1, -1)]
"""Of the palm's 8 x 14 points, row-major, the one that is sent first, second ... (vendor manual 2.6.20)."""


@pytest.fixture
def device():
    return fp.create("inspire_rh56dftp")


def ask(device, pdu: bytes, t_ns=0, unit=1) -> bytes:
    (reply,) = send(device, struct.pack(">HHHB", 77, 0, len(pdu) + 1, unit) + pdu, t_ns, "tcp")
    assert struct.unpack_from(">HHHB", reply) == (77, 0, len(reply) - 6, unit)
    return reply[7:]


def read(device, address, count, t_ns=0) -> list[int]:
    reply = ask(device, struct.pack(">BHH", 3, address, count), t_ns)
    assert reply[:2] == bytes([3, 2 * count])
    return list(struct.unpack(f">{count}h", reply[2:]))


def write(device, address, *values, t_ns=0) -> bytes:
    pdu = struct.pack(f">BHHB{len(values)}h", 16, address, len(values), 2 * len(values), *values)
    return ask(device, pdu, t_ns)


def test_matrices_lie_where_the_drivers_look(device):
    assert {p.name: (p.rows, p.cols) for p in device.layout.patches} == {n: t[1:] for n, t in TABLE.items()}
    sample(device, np.linspace(0.0, 4.0, 1062))
    for patch in device.layout.patches:
        counts = device.counts[patch.taxels]
        sent = counts[COLUMNS_FROM_THE_BOTTOM] if patch.name == "palm" else counts
        assert read(device, TABLE[patch.name][0], len(patch)) == sent.tolist()
    assert device.counts[-1] == 4000 and device.measure(reading_of(device, 9.0), 0).max() == 4096


def test_the_palm_is_sent_column_by_column_from_the_bottom(device):
    picture = np.zeros((8, 14))
    picture[7, 0], picture[6, 0], picture[7, 1], picture[0, 13] = 0.1, 0.2, 0.9, 1.12
    sample(device, {"palm": picture})
    palm = read(device, 4900, 112)
    assert (palm[0], palm[1], palm[8], palm[111]) == (100, 200, 900, 1120) and sum(palm) == 2320


def test_fingers_and_palm_have_links_and_pitches_of_their_own(device):
    assert device.layout.links == ("little", "ring", "middle", "index", "thumb", "palm")
    assert {(patch.link == "palm", patch.pitch) for patch in device.layout.patches} == {(False, 0.0015), (True, 0.004)}


def test_addresses_count_bytes(device):
    sample(device, np.linspace(0.0, 4.0, 1062))
    memory = device.counts.astype("<i2").tobytes()
    assert read(device, 3001, 4) == list(struct.unpack_from("<4h", memory, 1))
    assert read(device, 3018 + 125, 67) == list(struct.unpack_from("<67h", memory, 18 + 125))


def test_angles_follow_at_their_speed(device):
    assert read(device, 1546, 6) == [1000] * 6
    write(device, 1486, 0, -1, 500, -1, -1, 1000)
    assert read(device, 1546, 6, t_ns=300_000_000) == [500, 1000, 500, 1000, 1000, 1000]
    assert read(device, 1594, 3, t_ns=300_000_000) == [200, 0, 0]
    assert read(device, 1612, 3, t_ns=300_000_000) == [0x0201, 0x0202, 0x0202]
    write(device, 1522, 500, 500, 500, 500, 500, 500, t_ns=300_000_000)
    assert read(device, 1546, 1, t_ns=600_000_000) == [250]
    assert read(device, 1546, 1, t_ns=10**10) == [0] and read(device, 1534, 1, t_ns=10**10) == [2000]
    assert np.allclose(list(device.joints(10**10).values()), [1.6, 0, 0.8, 0, 0, 0])
    write(device, 1474, 0, t_ns=10**10)
    assert read(device, 1546, 1, t_ns=2 * 10**10) == [1000]


def test_byte_registers_come_in_either_order():
    device = fp.create("inspire_rh56dftp", first_byte="high")
    write(device, 1486, 0, -1, -1, -1, -1, -1)
    assert read(device, 1612, 3, t_ns=300_000_000) == [0x0102, 0x0202, 0x0202]


def test_forces_in_grams_and_their_zero(device):
    sample(device, np.where(np.arange(1062) == 370, 1.962, 0.0))
    assert read(device, 1582, 6) == [0, 0, 200, 0, 0, 0]
    ask(device, struct.pack(">BHH", 6, 1009, 1))
    assert read(device, 1582, 6) == [0] * 6 and read(device, 1009, 1) == [0]


def test_the_motors_temperature_is_sensed(device):
    sample(device, temperature=41.0)
    assert read(device, 1618, 3) == [0x2929] * 3


def test_unit_and_line_speed_change_when_saved_and_powered_again(device):
    request = bytes.fromhex("090303e800010532")
    write(device, 1000, 9)
    write(device, 1002, 2)
    assert read(device, 1000, 2) == [9, 2] and send(device, request, port="rtu") == []
    device.power_cycle()
    assert read(device, 1000, 2) == [1, 0] and device.ports[0].baud == 115200
    write(device, 1000, 9)
    write(device, 1002, 2)
    write(device, 1005, 1)
    device.power_cycle()
    (reply,) = send(device, request, port="rtu")
    assert reply[:5].hex() == "0903020009"
    assert device.ports[0].baud == 19200 and device.rtu.gap_ns == 2_005_208
    assert send(device, "010303e80001047a", port="rtu") == [] and device.counters["other_unit"] == 2
    write(device, 1006, 1)
    assert read(device, 1000, 2) == [1, 0]


@pytest.mark.parametrize(("code", "baud"), [(0, 115200), (1, 57600), (2, 19200), (3, 921600), (4, 921600)])
def test_codes_of_line_speeds(device, code, baud):
    write(device, 1002, code)
    write(device, 1005, 1)
    device.power_cycle()
    assert device.ports[0].baud == baud


def test_delivered_with_another_unit_and_speed():
    device = fp.create("inspire_rh56dftp", unit=9, baud="921600")
    assert device.ports == (Rs485(name="rtu", baud=921600), Tcp(name="tcp", port=6000, is_plugged=False))
    assert read(device, 1000, 2) == [9, 4 - 1]
    assert len(send(device, "090303e800010532", port="rtu")) == 1


@pytest.mark.parametrize("unit", [0, 1, 2, 255])
def test_any_unit_is_answered_over_tcp(device, unit):
    assert ask(device, bytes.fromhex("03060a0006"), unit=unit) == b"\x03\x0c" + b"\x03\xe8" * 6


def test_rtu_answers_take_their_time(device):
    request = bytes.fromhex("010303e80001047a")
    (answer,) = device.receive(request, 0, "rtu")
    assert answer == Sent(bytes.fromhex("01030200017984"), delay_ns=6_000_000)
    (answer,) = fp.create("inspire_rh56dftp", answer_s=0.014).receive(request, 0, "rtu")
    assert answer.delay_ns == 14_000_000


def test_registers_of_the_network_and_of_gestures(device):
    assert device.read(1700, 4, 0) == bytes([192, 168, 11, 210])
    write(device, 1702, 0x6F7B)
    write(device, 2320, 3, 1)
    write(device, 1005, 1)
    assert read(device, 2320, 2) == [3, 1]
    device.power_cycle()
    assert device.read(1700, 4, 0) == bytes([192, 168, 123, 111]) and read(device, 2320, 2) == [0, 0]


def test_force_limits_at_power_up_go_to_3000(device):
    write(device, 1044, *[3000] * 6)
    write(device, 1005, 1)
    device.power_cycle()
    assert read(device, 1498, 6) == [3000] * 6


@pytest.mark.parametrize(
    ("pdu", "code"),
    [
        ("04 03e8 0001", 1),
        ("2b 0e 01 00", 1),
        ("16 03e8 0000 0002", 1),
        ("17 03e8 0001 03e8 0001 02 0002", 1),
        ("03 176f 0001", 2),
        ("06 0bb8 0001", 2),
        ("06 0618 0000", 2),
        ("10 05fc 0002 04 0000 0000", 2),
        ("03 0bb8 0000", 3),
        ("06 05ce 07d1", 3),
        ("10 05ce 0002 02 0000", 3),
        ("06 03e8 0000", 3),
    ],
)
def test_exceptions_change_nothing(device, pdu, code):
    before = device.read(0, 6000, 0)
    function = int(pdu[:2], 16)
    assert ask(device, bytes.fromhex(pdu.replace(" ", ""))) == bytes([function | 0x80, code])
    assert device.read(0, 6000, 0) == before


def test_rtu_gap_ends_a_broken_frame(device):
    good = bytes.fromhex("01030000000ac5cd")
    assert send(device, good[:5], 0) == []
    assert len(send(device, good, 2_000_000)) == 1
    assert device.counters["broken_frames"] == 1
    assert send(device, good[:5], 10_000_000) == []
    assert len(send(device, good[5:], 11_000_000)) == 1, "a pause of less than 1.75 ms is none"
    assert send(device, good[:-1] + b"\x00", 20_000_000) == [] and device.counters["bad_checksum"] == 1


def test_rtu_unknown_function_is_refused_where_its_crc_fits(device):
    assert send(device, "0141010203049cca") == [bytes.fromhex("01c101b050")]


def test_tcp_impossible_header_is_forgotten(device):
    assert send(device, "004d000100060103", port="tcp") == []
    assert device.counters["broken_frames"] == 1
    assert read(device, 1000, 1) == [1]


def test_tcp_clients_do_not_mix_and_a_new_one_begins_anew(device):
    request = bytes.fromhex("0001000000060103060a0006")
    assert send(device, request[:7], port="tcp") == send(device, request[:9], port="tcp/2") == []
    assert len(send(device, request[7:], port="tcp")) == 1
    device.lines(False, False, 0, "tcp/2")
    assert len(send(device, request, port="tcp/2")) == 1


def test_native_and_tcp_show_one_state():
    device = fp.create("inspire_rh56dftp", line="native", first_byte="high")
    (reply,) = device.receive(bytes.fromhex("EB90010512CE05F401E0"), 0, "rtu")
    assert reply == Sent(bytes.fromhex("90EB010412CE0501EB"), delay_ns=6_000_000)
    assert read(device, 1546, 2, t_ns=300_000_000) == [500, 1000]
    assert read(device, 1612, 3, t_ns=100_000_000) == [0x0102, 0x0202, 0x0202]
    assert send(device, "EB900104114C06066E", 100_000_000, "rtu") == [bytes.fromhex("90EB0109114C0601020202020278")]
    saved = device.receive(bytes.fromhex("EB90010412ED030108"), 0, "rtu")
    assert [each.delay_ns for each in saved] == [6_000_000, 1_006_000_000]


def test_firmware_mistakes_over_tcp():
    device = fp.create("inspire_rh56dftp", id_error=1, reconnect_s=0.3)
    request = "ffff 0000 0006 01 03 03e8 0001".replace(" ", "")
    device.lines(True, True, 0, "tcp")
    assert send(device, request, 0, "tcp") == [bytes.fromhex("000000000005010302") + b"\x00\x01"]
    device.lines(False, False, 10**9, "tcp")
    device.lines(True, True, 10**9 + 299_000_000, "tcp")
    assert send(device, request, 10**9 + 400_000_000, "tcp") == [] and device.counters["unheard"] == 1
    device.lines(False, False, 2 * 10**9, "tcp")
    device.lines(True, True, 2 * 10**9 + 300_000_000, "tcp")
    assert len(send(device, request, 3 * 10**9, "tcp")) == 1


@pytest.mark.parametrize(("speed", "limit_g"), [(25, 100), (25, 500), (100, 500), (250, 1000)])
def test_a_finger_goes_on_for_a_while_after_its_force_has_passed_the_limit(speed, limit_g):
    """Against a spring of 2 g per angle the peak lies between what the stop alone takes and that with a conversion."""
    stop_s, period_s, spring = 0.027, 0.02, 2.0
    device = fp.create("inspire_rh56dftp", stop_s=stop_s)
    write(device, 1522, *[speed] * 6)
    write(device, 1498, *[limit_g] * 6)
    write(device, 1486, *[0] * 6)
    tip = next(patch for patch in device.layout.patches if patch.name == "middle tip").taxels
    push = np.zeros(1062)

    def grams(t_ns):
        closed = 1000 * device.joints(t_ns)["middle"] / 1.6
        return spring * closed

    for k in range(3000):
        t_ns = round(k * period_s * 1e9)
        push[tip] = grams(t_ns) * 9.80665e-3 / len(push[tip])
        sample(device, push, t_ns)
    rise = spring * speed / 0.6
    assert limit_g + rise * stop_s <= grams(t_ns) + 1e-6 <= limit_g + rise * (stop_s + period_s) + 1.0
    assert device.joints(t_ns)["index"] == pytest.approx(1.6)  # untouched: it closes


def test_a_finger_that_pushes_its_hardest_stands_and_without_a_wish_limits_do_nothing():
    push = np.zeros(1062)
    for options, expected in (({"stop_s": 0.5, "strongest_g": 600.0}, 0.0), ({}, 1.6)):
        device = fp.create("inspire_rh56dftp", **options)
        push[device.layout.patches[6].taxels] = 700 * 9.80665e-3 / 9
        write(device, 1486, *[0] * 6)
        for k in range(200):
            sample(device, push, k * 20_000_000)
        assert device.joints(4 * 10**9)["middle"] == pytest.approx(expected, abs=0.01)
