"""fulai-tactile 1.0.5, unmodified, on a bare pty."""

import numpy as np
import pytest

import firmware_protocols as fp
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [pytest.mark.driver, pytest.mark.timeout(90)]


@pytest.mark.parametrize(
    ("hardware", "hand", "identity"), [("3.0", "right", True), ("3.1", "left", True), ("3.2", "left", True), ("3.1", "right", False)]
)
def test_every_version(hardware, hand, identity):
    device = fp.create("fulai_glove", hardware=hardware, hand=hand, identity=identity)
    with Rig(device) as rig:
        got = run_driver("fulai_tactile", "fulai_tactile_read.py", rig.port)
    assert got["identity"] == ([True, "1.0", hardware, hand.upper()] if identity else [False, "", "", "RIGHT"])
    assert got["malformed"] == 0 and device.counters["unknown_command"] == (0 if identity else 1)
    slots = np.concatenate([zone[0] + np.arange(max(zone[3:]) + 1) for zone in got["cells"]])
    frames = np.array(got["frames"])
    assert_consecutive(frames[:, slots], rig.truth)
    assert not np.delete(frames, slots, axis=1).any(), "slots without a taxel"


@pytest.mark.parametrize("hand", ["left", "right"])
@pytest.mark.parametrize("hardware", ["3.0", "3.1", "3.2"])
def test_taxels_lie_where_the_driver_draws_them(hardware, hand):
    """Its map of each zone, rows from the top, against our positions."""
    layout_of = pytest.importorskip("fulai_tactile.layout")
    types = pytest.importorskip("fulai_tactile.types")
    version = types.GloveVersion(int(hardware.replace(".", "")))
    layout = fp.create("fulai_glove", hardware=hardware, hand=hand).layout
    drawn = layout_of.zone_layout(version, types.Hand[hand.upper()])
    for zone, patch in zip(drawn, layout.patches, strict=True):
        cells = np.array(zone.cell_map).reshape(zone.rows, zone.columns)
        rows, cols = (np.argsort(cells.ravel())[-zone.count :] // zone.columns, np.argsort(cells.ravel())[-zone.count :] % zone.columns)
        x, y, _ = layout.positions[patch.taxels].T / patch.pitch
        assert np.allclose(x - x.min(), cols - cols.min()) and np.allclose(y.max() - y, rows), patch.name
