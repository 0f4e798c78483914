import pytest

from firmware_protocols.sums import SUMS, inv8, lrc8, sum8, sum16, xor8

CHECK = b"123456789"


@pytest.mark.parametrize(
    "name, value",
    [
        # The check values of reveng.sourceforge.io/crc-catalogue.
        ("crc8", 0xF4),
        ("crc8_maxim", 0xA1),
        ("crc16_modbus", 0x4B37),
        ("crc16_arc", 0xBB3D),
        ("crc16_umts", 0xFEE8),
        ("crc16_xmodem", 0x31C3),
        ("crc16_ccitt_false", 0x29B1),
        ("crc16_kermit", 0x2189),
        ("crc16_x25", 0x906E),
        ("crc32", 0xCBF43926),
        ("crc32_mpeg", 0x0376E6E7),
    ],
)
def test_crcs_have_the_catalogue_s_check_values(name, value):
    assert SUMS[name].function(CHECK) == value
    assert value >> 8 * SUMS[name].size == 0


def test_the_crc_of_no_catalogue():
    assert SUMS["crc16_weiss"].function(CHECK) == 0x6EB4, "as SDHLibrary-CPP computes it"
    assert SUMS["crc16_ati"].function(bytes.fromhex("000A000100000000")) == 0x7346, "as WirelessFT computes it"


def test_plain_sums():
    data = bytes([0xF0, 0x20, 0x01])
    assert (sum8(data), inv8(data), lrc8(data), xor8(data), sum16(data)) == (0x11, 0xEE, 0xEF, 0xD1, 0x0111)
    assert sum8(data + bytes([lrc8(data)])) == 0


def test_every_sum_takes_nothing_and_fits_its_size():
    for name, (function, size) in SUMS.items():
        assert 0 <= function(b"") < 1 << 8 * size, name
