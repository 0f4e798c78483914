"""The contract of every transport, tried on all of the registry with the ends in ``driver_ends``."""

import select
import socket
import time

import pytest
import serial

from tactemu import transports
from tactemu.base.errors import TransportError
from tactemu.transports.transport import (
    DROPPED,
    RAISED,
    Closed,
    LinesChanged,
    Opened,
    Received,
    SerialSetting,
    SettingChanged,
)
from tests.transports.driver_ends import CASES, DRIVERS, CanEnd, create, pumping


def look(port, seen, kind, seconds=2.0):
    end = time.monotonic() + seconds
    while not any(isinstance(event, kind) for event in seen) and time.monotonic() < end:
        if port.filenos():
            select.select(port.filenos(), [], [], 0.05)
        seen += port.poll()
    return seen


def test_every_scheme_has_a_driver():
    assert set(DRIVERS) == set(transports.TRANSPORTS)


@pytest.mark.parametrize(("address", "end"), CASES)
def test_a_driver_comes_talks_and_goes_twice(address, end, tmp_path):
    with create(address.format(tmp=tmp_path)) as port:
        driver = end(port, port.address)
        bus, adapter = type(driver) is CanEnd, isinstance(driver, CanEnd)
        for _ in range(1 if bus else 2):
            assert port.has_reader == bus
            if not bus:
                assert not port.write(driver.frame), "no driver has the port open"
            seen = []
            driver.open(seen)
            if not adapter:
                look(port, seen, LinesChanged)
                assert seen[0] == Opened() and [e for e in seen if isinstance(e, LinesChanged)][-1] == RAISED
            while adapter and not bus and not port.has_reader:
                port.poll()
            assert port.has_reader
            assert port.write(driver.frame)
            assert driver.read(driver.frame) == driver.frame
            driver.write(driver.request)
            seen = look(port, [], Received)
            assert [event.data for event in seen if isinstance(event, Received)] == [driver.request]
            assert port.poll() == [], "own frames do not come back"
            driver.close()
            if not adapter:
                assert look(port, [], Closed)[-2:] == [Closed(), DROPPED]
            look(port, [], Closed, seconds=0.1)


@pytest.mark.parametrize(("address", "end"), CASES)
def test_closing_is_safe_at_any_time(address, end, tmp_path):
    port = create(address.format(tmp=tmp_path))
    port.close()
    assert port.poll() == [] and not port.has_reader
    for _ in range(3):
        port.open()
        port.open()
        assert all(fileno >= 0 for fileno in port.filenos())
        port.close()
        port.close()
    assert port.filenos() == [] and not port.has_reader


@pytest.mark.parametrize(
    "address",
    [
        "",
        "nope:",
        "can:",
        "can:socketcan",
        "tcp:",
        "tcp:host:",
        "tcp:1:99999",
        "udp:1:99999",
        "ws:x",
        "dds:",
        "dds:300",
        "dds:lo",
        "udp:no.such.host.invalid:1",
        "rfc2217:x",
        "tcp:no.such.host.invalid:1",
    ],
)
def test_wrong_addresses_say_what_is_expected(address):
    with pytest.raises(TransportError, match=r"expected|choose"):
        transports.create(address).open()


@pytest.mark.parametrize("address", ["can:socketcan:nosuchcan0", "can:nosuchinterface:x"])
def test_a_missing_can_interface_names_the_fix(address):
    with pytest.raises(TransportError, match=r"ip link add dev nosuchcan0 type vcan|choose an interface.*socketcan"):
        transports.create(address).open()


@pytest.mark.parametrize("scheme", ["tcp", "udp", "ws"])
def test_a_taken_port(scheme):
    with transports.create(f"{scheme}:0") as first, pytest.raises(TransportError, match="in use"):
        transports.create(f"{scheme}:{first.port}").open()


@pytest.mark.parametrize(
    ("address", "warns"),
    [("tcp:0", 0), ("tcp:[::1]:0", 0), ("tcp:0.0.0.0:0", 1), ("tcp:[::]:0", 1), ("udp:0", 0), ("udp:0.0.0.0:0", 1)],
)
def test_a_port_that_others_reach_says_so_in_one_line(address, warns, caplog):
    with transports.create(address) as port:
        assert [record.getMessage().count("\n") for record in caplog.records] == [0] * warns
        assert all(port.address in record.getMessage() for record in caplog.records)


def test_a_client_that_comes_and_goes_and_comes_again_does_not_wait():
    """Leave room in the queue of clients: one that the kernel drops tries again only after a second."""
    with transports.create("tcp:0") as port:
        began = time.monotonic()
        for _ in range(8):
            socket.create_connection(("127.0.0.1", port.port)).close()
        assert time.monotonic() - began < 0.9
        with socket.create_connection(("127.0.0.1", port.port)):
            assert look(port, [], Received, seconds=0.2).count(Opened()) == 9
            assert port.has_reader


def test_a_second_tcp_client_is_turned_away():
    with transports.create("tcp:0") as port:
        first = serial.serial_for_url(port.address, timeout=1)
        seen = look(port, [], Opened)
        second = serial.serial_for_url(port.address, timeout=1)
        for _ in range(3):
            seen += port.poll()
        with pytest.raises(serial.SerialException):
            second.read(1)
        port.write(b"first")
        assert first.read(5) == b"first" and seen == [Opened(), RAISED]
        first.close()


def test_a_tcp_client_that_does_not_read_loses_whole_frames():
    with transports.create("tcp:0") as port:
        driver = serial.serial_for_url(port.address, timeout=0.2)
        look(port, [], Opened)
        frame = bytes(range(250)) * 4
        taken = sum(port.write(frame) for _ in range(20_000))
        assert taken < 20_000
        got = b""
        while len(got) < taken * len(frame) and (chunk := driver.read(100_000)):
            got += chunk
            port.poll()
        assert got == frame * taken
        driver.close()


def test_rfc2217_speed_and_modem_lines():
    with transports.create("rfc2217:0") as port:
        seen = []
        with pumping(port, seen):
            driver = serial.serial_for_url(port.address, baudrate=460_800, timeout=1)
            driver.dtr = False
            driver.rts = False
            driver.baudrate = 123_456
            driver.bytesize, driver.parity, driver.stopbits = 7, "E", 2
            assert driver.cts and driver.dsr
            driver.write(b"\xff\xff\x00" * 10)
            time.sleep(0.1)
            driver.close()
        assert {event.setting.baud for event in seen if isinstance(event, SettingChanged)} == {460_800, 123_456}
        assert port.setting == SerialSetting(123_456, 7, "E", 2)
        assert [event for event in seen if isinstance(event, LinesChanged)][-1] == LinesChanged(False, False)
        assert b"".join(event.data for event in seen if isinstance(event, Received)) == b"\xff\xff\x00" * 10
        assert Closed() in seen


def test_rfc2217_survives_malformed_options():
    import numpy as np

    rng = np.random.default_rng(5)
    with transports.create("rfc2217:0") as port:
        client = socket.create_connection(("127.0.0.1", port.port))
        look(port, [], Opened)
        for _ in range(300):
            parts = [b"\xff\xfa\x2c", b"\xff\xf0", b"\xff", b"\x01", bytes(rng.integers(0, 256, 3, np.uint8))]
            client.sendall(b"".join(parts[k] for k in rng.integers(0, 5, 12)))
            port.poll()
            client.setblocking(False)
            try:
                while client.recv(65_536):
                    pass
            except BlockingIOError:
                client.setblocking(True)
        assert port.has_reader
        client.close()
