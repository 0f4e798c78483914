"""i2cdriver 1.0.6, unmodified, reads a SingleTact on I2C through its own adapter, below the whole of tactemu."""

import numpy as np
import pytest

import tactemu
from tests.drivers.rig import assert_consecutive, run_driver

pytestmark = [pytest.mark.driver, pytest.mark.timeout(90)]


def push(t_s):
    """A push that names the time [N]."""
    return np.array([[0.0, 0.0, -5 - 4 * np.sin(20 * t_s)]])


@pytest.mark.judge("singletact", driver="i2cdriver", carrier="I2C", every_run=True)
def test_i2cdriver(tmp_path):
    options = {"board": "none", "address": 9, "serial": 0x1234}
    with tactemu.serve("singletact", f"i2cdriver:{tmp_path}/i2c", device_options=options, source=push) as dev:
        got = run_driver("i2cdriver", "i2cdriver_singletact.py", dev.port, 220)
        truth = [int(sample.counts[0]) for sample in dev.truth.samples]
        counters = dev.device().counters
    assert got["found"] == [4] and not counters["refused"], "all pads answer to 4, and none to 5"
    settings = got["settings"]
    assert len(settings) == 128 and settings[:5] == [9, 0, 0, 0x12, 0x34] and settings[10:14] == [0, 100, 1, 1]
    numbers = [high << 8 | low for high, low, *_ in got["readings"]]
    values = [high << 8 | low for *_, high, low in got["readings"]]
    assert values == [truth[number - 1] for number in numbers]
    high, low, *_, last, end = got["unasked"]
    assert last << 8 | end == truth[(high << 8 | low) - 1], "a read without a request is of the data"
    assert_consecutive(values, [np.array(value) for value in truth])
