"""An I2C bus: its time, its addresses, two targets on one bus, and faults of its frames."""

import pytest

from firmware_protocols import I2c
from tactemu.base.errors import SceneError
from tactemu.transports.memory import MemoryTransport
from tactemu.wire.line_models import line_model_for
from tactemu.wire.wire import ReceivedData, Wire

US = 1_000
PAD, OTHER = I2c(addresses=(4, 0x20)), I2c(addresses=(0x21,))
ASK, READ = bytes.fromhex("08018006"), bytes.fromhex("0900000006")


def heard(wire, now):
    return [event for event in wire.receive(now) if isinstance(event, ReceivedData)]


def test_a_byte_takes_nine_clocks():
    line = line_model_for(PAD)
    assert line.driver_ns(ASK, None) == (1 + 4 * 9) * 10 * US and line.duration_ns(bytes(6)) == 54 * 10 * US
    assert line.driver_ns(READ, None) == 100 * US, "of a read, the address alone"
    assert line_model_for(I2c(addresses=(4,), clock_hz=400_000)).duration_ns(b"1234") == 90 * US
    assert line_model_for(PAD, pacing=False).driver_ns(ASK, None) == 0
    assert line.describe() == "I2C 0x04, 0x20 100 kHz"


def test_a_request_its_time_and_the_bytes_that_answer():
    wire = Wire(MemoryTransport(), PAD)
    wire.open()
    wire.receive(0)
    wire.transport.driver.write(ASK)
    assert not heard(wire, 0)
    wire.flush(370 * US)
    assert [event.data for event in heard(wire, 370 * US)] == [ASK]
    wire.send([bytes(6)], 370 * US, "pad")
    wire.flush(909 * US)
    assert not wire.transport.driver.read()
    wire.flush(910 * US)
    assert wire.transport.driver.read() == [bytes(6)]


def test_each_target_receives_what_has_its_address():
    line = line_model_for(PAD)
    assert line.is_shared and line.agrees(OTHER) and not line.agrees(PAD) and not line.agrees(I2c(addresses=(0x20,)))
    assert not line.agrees(I2c(addresses=(0x21,), clock_hz=400_000))
    wire = Wire(MemoryTransport(), PAD, pacing=False)
    for name, connector in (("pad", PAD), ("other", OTHER)):
        wire.attach(name, connector)
    cases = {ASK: ["pad"], b"\x42\x01": ["other"], b"\x40\x01": ["pad"], b"\x50\x01": [], b"": []}
    for frame, takers in cases.items():
        received = ReceivedData(frame)
        assert [name for name in ("pad", "other") if wire.received_by(name, received)] == takers
    assert {(each.ident, each.mask) for each in line.filters([PAD, OTHER])} == {(4, 127), (32, 127), (33, 127)}


def test_faults_of_the_bus():
    wire = Wire(MemoryTransport(), PAD, faults=["flip frame 2 byte 0 bit 7", "drop frame 1 from_driver"], pacing=False)
    wire.open()
    wire.receive(0)
    for _ in range(2):
        wire.transport.driver.write(READ)
    assert not heard(wire, 0)
    wire.flush(0)
    assert [event.data for event in heard(wire, 0)] == [READ]
    for _ in range(2):
        wire.send([b"\0\1"], 0, "pad")
        wire.flush(0)
    assert wire.transport.driver.read() == [b"\0\1", b"\x80\1"]
    with pytest.raises(SceneError, match="a i2c wire cannot have it"):
        wire.add_fault("garbage")
    with pytest.raises(SceneError, match="no identifiers"):
        wire.add_fault("drop id=4")
