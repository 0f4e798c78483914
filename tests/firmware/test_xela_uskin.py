"""uSkin: an independent decoder (cantools with a DBC of the published frame table) reads what was felt."""

from pathlib import Path

import cantools
import numpy as np
import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

DBC = cantools.database.load_file(Path(__file__).parents[1] / "data" / "xela_uskin.dbc")


def started(name: str = "xela_uskin", **options) -> fp.Device:
    device = fp.create(name, **options)
    send(device, _transmit(stop=0))
    return device


def _transmit(stop: int) -> fp.CanFrame:
    message = DBC.get_message_by_name("transmit")
    data = message.encode({"command": 7, "stop": stop})
    return fp.CanFrame(arbitration_id=message.frame_id, data=data)


@pytest.mark.parametrize("ids", ["board", "grid"])
def test_cantools_decodes_every_taxel(ids):
    device = started(ids=ids)
    frames = sample(device, np.linspace(0, 3, 16))
    decoded = {f.arbitration_id: DBC.decode_message(f.arbitration_id, f.data) for f in frames}
    assert len(decoded) == len(frames) == 16
    for taxel, counts in enumerate(device.counts):
        ident = 0x710 + taxel if ids == "board" else 0x100 | taxel // 4 << 4 | taxel % 4
        assert decoded[ident] == dict(zip("XYZ", counts.tolist()))
    assert len(set(device.counts[:, 2].tolist())) == 16


def test_grid_generation_is_sent_column_by_column():
    frames = sample(started(ids="grid"))
    assert [f.arbitration_id for f in frames[:5]] == [0x100, 0x110, 0x120, 0x130, 0x101]
    assert frames[-1].arbitration_id == 0x133


def test_a_4x6_is_sent_column_by_column_and_ends_with_135():
    device = started(name="xela_uskin_4x6")
    frames = sample(device, np.linspace(0, 3, 24))
    assert [f.arbitration_id for f in frames] == [0x100 + 16 * row + column for column in range(6) for row in range(4)]
    assert frames[-1].arbitration_id == 0x135
    for frame in frames:
        row, column = frame.arbitration_id >> 4 & 15, frame.arbitration_id & 15
        decoded = DBC.decode_message(frame.arbitration_id, frame.data)
        assert decoded == dict(zip("XYZ", device.counts[6 * row + column].tolist()))


def test_the_third_readers_ids_are_those_of_another_first_id():
    sent = {f.arbitration_id for f in sample(started(name="xela_uskin_4x6", first_id=0x740))}
    assert {0x741, 0x750, 0x754, 0x775} <= sent and max(sent) == 0x775


def test_a_press_raises_z_alone_and_rest_lies_where_the_drivers_expect_it():
    device = started()
    sample(device)
    rest = device.counts
    assert 18_000 <= rest.min() and rest.max() <= 30_000
    assert rest[0].tolist() == [column.rest for column in device.columns]
    sample(device, 1.0)
    assert (device.counts - rest).tolist() == [[0, 0, 5000]] * 16


def test_streams_between_start_and_stop_only():
    device = fp.create("xela_uskin")
    assert not sample(device, 1.0)
    send(device, _transmit(stop=0))
    assert len(sample(device, 1.0)) == 16
    send(device, _transmit(stop=1))
    assert not sample(device, 1.0)


@pytest.mark.parametrize("request_", ["201#0700", "201#070000", "201#07000000000000FF"])
def test_a_start_may_be_longer(request_):
    device = fp.create("xela_uskin")
    send(device, request_)
    assert device.streaming


@pytest.mark.parametrize("request_", ["201#", "201#07", "201#0702", "201##00700", "201#R", "00000201#0700"])
def test_what_is_no_request_changes_nothing(request_):
    device = fp.create("xela_uskin")
    assert not send(device, request_) and not device.streaming
    assert device.counters["unknown_command"] + device.counters["ignored"] == 1


def test_board_number_moves_the_ids():
    device = fp.create("xela_uskin", board=5)
    send(device, "205#0700")
    assert [f.arbitration_id for f in sample(device)] == list(range(0x750, 0x760))
    send(device, _transmit(stop=1))
    assert device.streaming and device.ports[0].filters == ((0x205, 0x7FF),), "board 1's stop is not for board 5"


def test_forces_reach_their_axes_and_saturate():
    device = started(gains=(100.0, 200.0, 300.0))
    force = np.zeros((16, 3))
    force[0], force[1], force[2], force[3] = (1, 0, 0), (0, 1, 0), (0, 0, -1), (0, 0, 1e6)
    sample(device, force=force)
    assert device.counts[:5].tolist() == [
        [25000, 24000, 21000],
        [24000, 26000, 21000],
        [24000, 24000, 18000],
        [24000, 24000, 65535],
        [24000, 24000, 21000],
    ]


@pytest.mark.parametrize("options", [{"ids": "rows"}, {"board": 16}, {"board": 0}, {"gains": (1.0, 2.0)}])
def test_bad_options_are_refused(options):
    with pytest.raises(ValueError, match=next(iter(options))):
        fp.create("xela_uskin", **options)
