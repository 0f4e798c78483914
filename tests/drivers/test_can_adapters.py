"""python-can's clients of CAN adapters read a device on the bus behind one."""

import numpy as np
import pytest

import tactemu
from tests.drivers.rig import assert_consecutive, run_driver

pytestmark = [pytest.mark.driver, pytest.mark.timeout(120)]


def spread(t_s):
    """A push on each taxel that names the time [N]."""
    forces = np.zeros((16, 3))
    forces[:, 2] = -5 - 4 * np.sin(20 * t_s + np.arange(16))
    return forces


@pytest.mark.judge("xela_uskin", driver="python-can", carrier="interface")
@pytest.mark.parametrize("interface", ["slcan", "socketcand"])
def test_python_can(interface, tmp_path):
    port = f"slcan:{tmp_path}/can" if interface == "slcan" else "socketcand:0"
    with tactemu.serve("xela_uskin", port, source=spread) as dev:
        channel, where = (dev.port, "-") if interface == "slcan" else ("can0", dev.port.removeprefix("socketcand://"))
        got = run_driver("can", "python_can_read.py", interface, channel, where, 220)
        dev.wait(0.1)
        assert not dev.device().streaming, "stopped"
    assert_consecutive(got, [sample.counts for sample in dev.truth.samples], count=220)
