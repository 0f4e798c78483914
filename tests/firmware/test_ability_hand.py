"""Ability Hand: stuffing, packing, reply variants, the force formula, motors, registers."""

import struct

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols.check.readings import reading_of
from tests.firmware.feeding import frames, sample, send


def unstuff(frame: bytes) -> bytes:
    assert frame[0] == frame[-1] == 0x7E and 0x7E not in frame[1:-1]
    out, escaped = bytearray(), False
    for byte in frame[1:-1]:
        if byte == 0x7D:
            escaped = True
            continue
        out.append(byte ^ 0x20 if escaped else byte)
        escaped = False
    assert not escaped and sum(out) & 0xFF == 0
    return bytes(out[:-1])


def stuff(content: bytes) -> bytes:
    content += bytes([-sum(content) & 0xFF])
    return b"\x7e" + content.replace(b"\x7d", b"\x7d\x5d").replace(b"\x7e", b"\x7d\x5e") + b"\x7e"


def ask(device, header, payload=b"", t_ns=0):
    (reply,) = send(device, stuff(bytes([0x50, header]) + payload), t_ns)
    return unstuff(reply)


def touch(reply: bytes) -> list[int]:
    """The ICD's C code, 3.4.6."""
    values = []
    for i in range(25, 70, 3):
        b0, b1, b2 = reply[i : i + 3]
        values += [b0 | (b1 & 0x0F) << 8, b1 >> 4 | b2 << 4]
    return values


def documented_force(count: int) -> float:
    if count == 0:
        return 0.0
    return 121591 / (33000 / (count * 3.3 / 4096) + 10000) + 0.878894


def test_force_formula_is_inverted():
    device = fp.create("ability_hand")
    for force in (0.9, 1.0, 1.5, 2.0, 3.3, 5.0, 6.9):
        (count,) = set(device.measure(reading_of(device, force), 0).tolist())
        step = documented_force(count + 1) - documented_force(count)
        assert abs(documented_force(count) - force) < step
    assert set(device.measure(reading_of(device, 0.87), 0)) == {0}
    assert set(device.measure(reading_of(device, 50.0), 0)) == {4095}
    assert set(device.measure(reading_of(device, -3.0), 0)) == {0}


def test_touch_order_and_packing():
    device = fp.create("ability_hand")
    force = np.linspace(0.95, 6.5, 30)
    sample(device, force)
    reply = ask(device, 0xA0)
    assert touch(reply) == device.counts.tolist() and len(set(touch(reply))) == 30
    assert [p.name for p in device.layout.patches] == ["index", "middle", "ring", "pinky", "thumb"]
    assert len(reply) == 71 and reply[0] == 0xA0


@pytest.mark.parametrize(("variant", "size"), [(0, 71), (1, 71), (2, 38)])
@pytest.mark.parametrize("mode", [0x10, 0x20, 0x30, 0x40])
def test_variants(mode, variant, size):
    device = fp.create("ability_hand")
    reply = ask(device, mode + variant, bytes(12))
    assert len(reply) == size and reply[0] == mode + variant and reply[-1] == 0


def test_position_is_reached_without_overshoot():
    device = fp.create("ability_hand")
    target = struct.pack("<6h", *[round(60 * 32767 / 150)] * 5, round(-60 * 32767 / 150))
    angles = []
    for k in range(100):
        reply = ask(device, 0x12, target, t_ns=k * 10_000_000)
        values = struct.unpack("<19h", reply[:1] + b"\0" + reply[1:37])
        angles.append(values[1] * 150 / 32767)
    assert np.all(np.diff(angles) >= 0) and abs(angles[-1] - 60) < 0.02
    assert abs(values[11] * 150 / 32767 + 60) < 0.02
    early = np.array(angles[1:20])
    assert np.allclose(np.log((60 - early) / 45), -np.arange(1, 20) * 0.1, atol=2e-3), "one time constant of 0.1 s"


def test_velocity_moves_to_the_stop():
    device = fp.create("ability_hand")
    command = struct.pack("<6h", *[round(100 * 32767 / 3000)] * 6)
    speeds, angles = [], []
    for k in range(150):
        reply = ask(device, 0x21, command, t_ns=k * 10_000_000)
        angle, speed = struct.unpack_from("<hh", reply, 1)
        angles.append(angle * 150 / 32767)
        speeds.append(np.rad2deg(speed / 4 / 649))
    assert abs(speeds[50] - 100) < 1 and speeds[-1] == 0
    assert abs((angles[51] - angles[50]) - 1.0) < 0.02 and abs(angles[-1] - 100) < 0.01


@pytest.mark.parametrize(("header", "at"), [(0x21, 3), (0x22, 25)])
def test_a_velocity_in_a_reply_is_the_rotors(header, at):
    # 20 deg/s behind gears of 649 and 162.45, 4 counts per rad/s (ICD 3.4.3).
    device = fp.create("ability_hand")
    command = struct.pack("<6h", *[218] * 5, -218)
    for t_ns in range(0, 2_000_000_000, 100_000_000):
        reply = ask(device, header, command, t_ns=t_ns)
    step = 4 if header == 0x21 else 2
    velocities = [struct.unpack_from("<h", reply, at + step * joint)[0] for joint in range(6)]
    assert np.allclose(velocities, [906] * 5 + [-227], atol=2)


