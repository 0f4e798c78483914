"""``serial:``, a real port, against a pseudo terminal; ``test_real_uarts.py`` has the UARTs of a kernel."""

import os
import select
import time
import tty

import pytest

from firmware_protocols import Can, Rs485, Serial
from tactemu import transports
from tactemu.base.clock import VirtualClock
from tactemu.base.errors import TransportError
from tactemu.transports.memory import MemoryTransport
from tactemu.transports.transport import RAISED, Closed, Counted, LinesChanged, Noted, Opened, Received
from tactemu.transports.uart_settings import MarkedStream, UartErrors
from tactemu.truth import Truth
from tactemu.wire.wire import Wire

LINE = Serial(baud=115_200)


@pytest.fixture
def cable():
    """The other end of a cable, as a file descriptor, and the path of our end."""
    far, near = os.openpty()
    tty.setraw(near)
    yield far, os.ttyname(near)
    os.close(near)
    os.close(far)


def opened(path, options="", connector=LINE):
    port = transports.create(f"serial:{path}{options}")
    port.set_connector(connector)
    port.open()
    return port


def events(port, kind, seconds=2.0):
    """Return the events up to the first of a kind."""
    seen, deadline = [], time.monotonic() + seconds
    while not any(isinstance(event, kind) for event in seen) and time.monotonic() < deadline:
        select.select(port.filenos(), [], [], 0.05)
        seen += port.poll()
    return seen


def test_bytes_pass_both_ways_and_ff_is_not_a_mark(cable):
    far, path = cable
    with opened(path) as port:
        assert events(port, LinesChanged) and port.has_reader
        data = bytes(range(256)) + b"\xff\xff\x00"
        assert port.write(data)
        assert os.read(far, 1000) == data
        os.write(far, data)
        got = b""
        while len(got) < len(data):
            got += b"".join(event.data for event in events(port, Received) if isinstance(event, Received))
        assert got == data


def test_a_port_is_there_from_the_beginning_and_its_modem_lines_are_unknown(cable):
    with opened(cable[1]) as port:
        assert [event for event in events(port, LinesChanged) if not isinstance(event, Noted)] == [Opened(), RAISED]


def test_a_cable_that_is_pulled_out_closes_the_port_and_a_frame_finds_nobody(cable, monkeypatch):
    far, path = cable
    port = opened(path)
    events(port, LinesChanged)
    monkeypatch.setattr(os, "read", lambda fd, size, read=os.read: b"" if fd == port._fd else read(fd, size))
    seen = events(port, Closed)
    assert Closed() in seen and "has gone" in str(seen[-1])
    assert not port.has_reader and not port.write(b"x")
    monkeypatch.undo()
    assert Opened() in events(port, Opened), "it is back under its name"
    assert port.write(b"again") and os.read(far, 9) == b"again"
    port.close()


def test_own_bytes_that_come_back_are_taken_out(cable):
    far, path = cable
    with opened(path, "?echo=1&rs485=adapter", Rs485(baud=115_200)) as port:
        events(port, LinesChanged)
        port.write(b"answer")
        os.write(far, b"ans")
        assert not events(port, Received, 0.1)
        os.write(far, b"werASK")
        assert events(port, Received)[-1] == Received(b"ASK")
        port.write(b"answer")
        os.write(far, b"anXXer")
        seen = events(port, Received)
        assert any(isinstance(event, Noted) and "two ends" in event.what for event in seen)


def test_an_echo_that_never_comes_is_not_waited_for_without_end(cable):
    far, path = cable
    with opened(path, "?echo=1") as port:
        events(port, LinesChanged)
        for _ in range(50):
            assert port.write(bytes(100)) and os.read(far, 100)
        assert any(isinstance(event, Noted) and "no echo" in event.what for event in port.poll())
        assert len(port._echo) < 5000


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("", "which port"),
        ("/dev/ttyUSB77", "ls /dev/serial/by-id"),
        ("ttyUSB77", "cannot open /dev/ttyUSB77"),
        ("by-id/usb-none", "cannot open /dev/serial/by-id/usb-none"),
        ("/dev/null", "no serial port"),
        ("/dev/ttyUSB0?rs486=kernel", "did you mean 'rs485'"),
        ("/dev/ttyUSB0?rs485=rts", "expected adapter or kernel"),
    ],
)
def test_wrong_addresses_say_what_is_expected(address, message):
    with pytest.raises(TransportError, match=message):
        port = transports.create(f"serial:{address}")
        port.set_connector(LINE)
        port.open()


