"""A loop that is late: what the kernel drops, and what is left when the port closes, is counted to the last frame."""

import socket

import pytest

from firmware_protocols import Udp
from tactemu.transports.udp import UdpTransport
from tactemu.wire.wire import Wire

SENT = 3000


@pytest.mark.parametrize("closed_early", [False, True])
def test_every_datagram_of_a_flood_is_accounted_for(closed_early):
    wire = Wire(UdpTransport("127.0.0.1:0"), Udp(port=0))
    wire.attach("device", Udp(port=0))
    wire.open()
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as driver:
            driver.connect(("127.0.0.1", wire.transport.port))
            for _ in range(SENT):
                driver.send(b"order")
            now_ns = 0
            while not closed_early and (wire.receive(now_ns) or wire.next_due_ns() is not None):
                now_ns += 1_000_000
            wire.receive(now_ns)
    finally:
        wire.close()
    counts = {name: wire.counters[name] for name in ("received", "overflow", "unprocessed")}
    assert sum(counts.values()) == SENT, counts
    assert counts["overflow"] > SENT / 2
    assert bool(counts["unprocessed"]) == closed_early
    wire.close()
    assert sum(wire.counters[name] for name in counts) == SENT, "closed twice"