def test_current_command_is_reported_as_current():
    device = fp.create("ability_hand")
    command = struct.pack("<6h", *[round(0.5 * 620.606)] * 6)
    reply = ask(device, 0x30, command)
    assert struct.unpack_from("<h", reply, 3)[0] == 310


def test_hand_holds_when_left_alone():
    device = fp.create("ability_hand")
    command = struct.pack("<6h", *[1092] * 6)
    for k in range(30):
        ask(device, 0x20, command, t_ns=k * 10_000_000)
    stopped = ask(device, 0xA2, t_ns=10**10)
    assert struct.unpack_from("<h", stopped, 25)[0] == 0
    assert ask(device, 0xA2, t_ns=10**10 + 10**8)[1:3] == stopped[1:3]


def test_joints_follow_and_hold_when_left_alone():
    device = fp.create("ability_hand")
    assert np.allclose(list(device.joints(0).values()), np.deg2rad([15] * 5 + [-15]))
    ask(device, 0x40, struct.pack("<6h", *[709] * 6))
    moving = [device.joints(t_ns)["index"] for t_ns in (100_000_000, 200_000_000, 300_000_000)]
    held = [device.joints(t_ns)["index"] for t_ns in (400_000_000, 10**10)]
    assert moving == sorted(moving) and moving[0] < moving[2] == held[0] == held[1]


def test_dropped_without_a_word():
    device = fp.create("ability_hand")
    for frame in ("7e50a20f7e", "7e51a20d7e", "7e5010aa007e", "7e50137e"):
        assert send(device, frame) == []
    assert device.counters["bad_checksum"] >= 1 and device.counters["other_address"] == 1


@pytest.mark.parametrize(
    ("message", "header", "size"),
    [
        (b"\x50\x11\x00\x10\x00\x10", 0x11, 71),
        (b"\x50\x20", 0x20, 71),
        (b"\x50\xa0" + bytes(range(12)), 0xA0, 71),
        (b"\x50\xc2", 0xA2, 38),
        (b"\x50\xc3", 0xA2, 38),
        (b"\x50\x7c", 0xA2, 38),
        (b"\x50\x07", 0xA2, 38),
        (b"\x50\x99", 0xA2, 38),
        (b"\x50\x13" + bytes(12), 0xA2, 38),
    ],
)
def test_every_sound_message_is_answered(message, header, size):
    device = fp.create("ability_hand")
    ask(device, 0xA2)
    reply = ask(device, message[1], message[2:])
    assert reply[0] == header and len(reply) == size
    assert ask(device, 0xA0, t_ns=10**8)[1:3] == b"\xcd\x0c", "nothing moves"


def test_registers_and_reset():
    device = fp.create("ability_hand")
    done, failed = struct.pack("<I", 0x4E11FEA4), struct.pack("<I", 0xFA17FFFF)
    assert ask(device, 0xDE, struct.pack("<ii", 5, -7)) == done + struct.pack("<i", -7)
    assert ask(device, 0xDA, struct.pack("<i", 5)) == done + struct.pack("<i", -7)
    assert ask(device, 0xDE, struct.pack("<ii", 64, 1)) == failed + bytes(4)
    assert send(device, stuff(b"\x50\x09")) == []
    assert ask(device, 0xDA, struct.pack("<i", 5)) == done + bytes(4)


@pytest.mark.parametrize("register", [10, 20, 60, 61, 62])
def test_registers_that_can_only_be_read(register):
    device = fp.create("ability_hand")
    assert ask(device, 0xDE, struct.pack("<ii", register, 9)) == struct.pack("<Ii", 0xFA17FFFF, 0)
    assert ask(device, 0xDA, struct.pack("<i", register)) == struct.pack("<Ii", 0x4E11FEA4, 0)


def test_without_stuffing_a_silence_ends_a_message():
    device = fp.create("ability_hand", stuffing=False)
    message = b"\x50\xda\x7e\x00\x00\x00"
    message += bytes([-sum(message) & 0xFF])
    assert send(device, message[:3], 0) == [] and device.wake_ns == 1_000_000
    assert send(device, message[3:], 400_000) == [] and device.wake_ns == 1_400_000
    assert frames(device.wake(1_400_000)) == [bytes.fromhex("ffff17fa00000000f1")]
    send(device, b"\x50\xa2\x0e", 2_000_000)
    (reply,) = frames(device.wake(3_000_000))
    assert len(reply) == 39 and reply[0] == 0xA2 and sum(reply) & 0xFF == 0
    send(device, bytes(100), 4_000_000)
    assert frames(device.wake(5_000_000)) == []


def test_line_speed():
    assert fp.create("ability_hand").ports[0].baud == 460800
    assert fp.create("ability_hand", baud="921600").ports[0].baud == 921600
    with pytest.raises(ValueError, match="baud"):
        fp.create("ability_hand", baud=12345)
