"""uSkin: an independent decoder (cantools with a DBC of the published frame table) reads what was felt."""

from pathlib import Path

import cantools
import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols.magnetic import LinearMagnet
from tests.firmware.feeding import push

DBC = cantools.database.load_file(Path(__file__).parents[1] / "data" / "xela_uskin.dbc")


def started(**options) -> fp.Device:
    device = fp.create("xela_uskin", **options)
    device.power_on(0)
    device.receive(_transmit(stop=0), 0)
    return device


def _transmit(stop: int) -> fp.CanFrame:
    message = DBC.get_message_by_name("transmit")
    data = message.encode({"command": 7, "stop": stop})
    return fp.CanFrame(arbitration_id=message.frame_id, data=data)


@pytest.mark.parametrize("ids", ["board", "grid"])
def test_cantools_decodes_every_taxel(ids):
    device = started(ids=ids)
    frames = device.sample(push(device, np.linspace(0, 3, 16)), 0)
    decoded = {f.arbitration_id: DBC.decode_message(f.arbitration_id, f.data) for f in frames}
    assert len(decoded) == len(frames) == 16
    for taxel, counts in enumerate(device.counts):
        ident = 0x710 + taxel if ids == "board" else 0x100 | taxel // 4 << 4 | taxel % 4
        assert decoded[ident] == dict(zip("XYZ", counts.tolist()))
    assert len(set(device.counts[:, 2].tolist())) == 16


def test_grid_generation_is_sent_column_by_column():
    frames = started(ids="grid").sample(push(started(), 0.0), 0)
    assert [f.arbitration_id for f in frames[:5]] == [0x100, 0x110, 0x120, 0x130, 0x101]
    assert frames[-1].arbitration_id == 0x133


def test_rest_lies_where_the_drivers_expect_it():
    device = started()
    device.sample(push(device, 0.0), 0)
    assert 18_000 <= device.counts.min() and device.counts.max() <= 30_000


def test_streams_between_start_and_stop_only():
    device = fp.create("xela_uskin")
    assert not device.sample(push(device, 1.0), 0)
    device.receive(_transmit(stop=0), 0)
    assert len(device.sample(push(device, 1.0), 1)) == 16
    device.receive(_transmit(stop=1), 2)
    assert not device.sample(push(device, 1.0), 3)


def test_board_number_moves_the_ids():
    device = fp.create("xela_uskin", board=5)
    device.receive(fp.CanFrame(arbitration_id=0x205, data=b"\x07\x00"), 0)
    assert [f.arbitration_id for f in device.sample(push(device, 0), 0)] == list(range(0x750, 0x760))
    assert not device.receive(_transmit(stop=1), 0) and device.streaming, "board 1's stop is not for board 5"


def test_forces_reach_their_axes_and_saturate():
    device = started(transducer=LinearMagnet(gain=(100.0, 100.0, 100.0), offset=(3000.0, 3000.0, 3000.0)))
    force = np.zeros((16, 3))
    force[0], force[1], force[2], force[3] = (1, 0, 0), (0, 1, 0), (0, 0, -1), (0, 0, 1e6)
    device.sample(fp.Reading(t_ns=0, values=force), 0)
    assert device.counts[:5].tolist() == [
        [31000, 30000, 30000],
        [30000, 31000, 30000],
        [30000, 30000, 29000],
        [30000, 30000, 65535],
        [30000, 30000, 30000],
    ]


@pytest.mark.parametrize("options", [{"ids": "rows"}, {"board": 16}, {"board": 0}])
def test_bad_options_are_refused(options):
    with pytest.raises(ValueError, match=next(iter(options))):
        fp.create("xela_uskin", **options)
