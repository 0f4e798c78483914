"""The protocol of an I2CDriver: transactions in pieces, a read that waits, targets that are not there, and nonsense."""

import contextlib
import os
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactemu import transports
from tactemu.transports.i2cdriver import I2cDriverTransport
from tactemu.transports.transport import CanFilter, Received
from tests.fuzz import examples

WRITE, READ, ELSEWHERE = b"s\x08", b"s\x09", b"s\x0a"


@pytest.fixture
def adapter(tmp_path):
    port = transports.create(f"i2cdriver:{tmp_path}/i2c")
    port.set_filters([CanFilter(4, 0x7F)])
    with port:
        driver = os.open(port.address, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)

        def ask(data=b""):
            os.write(driver, data)
            answer, frames, quiet = b"", [], 0
            while quiet < 3:  # the kernel hands bytes over when it comes to it
                time.sleep(0.005)
                came, said = [event.data for event in port.poll() if isinstance(event, Received)], b""
                with contextlib.suppress(BlockingIOError):
                    said = os.read(driver, 4096)
                quiet = 0 if came or said else quiet + 1
                answer, frames = answer + said, frames + came
            return answer, frames

        yield port, ask
        os.close(driver)


def test_a_write_is_one_frame_whatever_its_pieces(adapter):
    _, ask = adapter
    assert ask(WRITE + b"\xc1\x01") == (b"1", []) and ask(b"\x80" + b"\xc0\x06") == (b"11", [])
    assert ask(b"p") == (b"", [bytes.fromhex("08018006")])
    assert ask(WRITE + b"p") == (b"1", []), "an address alone is no write"


def test_a_read_waits_for_its_bytes_and_so_do_the_commands_after_it(adapter):
    port, ask = adapter
    assert not port.write(b"early"), "nothing was asked for"
    assert ask(WRITE + b"\xc0\x80" + READ + b"\x85" + b"p") == (b"111", [b"\x08\x80", b"\x09\0\0\0\x06"])
    assert ask(b"e!") == (b"", []) and port.write(b"abcdefgh") and ask()[0] == b"abcdef!"
    ask(READ + b"\x83")
    assert port.write(b"ab") and ask()[0] == b"ab\xff\xff", "a target that lets go of the bus"
    ask(READ + b"\x83")
    assert ask(b"@e?")[0] == b"?" and not port.write(b"late"), "a host that begins anew waits for nothing"


def test_a_longer_read_goes_on_where_it_was(adapter):
    port, ask = adapter
    memory = bytes(range(100))
    assert ask(READ + b"a\x40")[1] == [b"\x09\0\0\0\x40"] and port.write(memory[:64])
    assert ask(b"\xa3")[1] == [b"\x09\0\x40\0\x24"] and port.write(memory[64:]) and ask()[0] == memory[64:]


def test_a_register_is_written_and_read(adapter):
    port, ask = adapter
    assert ask(b"r\x04\x80\x02")[1] == [b"\x08\x80", b"\x09\0\0\0\x02"] and port.write(b"ok") and ask()[0] == b"ok"


def test_where_no_target_is_nothing_is_acknowledged(adapter):
    _, ask = adapter
    assert ask(ELSEWHERE + b"\xc0\x01p") == (b"00", []) and ask(b"s\x0b\x81p") == (b"0\xff\xff", [])
    scan, _ = ask(b"d")
    assert len(scan) == 112 and set(scan) == set(b"0"), "address 4 is below the first that is scanned"


def test_status_reset_echo_and_speed(adapter):
    _, ask = adapter
    status, _ = ask(b"?")
    assert len(status) == 80 and status[:1] + status[-1:] == b"[]" and status[1:-1].split()[9] == b"100"
    assert ask(b"x")[0] == b"\x03" and ask(b"e\xaa")[0] == b"\xaa" and ask(b"4u\x24i")[0] == b""
    assert ask(b"?")[0][1:-1].split()[9] == b"400"


@examples(200)
@given(st.binary(max_size=200))
def test_no_bytes_make_it_raise(data):
    port = I2cDriverTransport("")
    port.set_filters([CanFilter(address, 0x7F) for address in range(60)])
    port._commands = data
    assert all(isinstance(event, Received) and event.data for event in port._obey())
