"""Ends of a serial line with different settings: what they receive of each other."""

import numpy as np
import pytest

from firmware_protocols import Serial
from tactemu.transports.transport import SerialSetting
from tactemu.wire.uart import as_received
from tactemu.wire.wire import ReceivedData
from tests.wire.test_pacing import FRAME, UART, plugged, run_until


def at(baud, bytesize=8, parity="N", stopbits=1):
    return SerialSetting(baud, bytesize, parity, stopbits)


def test_at_the_right_speed_everything_and_at_another_noise_both_ways():
    rng = np.random.default_rng(3)
    frame = rng.bytes(200)
    for baud, equal in ((115_200, True), (57_600, False), (230_400, False), (9600, False), (921_600, False)):
        wire, driver = plugged(UART)
        driver.set_serial(baud=baud)
        driver.write(frame)
        wire.receive(0)
        heard = b"".join(event.data for event in wire.receive(10**9) if isinstance(event, ReceivedData))
        wire.send([frame], 2 * 10**9)
        seen = b"".join(piece for _, piece in run_until(wire, 3 * 10**9))
        assert (heard == frame) == (seen == frame) == equal
        assert wire.counters["misheard"] == (0 if equal else 2)
        if not equal:
            assert frame[:8] not in seen and frame[:8] not in heard


def test_usb_has_no_speed():
    wire, driver = plugged(Serial(baud=115_200, usb=True))
    driver.set_serial(baud=9600, parity="E")
    wire.send([FRAME], 0)
    wire.flush(0)
    assert driver.read() == [FRAME]


def test_a_small_difference_of_speed_does_no_harm():
    """Allow what data sheets allow: a UART samples mid-bit, so that half a bit in ten, 5 %, may be lost."""
    everything = bytes(range(256))
    for off in (0.97, 0.98, 1.02, 1.03):
        assert as_received(everything, at(115_200), at(round(115_200 * off))) == everything
    assert as_received(everything, at(115_200), at(round(115_200 * 1.1))) != everything


def test_noise_that_can_be_worked_out_by_hand():
    """Work out the samples: 0x00 at 9600 is nine low bits; at 19200 its stop bit is low: received as one 0x00.

    0xF0 at 19200 is low for five bits; at 9600 those are the start bit and a half: sampled 0, 0, then high.
    """
    assert as_received(b"\x00", at(9600), at(19_200)) == b"\x00"
    assert as_received(b"\xf0", at(19_200), at(9600)) == b"\xfe"
    assert as_received(b"\xff", at(9600), at(19_200)) == b"\xfe"
    assert as_received(b"", at(9600), at(19_200)) == b""


def test_formats_that_disagree_by_hand():
    """Work out the levels: low for the start bit, then least significant bit first, then parity if any, then high.

    ``A`` (0x41) has two ones, ``C`` (0x43) three: even parity is 0 and 1, and lands where the eighth bit is looked for.
    Where parity is looked for and none is sent, the stop bit is taken for it, and the next start bit for the stop bit:
    the receiver waits for a high bit, which is bit 0 of the second 0x55, and begins at the fall to bit 1: it takes that
    for the start bit, then receives 1 0 1 0 1 0, the stop bit and one idle bit.
    """
    plain, seven_even = at(9600), at(9600, bytesize=7, parity="E")
    assert as_received(b"AC", seven_even, plain) == b"A\xc3"
    assert as_received(b"AC", at(9600, bytesize=7, parity="O"), plain) == b"\xc1C"
    assert as_received(b"AC", at(9600, bytesize=7, parity="M"), plain) == b"\xc1\xc3"
    assert as_received(b"AC", at(9600, bytesize=7, parity="S"), plain) == b"AC"
    assert as_received(b"\xc1C", plain, seven_even) == b"AC", "the eighth bit is taken for parity, which nobody checks"
    assert as_received(b"\x55", plain, at(9600, parity="E")) == b"\x55"
    assert as_received(b"\x55\x55", plain, at(9600, parity="E")) == b"\x55\xd5"
    assert as_received(b"\x55\x55", at(9600, stopbits=2), at(9600, parity="E")) == b"\x55\x55", "a gap to find its feet"
    assert as_received(b"AC", at(9600, parity="E"), at(9600, parity="O")) == b"AC", "raw mode checks no parity"
    assert as_received(b"AC", at(9600, stopbits=2), plain) == as_received(b"AC", plain, at(9600, stopbits=2)) == b"AC"


@pytest.mark.parametrize(("stopbits", "received"), [(1, b"\x55\xd5"), (1.5, b"\x55\x55"), (2, b"\x55\x55")])
def test_one_and_a_half_stop_bits_are_a_gap_too(stopbits, received):
    """Let the receiver take the first stop bit for parity; it finds the second byte only after a longer gap."""
    assert as_received(b"\x55\x55", at(9600, stopbits=stopbits), at(9600, parity="E")) == received


def test_what_an_end_does_not_say_is_as_at_the_other():
    assert as_received(b"AC", SerialSetting(baud=9600), at(9600, bytesize=7, parity="E")) == b"AC"
    assert as_received(b"AC", SerialSetting(), at(9600)) == b"AC"
    assert as_received(b"\xf0", SerialSetting(baud=19_200, stopbits=1), at(9600)) == b"\xfe"


@pytest.mark.parametrize("usb", [False, True])
def test_a_driver_with_another_format_receives_noise_and_so_does_the_device(usb):
    wire, driver = plugged(Serial(baud=9600, bytesize=7, parity="E", usb=usb))
    driver.set_serial(baud=9600, bytesize=8, parity="N", stopbits=1)
    driver.write(b"\xc3")
    events = wire.receive(0) + wire.receive(10**9)
    assert [event.data for event in events if isinstance(event, ReceivedData)] == [b"\xc3" if usb else b"C"]
    wire.send([b"C"], 2 * 10**9)
    assert [frame for _, frame in run_until(wire, 3 * 10**9)] == [b"C" if usb else b"\xc3"]
