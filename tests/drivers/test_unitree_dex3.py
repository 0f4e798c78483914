"""unitree_sdk2py, unmodified, in an environment of its own, reads the hand over DDS, below the whole of tactemu."""

import numpy as np
import pytest

import tactemu
from tests.drivers.rig import assert_consecutive, run_driver

pytest.importorskip("cyclonedds", reason="DDS needs it: pip install 'tactemu[dds]'")
pytestmark = [pytest.mark.driver, pytest.mark.timeout(180)]

LIVE = [pad * 12 + slot for pad in range(9) for slot in ((3, 6, 8) if pad in (1, 3, 5) else (0, 2, 9, 11))]
JUDGE = {"driver": "unitree-sdk2py-dimos", "environment": "unitree_sdk2py", "carrier": "DDS"}


def spread(t_s):
    """A push on each of 33 cells that names the time [N]."""
    forces = np.zeros((33, 3))
    forces[:, 2] = -5 - 4 * np.sin(20 * t_s + np.arange(33))
    return forces


def read(served, count=300, seconds=30, topic="rt/dex3/left/state"):
    domain = served.emulator.wires[0].transport.domain
    arguments = domain, topic, count, seconds
    got = run_driver("unitree_sdk2py", "unitree_sdk2py_read.py", *arguments, environment="unitree_sdk2py")
    pressure = np.reshape(got["pressure"], (-1, 108))
    assert (np.delete(pressure, LIVE, axis=1) == 30_000).all(), "no cell"
    return got, pressure[:, LIVE]


def truth_of(served):
    return [sample.counts for sample in served.truth.samples]


@pytest.mark.judge("unitree_dex3", **JUDGE)
def test_states_and_orders():
    with tactemu.serve("unitree_dex3", source=spread) as dev:
        got, readings = read(dev)
        device = dev.device()
        assert device.counters["requests"] >= 10 and set(device.counters) == {"requests"}
    assert_consecutive(readings, truth_of(dev), count=300)
    assert got["modes"] == [k | 0x10 for k in range(7)]
    np.testing.assert_allclose(got["q"][-1], np.array([0, 1, 2, -3, -4, -5, -6]) / 10, atol=0.01)
    assert got["temperature"] == [25.0] * 12 and got["quaternion"] == [1, 0, 0, 0]


@pytest.mark.judge("unitree_dex3", **JUDGE)
def test_the_slower_copy():
    with tactemu.serve("unitree_dex3", {"lf": "dds:207"}, source=spread) as dev:
        domain = dev.emulator.wires[1].transport.domain
        assert domain == 207 != dev.emulator.wires[0].transport.domain
        arguments = domain, "rt/lf/dex3/left/state", 200, 30
        got = run_driver("unitree_sdk2py", "unitree_sdk2py_read.py", *arguments, environment="unitree_sdk2py")
    assert len(got["q"]) == 200
    assert_consecutive(np.reshape(got["pressure"], (-1, 108))[:, LIVE], truth_of(dev), count=200)


@pytest.mark.judge("unitree_dex3", **JUDGE)
def test_a_hand_that_comes_late_is_gone_for_a_while_and_loses_samples():
    faults = ["drop 10%", "unplug at 6s for 1s", "unplug at 0s for 1s"]
    with tactemu.serve("unitree_dex3", source=spread, faults=faults) as dev:
        _, readings = read(dev, count=1600)
        injected = dev.truth.injected
    assert len(readings) >= 1600 and injected["unplug"] == 2 and injected["drop"] > 100
    assert_consecutive(readings, truth_of(dev), count=1600)
