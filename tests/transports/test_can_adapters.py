"""CAN behind an adapter: what python-can's clients do not send, and nonsense."""

import contextlib
import os
import socket
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocols import Can, CanFrame
from tactemu import transports
from tactemu.transports import slcan, socketcand
from tactemu.transports.transport import Received
from tests.fuzz import examples

FRAME = CanFrame(arbitration_id=0x123, data=b"\x11\x22")
FRAMES = [
    (FRAME, b"t12321122\r"),
    (CanFrame(arbitration_id=0x123, is_extended_id=True), b"T000001230\r"),
    (CanFrame(arbitration_id=7, is_remote_frame=True), b"r0070\r"),
    (CanFrame(arbitration_id=7, is_fd=True, data=bytes(12)), b"d0079" + b"00" * 12 + b"\r"),
    (CanFrame(arbitration_id=7, is_fd=True, bitrate_switch=True, data=b"\xff" * 64), b"b007F" + b"FF" * 64 + b"\r"),
]


@pytest.mark.parametrize(("frame", "line"), FRAMES)
def test_lines(frame, line):
    assert slcan.line_of(frame) == line and slcan.frame_of(line[:-1]) == frame


@contextlib.contextmanager
def adapter(tmp_path, bitrate=500_000):
    port = transports.create(f"slcan:{tmp_path}/can")
    port.set_connector(Can(bitrate=bitrate))
    with port:
        driver = os.open(port.address, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)

        def ask(line):
            os.write(driver, line)
            answer, events, quiet = b"", [], 0
            while quiet < 3:  # the kernel hands bytes over when it comes to it
                time.sleep(0.005)
                came, said = port.poll(), b""
                with contextlib.suppress(BlockingIOError):
                    said = os.read(driver, 4096)
                quiet = 0 if came or said else quiet + 1
                answer, events = answer + said, events + came
            return answer, events

        yield port, ask
        os.close(driver)


def test_a_channel_is_opened_talks_and_is_closed(tmp_path):
    with adapter(tmp_path) as (port, ask):
        assert ask(b"V\rN\rF\r\r")[0] == b"V1013\rN0001\rF00\r" and not port.has_reader
        assert ask(b"t12321122\r") == (b"\a", []), "not open"
        assert ask(b"S6\rO\r") == (b"\r\r", []) and port.has_reader
        assert ask(b"S4\r")[0] == b"\a", "not while it is open"
        assert ask(b"t1232") == (b"", []) and ask(b"1122\r") == (b"z\r", [Received(FRAME)])
        assert port.write(FRAME) and ask(b"")[0] == b"t12321122\r"
        assert ask(b"C\r") == (b"\r", []) and not port.has_reader and not port.write(FRAME)


def test_who_only_listens_does_not_talk_and_another_bit_rate_hears_nothing(tmp_path):
    with adapter(tmp_path) as (port, ask):
        assert ask(b"L\rt12321122\r") == (b"\r\a", []) and port.has_reader
        assert ask(b"C\rS8\rO\rt12321122\r") == (b"\r\r\rz\r", [])
        assert not port.has_reader and not port.write(FRAME)


@pytest.mark.parametrize(
    "line", [b"Q", b"t", b"t12", b"t1239", b"t123211", b"t8001", b"tzzz0", b"S9", b"\xff\x00", b"t" * 500]
)
def test_nonsense_is_refused(line, tmp_path):
    with adapter(tmp_path) as (port, ask):
        ask(b"O\r")
        answer, events = ask(line + b"\rV\r")
        assert answer.endswith(b"V1013\r") and events == [] and port.has_reader


@examples(200)
@given(st.binary(max_size=40))
def test_no_line_and_no_message_makes_it_raise(data):
    frame = slcan.frame_of(data)
    assert frame is None or slcan.frame_of(slcan.line_of(frame)[:-1]) == frame
    words = data.split()
    assert socketcand.frame_of(b"123", b"2", words) is None or len(words) == 2


def test_socketcand_in_pieces_out_of_turn_and_without_end():
    with transports.create("socketcand:0") as port:
        with socket.create_connection(("127.0.0.1", port.port), timeout=2) as client:
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

            def ask(data):
                client.sendall(data)
                time.sleep(0.01)
                events = [each for _ in range(9) for each in port.poll()]
                return client.recv(4096), events

            assert ask(b"< rawmode >") == (b"< hi >< error unknown command >", [])
            assert ask(b"< open can0 >< echo >") == (b"< ok >< echo >", []) and not port.write(FRAME)
            assert ask(b"< rawmode >") == (b"< ok >", []) and port.has_reader
            client.sendall(b"< send 123 2 11")
            assert ask(b" 22 >< send 123 3 1 >") == (b"< error invalid frame >", [Received(FRAME)])
            assert ask(b"a" * 2000 + b"< send 00000123 0 >< echo >")[1] == [
                Received(CanFrame(arbitration_id=0x123, is_extended_id=True))
            ]
            assert port.write(FRAME) and not port.write(CanFrame(arbitration_id=1, is_fd=True))
            words = client.recv(99).split()
            assert words[:3] == [b"<", b"frame", b"123"] and words[4:] == [b"1122", b">"]
        time.sleep(0.01)
        assert port.poll() == [] and not port.has_reader
