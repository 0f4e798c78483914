"""RG2-FT: zero, grip, stop, other units, several clients."""

import struct

import firmware_protocols as fp
from firmware_protocols import modbus
from tests.firmware.feeding import sample, send

WRENCHES = [[1.5, -20.3, 300.7, 0.15, -2.23, 3.37], [-0.1, 260.0, -39.9, -5.12, 1.0, -0.01]]


def write(device, register: int, value: int, t_ns: int = 0) -> int:
    """Return the function of the answer."""
    (answer,) = send(device, modbus.mbap(65, struct.pack(">BHH", 6, register, value)), t_ns)
    return answer[7]


def status(device, t_ns: int = 0) -> list[int]:
    (answer,) = send(device, modbus.mbap(65, struct.pack(">BHH", 3, 257, 26)), t_ns)
    return list(struct.unpack(">26h", answer[9:]))


def test_zero_holds_until_it_is_undone():
    device = fp.create("onrobot_rg2_ft")
    sample(device, wrench=WRENCHES)
    before = status(device)
    write(device, 0, 1)
    sample(device, wrench=WRENCHES)
    assert not any(status(device)[2:8] + status(device)[11:17])
    write(device, 0, 0)
    sample(device, wrench=WRENCHES)
    assert status(device) == before and before[2:5] == [15, -203, 3007]


def test_a_busy_gripper_ignores_a_grip_and_obeys_a_stop():
    device = fp.create("onrobot_rg2_ft")
    sample(device)
    for register, value in ((2, 200), (3, 500), (4, 1), (3, 900), (4, 1)):
        write(device, register, value)
    assert status(device, 300_000_000)[23:] == [700, 1, 0]
    write(device, 4, 8, 300_000_000)
    assert status(device, 900_000_000)[23:] == [700, 0, 0]
    write(device, 4, 1, 900_000_000)
    assert status(device, 2_000_000_000)[23:] == [900, 0, 0]


def test_the_fingers_stop_where_the_push_is_the_force():
    device = fp.create("onrobot_rg2_ft")
    for register, value in ((2, 100), (3, 0), (4, 1)):
        write(device, register, value)
    sample(device, 9.0, 100_000_000)
    assert status(device, 200_000_000)[23:] == [800, 1, 0]
    sample(device, 11.0, 200_000_000)
    assert status(device, 900_000_000)[23:] == [800, 0, 1]


def test_what_it_refuses():
    device = fp.create("onrobot_rg2_ft")
    assert [write(device, *each) for each in ((2, 401), (3, 1001), (257, 0))] == [0x86] * 3
    assert send(device, modbus.mbap(1, struct.pack(">BHH", 3, 257, 1))) == [] and device.counters["other_unit"] == 1


def test_half_a_request_is_of_its_client():
    device = fp.create("onrobot_rg2_ft")
    sample(device)
    request = modbus.mbap(65, struct.pack(">BHH", 3, 0, 1))
    assert send(device, request[:5], port="") == [] and len(send(device, request, port="/2")) == 1
    device.lines(False, False, 0, "")
    assert len(send(device, request, port="")) == 1
