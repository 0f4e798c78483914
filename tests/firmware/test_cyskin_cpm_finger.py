"""CPM-Finger: a scan of five frames, each taxel at its place in the table, counts that saturate."""

import numpy as np

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

NAME = "cyskin_cpm_finger"


def test_a_scan_is_five_frames_with_the_proximities_last():
    frames = sample(fp.create(NAME))
    assert [f.arbitration_id for f in frames] == [0x405, 0x407, 0x409, 0x40B, 0x601]
    assert [len(f.data) for f in frames] == [8, 8, 8, 8, 4]
    assert frames[0].data == bytes.fromhex("1027" * 4) and frames[4].data.hex() == "0000ffff"


def test_the_pressed_taxel_is_at_its_place():
    for taxel, (frame, place) in ((11, (0, 0)), (0, (3, 1)), (7, (2, 1)), (1, (3, 3))):
        newtons = np.zeros(16)
        newtons[taxel] = 1.0
        frames = sample(fp.create(NAME, rest=0), newtons)
        sent = np.array([np.frombuffer(f.data, "<u2") for f in frames[:4]])
        assert np.argwhere(sent).tolist() == [[frame, place]] and sent.max() == 200


def test_counts_saturate_and_a_host_is_not_heard():
    device = fp.create(NAME)
    sample(device, 1e9)
    assert set(device.counts.tolist()) == {0xFFFF}
    sample(device, -1e9)
    assert set(device.counts.tolist()) == {0}
    assert send(device, "405#00") == [] and device.counters["ignored"] == 1
