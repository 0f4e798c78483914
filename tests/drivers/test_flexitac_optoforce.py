"""flexitac 0.3.1 and optoforce 0.3.0, unmodified, on a bare pty."""

import numpy as np
import pytest

import firmware_protocols as fp
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [pytest.mark.driver, pytest.mark.timeout(90)]

SCALE = np.array([1 / 7925 * 300, 1 / 8641 * 300, 1 / 6049 * 2000])
"""The driver's own constants, in its order of operations."""


@pytest.mark.judge("flexitac", driver="flexitac", carrier="serial, marker")
@pytest.mark.parametrize("rows", [12, 16])
def test_flexitac(rows):
    # Taxels stay below AA: the driver may not meet its marker inside an image (see the device's docstring).
    with Rig(fp.create("flexitac", rows=rows), peak=1.5) as rig:
        frames = run_driver("flexitac", "flexitac_read.py", rig.port, rows)
    # It asks for 1024 bytes and takes one frame from them, so it falls behind and drops old bytes by itself.
    assert_consecutive(frames, rig.truth)


@pytest.mark.judge("optoforce", driver="optoforce", carrier="USB serial, packets")
@pytest.mark.parametrize(("axes", "kind"), [("3", "OptoForce16"), ("4x3", "OptoForce34"), ("6", "OptoForce22")])
def test_optoforce(axes, kind):
    with Rig(fp.create("optoforce", axes=axes), peak=900.0) as rig:
        packets = run_driver("optoforce", "optoforce_read.py", rig.port, kind)
    assert all(packet["valid_checksum"] and packet["status"] == 0 for packet in packets)
    counters = [packet["count"] for packet in packets]
    assert counters == list(range(counters[0], counters[0] + 200))
    values = [[v for name, v in packet.items() if name[0] in "FT"] for packet in packets]

    def decoded(counts):
        return np.concatenate([counts[:, :3] * SCALE, counts[:, 3:]], axis=1).reshape(-1)

    assert_consecutive(values, rig.truth, decode=decoded)
    assert rig.device.period_ns == 3_000_000 and rig.device.counters["requests"] == 1
