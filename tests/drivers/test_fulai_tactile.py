"""fulai-tactile 1.0.5, unmodified, on a bare pty."""

import numpy as np
import pytest

import firmware_protocols as fp
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [
    pytest.mark.judge("fulai_glove", driver="fulai-tactile", carrier="USB serial, marker"),
    pytest.mark.driver,
    pytest.mark.timeout(90),
]


@pytest.mark.parametrize(
    ("hardware", "hand", "identity"),
    [("3.0", "right", True), ("3.1", "left", True), ("3.2", "left", True), ("3.1", "right", False)],
)
def test_every_version(hardware, hand, identity):
    device = fp.create("fulai_glove", hardware=hardware, hand=hand, identity=identity)
    # Taxels stay below 1022: behind a slot without a taxel that would look like the tail (see the device's docstring).
    with Rig(device, peak=0.25) as rig:
        got = run_driver("fulai_tactile", "fulai_tactile_read.py", rig.port)
    assert got["identity"] == ([True, "3.5.0", hardware, hand.upper()] if identity else [False, "", "", "RIGHT"])
    assert got["malformed"] == device.counters["unknown_command"] == 0
    slots = np.concatenate([zone[0] + np.arange(max(zone[3:]) + 1) for zone in got["cells"]])
    frames = np.array(got["frames"])
    assert_consecutive(frames[:, slots], rig.truth)
    assert not np.delete(frames, slots, axis=1).any(), "slots without a taxel"


@pytest.mark.parametrize("hand", ["left", "right"])
@pytest.mark.parametrize("hardware", ["3.0", "3.1", "3.2"])
def test_taxels_lie_where_the_driver_draws_them(hardware, hand):
    """Its map of each zone, the number of the taxel or -1 in each cell, rows from the top."""
    zone_layout = pytest.importorskip("fulai_tactile.layout").zone_layout
    types = pytest.importorskip("fulai_tactile.types")
    zones = zone_layout(types.GloveVersion(int(hardware.replace(".", ""))), types.Hand[hand.upper()])
    layout = fp.create("fulai_glove", hardware=hardware, hand=hand).layout
    for zone, patch in zip(zones, layout.patches, strict=True):
        cells = np.array(zone.cell_map).reshape(zone.rows, zone.columns)
        row, col = np.array([np.argwhere(cells == number)[0] for number in range(zone.count)]).T
        x, y, _ = layout.positions[patch.taxels].T / patch.pitch
        assert np.allclose(x - x.min(), col - col.min()) and np.allclose(y.max() - y, row), patch.name


def test_a_tail_within_a_frame_costs_that_frame():
    decoder = pytest.importorskip("fulai_tactile.decoder").Decoder()
    device, whole = fp.create("fulai_glove", baseline=0), []
    for k in range(10):
        device.counts = np.zeros(len(device.layout), int)
        device.counts[[6, 7]] = (0 if k == 5 else 1), 4088
        decoder.append(device.stream(0, "")[0], lambda raw, timestamp: whole.append(raw))
    assert decoder.stats.malformed_frames == 2, "two pieces"
    assert decoder.stats.parsed_frames == 8, "all others but the first, by whose tail it begins"
