"""GHand 5: what registers show of a push, limits, what is refused."""

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols.protocols.modbus import rtu
from tests.firmware.feeding import sample, send


def registers(device, request: str) -> bytes:
    (answer,) = send(device, request)
    assert answer[2] == len(answer) - 5
    return answer[3:-2]


def test_axes_of_taxels_and_resultants():
    device = fp.create("ghand5")
    force = np.zeros((162, 3))
    force[38] = (0.5, -0.3, -2.0)
    force[39] = (20.0, -20.0, -40.0)
    sample(device, force=force)
    index = np.frombuffer(registers(device, "31 04 10 C9 00 2F 60 D8"), np.uint8)
    assert index[:6].tolist() == [5, 253, 20, 127, 128, 255] and not index[6:].any() and len(index) == 94
    whole = registers(device, "31 04 10 80 00 10 F1 1E")
    assert whole.hex() == "1f00" + "0000" * 3 + "7f00" + "8000" + "ff00" + "0000" * 9
    assert device.measure(fp.Reading({"force": force}), 0)[38].tolist() == [5, -3, 20]


def test_a_pull_shows_no_push():
    device = fp.create("ghand5")
    sample(device, -5.0)
    assert not any(registers(device, "31 04 10 90 00 39 31 05"))


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        (bytes.fromhex("31 01 00 00 00 01"), "31 81 01"),
        (bytes.fromhex("31 04 11 85 00 01"), "31 84 02"),
        (bytes.fromhex("31 06 20 07 00 01"), "31 86 02"),
        (bytes.fromhex("31 06 00 00 00 F8"), "31 86 03"),
    ],
    ids=["function 1", "behind the last register", "a version", "unit 248"],
)
def test_what_is_refused(request_, answer):
    device = fp.create("ghand5")
    sample(device)
    assert send(device, rtu(request_[0], request_[1:]))[0][:-2] == bytes.fromhex(answer)


def ask(device, pdu: str, unit=0x31, t_ns=0) -> bytes:
    (answer,) = send(device, rtu(unit, bytes.fromhex(pdu)), t_ns)
    return answer[2:-2]


def test_a_right_hand_is_another_unit():
    device = fp.create("ghand5", side="right")
    sample(device)
    assert send(device, "31 04 10 80 00 10 F1 1E") == [] and device.counters["other_unit"] == 1
    assert ask(device, "03 0000 0001", 0x32) == bytes.fromhex("02 0032")
    assert ask(device, "04 1020 0001", 0x32) == bytes.fromhex("02 0002")


def test_a_new_unit_is_in_force_at_once_and_stays():
    device = fp.create("ghand5")
    ask(device, "06 0000 0040")
    assert ask(device, "03 0000 0001", 0x40) == bytes.fromhex("02 0040")
    device.power_cycle()
    assert ask(device, "03 0000 0001", 0x40) == bytes.fromhex("02 0040")


def test_faults_are_cleared_when_the_low_byte_says_so():
    device = fp.create("ghand5")
    assert ask(device, "03 0001 0001") == bytes.fromhex("02 0000")
    ask(device, "06 0001 0100")
    assert ask(device, "03 0001 0001") == bytes.fromhex("02 0001")


def test_touch_is_switched_and_zeroed():
    device = fp.create("ghand5")
    force = np.zeros((162, 3))
    force[0] = (0.0, 0.0, -1.5)
    sample(device, force=force)
    assert ask(device, "04 1080 0001") == bytes.fromhex("02 1F00") and device.inputs.all("taxels")[2] == 15
    ask(device, "06 002B 0400")
    sample(device, force=2 * force)
    assert device.inputs.all("taxels")[2] == 15
    ask(device, "06 002B 0200")
    sample(device, force=2 * force)
    assert ask(device, "04 1080 0001") == bytes.fromhex("02 0000") and not any(device.inputs.all("taxels"))
    ask(device, "06 002B 0100")
    sample(device, force=2 * force)
    assert ask(device, "04 1080 0001") == bytes.fromhex("02 1F00") and device.inputs.all("taxels")[2] == 15


def test_joints_go_and_stop_and_what_has_no_order_stays():
    device = fp.create("ghand5")
    ask(device, "10 0019 0004 08 0190 3264 0384 6464")  # index PIP to 40 deg at 50 %, MCP to 90 deg at 100 %
    moving = ask(device, "04 1035 0006", t_ns=100_000_000)
    assert moving.hex() == "0c0100005a3200010000b46400"
    assert ask(device, "04 1021 0001", t_ns=100_000_000) == bytes.fromhex("02 0100")
    ask(device, "06 0010 0001", t_ns=100_000_000)
    stopped = ask(device, "04 1035 0006", t_ns=10**9)
    assert stopped.hex() == "0c0000005a0000000000b40000"
    ask(device, "06 0010 0200", t_ns=10**9)
    ask(device, "10 0019 0002 04 0000 6464", t_ns=10**9)
    assert ask(device, "04 1035 0003", t_ns=2 * 10**9) == stopped[:1].replace(b"\x0c", b"\x06") + stopped[1:7]
    assert device.joints(2 * 10**9)["thumb aa"] == np.deg2rad(20)
