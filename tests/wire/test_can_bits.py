"""Exact frame lengths: against can-utils' published figures, and against a bit-by-bit model written the plain way."""

import numpy as np
import pytest

from firmware_protocols import CanFrame
from tactemu.wire.can_bits import frame_bits, frame_ns, priority


def plain_classic_bits(frame: CanFrame) -> int:
    """ISO 11898-1 word by word: build the bit string, its CRC and its stuff bits one bit at a time."""
    rtr = str(int(frame.is_remote_frame))
    if frame.is_extended_id:
        ident = f"{frame.arbitration_id:029b}"
        bits = "0" + ident[:11] + "11" + ident[11:] + rtr + "00"
    else:
        bits = "0" + f"{frame.arbitration_id:011b}" + rtr + "00"
    bits += f"{len(frame.data):04b}"
    if not frame.is_remote_frame:
        bits += "".join(f"{byte:08b}" for byte in frame.data)
    crc = 0
    for bit in bits:
        feed = int(bit) ^ (crc >> 14)
        crc = (crc << 1) & 0x7FFF
        if feed:
            crc ^= 0x4599
    bits += f"{crc:015b}"
    return len(bits) + plain_stuff(bits) + 1 + 2 + 7 + 3


def plain_stuff(bits: str) -> int:
    count, last, run = 0, "", 0
    for bit in bits:
        last, run = (last, run + 1) if bit == last else (bit, 1)
        if run == 5:
            count, last, run = count + 1, "10"[int(bit)], 1
    return count


def test_canbusload_figure():
    """Compare with `canbusload -e` of can-utils, which counts 119 bits for this frame."""
    assert frame_bits(CanFrame(arbitration_id=0x42A, data=bytes(range(1, 9)))) == (119, 0)


@pytest.mark.parametrize(
    ("extended", "size", "least", "mean", "worst"),
    [(False, 8, 111, 114.3, 135), (True, 8, 131, 135.1, 160), (False, 2, 63, 65.3, 75)],
)
def test_table_of_lengths(extended, size, least, mean, worst):
    rng = np.random.default_rng(1)
    lengths = []
    for _ in range(4000):
        ident = int(rng.integers(1 << (29 if extended else 11)))
        frame = CanFrame(arbitration_id=ident, data=rng.bytes(size), is_extended_id=extended)
        lengths.append(frame_bits(frame)[0])
        if len(lengths) <= 500:
            assert lengths[-1] == plain_classic_bits(frame), frame
    assert least <= min(lengths) and max(lengths) <= worst
    assert np.mean(lengths) == pytest.approx(mean, abs=0.3)


@pytest.mark.parametrize("byte", [0x00, 0xFF, 0x55, 0x0F, 0xF8, 0x78, 0x3C])
@pytest.mark.parametrize("ident", [0, 0x7FF, 0x078, 0x783, 0x555])
@pytest.mark.parametrize("size", range(9))
def test_runs_of_equal_bits(byte, ident, size):
    for extended in (False, True):
        frame = CanFrame(
            arbitration_id=ident << 18 if extended else ident, data=bytes([byte] * size), is_extended_id=extended
        )
        assert frame_bits(frame)[0] == plain_classic_bits(frame)


def test_remote_frame_carries_no_data_bits():
    frame = CanFrame(arbitration_id=0x123, is_remote_frame=True)
    assert frame_bits(frame)[0] == plain_classic_bits(frame)


@pytest.mark.parametrize(("extended", "least_us", "worst_us"), [(False, 139.8, 169.6), (True, 158.8, 192.6)])
def test_fd_at_1_and_5_megabit(extended, least_us, worst_us):
    alternating = CanFrame(
        arbitration_id=0x15555555 if extended else 0x555,
        data=b"\x55" * 64,
        is_extended_id=extended,
        is_fd=True,
        bitrate_switch=True,
    )
    times = [frame_ns(alternating, 1_000_000, 5_000_000)]
    rng = np.random.default_rng(2)
    for fill in (b"\x00", b"\xff", b"\x78", b"\x87", b"\x0f", b"\xf0", b"\xe1", b"\x1e", None):
        for _ in range(100):
            ident = int(rng.integers(1 << (29 if extended else 11)))
            frame = CanFrame(
                arbitration_id=ident,
                data=fill * 64 if fill else rng.bytes(64),
                is_extended_id=extended,
                is_fd=True,
                bitrate_switch=True,
            )
            times.append(frame_ns(frame, 1_000_000, 5_000_000))
    assert min(times) / 1e3 >= least_us - 1e-6
    assert min(times) / 1e3 <= least_us + 1.3  # the head's own runs cost a stuff bit or so
    assert max(times) / 1e3 <= worst_us
    assert max(times) / 1e3 >= worst_us - 6.0  # the bound also stuffs fixed bits of the head


@pytest.mark.parametrize(
    ("size", "code", "crc"),
    [
        (0, "0000", 17 + 6), (8, "1000", 17 + 6), (12, "1001", 17 + 6), (16, "1010", 17 + 6),
        (20, "1011", 21 + 7), (24, "1100", 21 + 7), (64, "1111", 21 + 7),
    ],
)  # fmt: skip
def test_fd_stuff_bits_bit_by_bit(size, code, crc):
    """Count the bits of ISO 11898-1: up to 16 bytes a CRC of 17 bits with 6 fixed stuff bits, beyond of 21 with 7."""
    rng = np.random.default_rng(3)
    for _ in range(300 if size == 16 else 50):
        data = rng.choice(np.array([0x00, 0xFF, 0x0F, 0x37], np.uint8), size=size).tobytes()
        ident = int(rng.integers(1 << 11))
        frame = CanFrame(arbitration_id=ident, data=data, is_fd=True)
        bits = "0" + f"{ident:011b}" + "00" + "100" + "0" + code + "".join(f"{b:08b}" for b in data)
        stuff = plain_stuff(bits[:-1] + ("" if plain_stuff(bits) > plain_stuff(bits[:-1]) else bits[-1]))
        assert frame_bits(frame) == (len(bits) + stuff + 4 + crc + 13, 0)


@pytest.mark.parametrize("is_fd", [False, True])
def test_an_error_frame_adds_two_flags_and_a_delimiter(is_fd):
    options = {"arbitration_id": 0x123, "data": b"12345678", "is_fd": is_fd, "bitrate_switch": is_fd}
    slow, fast = frame_bits(CanFrame(**options))
    assert frame_bits(CanFrame(**options, is_error_frame=True)) == (slow + 6 + 6 + 8, fast)


def test_arbitration_order():
    frames = [
        CanFrame(arbitration_id=0x100),
        CanFrame(arbitration_id=0x100, is_remote_frame=True),
        CanFrame(arbitration_id=0x100 << 18, is_extended_id=True),
        CanFrame(arbitration_id=(0x100 << 18) + 1, is_extended_id=True),
        CanFrame(arbitration_id=0x101),
    ]
    assert sorted([*frames[2:], *frames[:2]], key=priority) == frames
