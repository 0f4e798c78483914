"""A wire with faults, fed with numbered frames."""

from collections import Counter

from firmware_protocols import Can, CanFrame, Serial, Udp
from tactemu.transports.memory import MemoryTransport
from tactemu.truth import Truth
from tactemu.wire.faults import FAULTS
from tactemu.wire.wire import Wire

USB = Serial(baud=115_200, usb=True)
CAN = Can()
UDP = Udp(port=1)
MS = 1_000_000


def frame(number, spec):
    data = number.to_bytes(4, "big") + b"\x5a" * 3 + bytes([number % 251])
    return CanFrame(arbitration_id=0x200 + number % 2, data=data) if spec is CAN else data


def data_of(frame):
    return frame.data if isinstance(frame, CanFrame) else frame


def stream(spec, faults, count=2000, seed=0, period=MS):
    """Send ``count`` numbered frames, one every ``period`` [ns]; return them, the arrivals with times, the faults."""
    truth = Truth()
    wire = Wire(MemoryTransport(), spec, faults=faults, seed=seed, truth=truth)
    wire.open()
    wire.receive(0)
    sent, seen = [frame(k, spec) for k in range(count)], []
    for k, each in enumerate(sent):
        end = (k + 1) * period
        wire.send([each], k * period, "pad")
        wire.flush(k * period)
        seen += [(k * period, got) for got in wire.transport.driver.read()]
        while (due := wire.next_due_ns()) is not None and due < end:
            wire.receive(due)
            wire.flush(due)
            seen += [(due, got) for got in wire.transport.driver.read()]
    assert truth.injected == Counter({kind: n for kind, n in wire.counters.items() if kind in FAULTS})
    return sent, seen, truth.injected
