"""NETCANOEM: captured frames are sent byte by byte, gauges times matrix are force and torque again."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols.frames import CanFrame
from tests.firmware.feeding import sample, send

NAME = "ati_netcanoem"
CAPTURE = json.loads((Path(__file__).parents[1] / "data" / "captures" / "ati_netcanoem.json").read_text())["frames"]
"""Two readings, each a question and two answers with others in between, and a row of the matrix."""


def gauges_of(first: str, second: str) -> list[int]:
    """By number, as they stand in two captured frames."""
    at = [*struct.unpack(">3h", CanFrame.parse(first).data[2:]), *struct.unpack(">3h", CanFrame.parse(second).data)]
    return [at[place] for place in (0, 3, 1, 4, 2, 5)]


@pytest.mark.parametrize(("first", "second"), [(6, 9), (10, 11)])
def test_a_captured_reading_is_sent_byte_by_byte(first, second):
    frames = CAPTURE[first], CAPTURE[second]
    device = fp.create(NAME, base=0x7F, status=0x4000)
    sample(device)
    device.counts = np.array([gauges_of(*frames)])
    assert [str(frame) for frame in send(device, "7F0#")] == list(frames)


def test_a_captured_row_has_the_form_of_ours():
    device = fp.create(NAME, base=0x7F)
    sample(device)
    row = np.concatenate([np.frombuffer(CanFrame.parse(text).data, ">f4") for text in CAPTURE[:3]])
    assert row.round(2).tolist() == pytest.approx([0.75, -27.35, 1.94, -25.62, 1.25, -27.65])
    device.matrix = np.tile(row, (6, 1))
    assert [str(frame) for frame in send(device, "7F2#00")] == CAPTURE[:3]


@pytest.mark.parametrize(
    ("options", "places"), [({}, "024135"), ({"order": "012345", "base": 0x10, "counts_per_torque": 500}, "012345")]
)
def test_gauges_times_matrix_are_force_and_torque(options, places):
    device = fp.create(NAME, **options)
    base = options.get("base", 0x20) << 4
    wrench = [3.0, -4.0, -20.0, 0.2, -0.1, 0.5]
    sample(device, wrench=wrench)
    first, second = send(device, f"{base:03X}#")
    at = [*struct.unpack(">3h", first.data[2:]), *struct.unpack(">3h", second.data)]
    gauges = np.array([at[places.index(str(gauge))] for gauge in range(6)])
    rows = [b"".join(frame.data for frame in send(device, f"{base + 2:03X}#{k:02X}")) for k in range(6)]
    matrix = np.array([np.frombuffer(row, ">f4") for row in rows])
    (per_unit,) = send(device, f"{base + 7:03X}#")
    matrix = matrix / np.repeat(struct.unpack(">II", per_unit.data), 3)[:, None]
    half_a_count = 0.5 * np.abs(matrix).sum(axis=1)
    assert (np.abs(matrix @ gauges - wrench) <= half_a_count + 1e-4).all()


def test_gauges_saturate():
    device = fp.create(NAME)
    sample(device, wrench=[1e9] * 6)
    assert np.abs(device.counts).max() <= 0x8000


@pytest.mark.parametrize(("request_", "counter"), [
    ("206#", "bad_length"), ("202#", "bad_length"), ("202#06", "refused"), ("202#0600", "refused"),
    ("206#10", "refused"), ("209#06", "refused"), ("20A#", "unknown_command"), ("201#", "unknown_command"),
])  # fmt: skip
def test_what_is_no_question_gets_silence(request_, counter):
    device = fp.create(NAME)
    sample(device)
    assert send(device, request_) == [] and device.counters[counter] == 1


def test_motor_drives_on_the_bus_are_not_for_it():
    device = fp.create(NAME, base=0x7F)
    sample(device)
    for text in ("702#00", "000#8200", "701#00"):
        assert send(device, text) == []
    assert device.counters["ignored"] == 3


def status(device: fp.Device) -> int:
    return int.from_bytes(send(device, f"{device.ports[0].filters[0][0]:03X}#")[0].data[:2], "big")


def test_a_slot_without_calibration_is_an_error_until_reset():
    device = fp.create(NAME)
    sample(device)
    assert status(device) == 0
    assert [str(f) for f in send(device, "206#03")] == ["206#03"]
    assert status(device) == 0x8040
    assert send(device, "20C#") == [] and status(device) == 0


def test_another_base_and_baud_rate_are_in_force_from_the_next_power_up_on():
    device = fp.create(NAME)
    sample(device)
    assert [str(f) for f in (*send(device, "20D#7F"), *send(device, "20E#03"))] == ["20D#", "20E#"]
    assert (device.ports[0].filters[0][0], device.ports[0].bitrate) == (0x200, 250_000)
    device.power_cycle()
    sample(device)
    assert (device.ports[0].filters[0][0], device.ports[0].bitrate, device.ports[0].filters) == (
        0x7F0,
        500_000,
        ((0x7F0, 0x7F0),),
    )
    assert len(send(device, "7F0#")) == 2


@pytest.mark.parametrize("request_", ["200#", "202#03", "205#", "206#00", "207#", "208#", "209#02", "20F#"])
def test_bytes_behind_a_request_are_ignored(request_):
    """A published driver sends a byte with every request."""
    device = fp.create(NAME)
    sample(device)
    answer = send(device, request_)
    assert answer and send(device, request_ + "00") == answer