def test_a_device_without_a_uart_is_refused(cable):
    with pytest.raises(TransportError, match="no serial line"):
        opened(cable[1], connector=Can())


def test_a_second_program_cannot_take_the_port(cable):
    with opened(cable[1]), pytest.raises(TransportError, match="locked by another"):
        opened(cable[1])


# -- the kernel's marks and counters -----------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [1, 2, 3, 100])
def test_marks_of_breaks_and_bad_bytes_are_taken_out_however_they_are_cut(size):
    marked = b"a\xff\xffb\xff\x00\x00c\xff\x00\x55d\xff\xff\xff\x00\x00"
    stream, data, breaks, bad = MarkedStream(), b"", 0, 0
    for at in range(0, len(marked), size):
        piece = stream.decode(marked[at : at + size])
        data, breaks, bad = data + piece[0], breaks + piece[1], bad + piece[2]
    assert (data, breaks, bad) == (b"a\xffbc\x55d\xff", 2, 1)


def test_counters_that_have_grown():
    assert UartErrors(framing=5, breaks=2).since(UartErrors(framing=3, breaks=2)) == {"framing": 2}
    assert UartErrors().since(UartErrors(parity=3)) == {}, "another adapter begins at 0"


# -- the line is paced once --------------------------------------------------------------------------------------------


class PacedPort(MemoryTransport):
    is_paced = True


def test_a_frame_is_handed_over_at_its_first_bit_and_the_line_is_busy_until_its_last():
    truth, clock = Truth(), VirtualClock()
    wire = Wire(PacedPort(), LINE, truth=truth)
    wire.open()
    wire.transport.driver.open()
    wire.receive(0)
    frame = bytes(115)
    took_ns = len(frame) * 10 * 10**9 // 115_200
    wire.send([frame, frame, frame], 0, "skin")
    sent_ns = []
    while (due := wire.next_due_ns()) is not None:
        clock.wait(due, ())
        if wire.flush(due):
            sent_ns.append(due)
    assert sent_ns == pytest.approx([0, took_ns, 2 * took_ns], abs=2)
    ends = [t_ns for t_ns, _, _ in truth.frames]
    assert ends == pytest.approx([took_ns, 2 * took_ns, 3 * took_ns], abs=3), "the log has the times of the last bits"
    assert wire.line.busy_ns == pytest.approx(3 * took_ns, abs=3)


def test_what_the_driver_sends_has_taken_its_time():
    wire = Wire(PacedPort(), LINE)
    wire.open()
    wire.transport.driver.open()
    wire.receive(0)
    wire.transport.driver.write(bytes(100))
    assert any(getattr(event, "data", b"") == bytes(100) for event in wire.receive(1))


@pytest.mark.parametrize(("port", "echoed"), [(MemoryTransport, [b"ask"]), (PacedPort, [])])
def test_only_a_modelled_adapter_gets_its_echo_from_the_wire(port, echoed):
    wire = Wire(port(), Rs485(baud=115_200, echo=True))
    wire.open()
    wire.transport.driver.open()
    wire.receive(0)
    wire.transport.driver.write(b"ask")
    for now in range(0, 10**7, 10**5):
        wire.receive(now)
        wire.flush(now)
    assert wire.transport.driver.read() == echoed


def test_errors_of_the_line_are_counted():
    class Noisy(PacedPort):
        def poll(self, reading=True):
            return [*super().poll(reading), Counted("framing", 3)]

    wire = Wire(Noisy(), LINE)
    wire.open()
    assert Noted("framing: 3") in wire.receive(0)
    assert wire.counters["framing"] == 3
