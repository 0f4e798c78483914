"""FTS-3: lines, sensors that are not there, commands with and without an end."""

import pytest

import firmware_protocols as fp
from tests.firmware.feeding import frames, sample, send

OK = b"#OK\r\n"


def told(device, words: bytes, t_ns: int = 0) -> list:
    """What answers a command without an end, after a silence."""
    assert send(device, words, t_ns) == [] and device.wake_ns is not None
    t_ns, device.wake_ns = device.wake_ns, None
    return frames(device.wake(t_ns))


def test_axes_act_on_the_skin_and_a_push_is_positive():
    device = fp.create("seed_fts3")
    (line,) = sample(device, force=[[1.5, -0.25, -2.0]] + [[0, 0, 0]] * 4, t_ns=3_004_000_000)
    assert line == b"@,3,4,1500,-250,2000,0,0,0,0,0,0,0,0,0,0,0,0,\r\n"
    assert sample(device, 1e6)[0].count(b"32767") == 5


def test_a_sensor_of_one_axis_shows_only_that():
    device = fp.create("seed_fts3", sensors=("z", "none", "none", "none", "xyz"))
    (line,) = sample(device, force=[[1.0, 2.0, -3.0]] * 2)
    assert line == b"@,0,0,,,3000,,,,,,,,,,1000,2000,3000,\r\n" and line.count(b",") == 18
    assert device.counts.tolist() == [[0, 0, 3000], [1000, 2000, 3000]]


def test_a_silence_ends_a_command():
    device = fp.create("seed_fts3")
    assert told(device, b"setperiod,40") == [OK] and device.period_ns == 40_000_000
    assert told(device, b"getversion") == [b"#OK,1.0.0\r\n"]
    assert told(device, b"resume,now") == [] and device.counters["unknown_command"] == 1
    assert send(device, b"disabletime\r") == [OK] and device.wake_ns is None
    assert sample(device) == [b"@" + b",0" * 15 + b",\r\n"]


def test_a_period_below_the_shortest_is_the_shortest():
    device = fp.create("seed_fts3")
    assert send(device, b"setperiod,0\n") == [OK] and device.period_ns == 20_000_000


def test_time_goes_on_from_the_epoch():
    device = fp.create("seed_fts3")
    send(device, b"setepoch,1700000000,999\n", 5_500_000_000)
    assert sample(device, t_ns=5_502_000_000)[0].startswith(b"@,1700000001,1,")


def test_fractions_of_the_vendors_programs_are_cut_off():
    device = fp.create("seed_fts3")
    assert told(device, b"setepoch,1781003060.4375293,0") == told(device, b"setperiod,33.333333333333336") == [OK]
    assert device.period_ns == 33_000_000 and sample(device, t_ns=0)[0].startswith(b"@,1781003059,900,")


def test_what_is_felt_is_zero_after_calibrate():
    device = fp.create("seed_fts3")
    sample(device, 2.0)
    assert told(device, b"calibrate") == [OK]
    sample(device, 3.0)
    assert device.counts[:, 2].tolist() == [1000] * 5


def test_noise_without_end_is_dropped():
    device = fp.create("seed_fts3")
    for _ in range(100):
        assert send(device, b"x" * 30) == []
    assert told(device, b"\ncalibrate") == [OK] and device.counters["bad_length"] == 1


def test_a_board_without_sensors_is_refused():
    with pytest.raises(ValueError, match="at least one"):
        fp.create("seed_fts3", sensors=("none",) * 5)
