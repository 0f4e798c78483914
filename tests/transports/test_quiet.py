"""A bus whose socket has nothing to read is not asked for news; what arrives meanwhile is taken at the next wait."""

import time

import pytest

from firmware_protocols import Can, CanFrame
from tactemu.base.waiting import wait_until
from tactemu.transports.can import CanTransport
from tactemu.transports.memory import MemoryTransport
from tactemu.transports.pty import PtyTransport
from tactemu.wire.wire import ReceivedData, Wire

pytest.importorskip("msgpack")


def polls(transport, monkeypatch):
    """Count the polls of a port."""
    count, poll = [], transport.poll
    monkeypatch.setattr(transport, "poll", lambda reading=True: count.append(1) or poll(reading))
    return count


def test_a_quiet_bus_is_not_polled_and_a_frame_is_not_lost(monkeypatch):
    bus, driver = CanTransport("udp_multicast:239.74.163.91"), CanTransport("udp_multicast:239.74.163.91")
    with bus, driver:
        wire = Wire(bus, Can(bitrate=1_000_000))
        count = polls(bus, monkeypatch)
        assert wire.receive(0, []) == [] and not count
        driver.write(frame := CanFrame(arbitration_id=0x123, data=b"12"))
        readable = wait_until(time.monotonic_ns() + 5_000_000_000, wire.filenos())
        wire.receive(1_000_000, readable)
        wire.flush(1_000_000)
        assert count
        assert wire.receive(2_000_000, []) == [ReceivedData(frame)]  # its last bit has gone meanwhile


@pytest.mark.parametrize("port", [PtyTransport, MemoryTransport])
def test_a_port_with_other_news_is_always_polled(port, monkeypatch):
    with port() as transport:
        count = polls(transport, monkeypatch)
        Wire(transport, Can()).receive(0, [])
        assert count
