"""cantools, with a DBC written from the published table, reads the OmniHand Pro over CAN-FD."""

from pathlib import Path

import numpy as np
import pytest

import firmware_protocols as fp
import tactemu
from tests.drivers.can_link import INTERFACE
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [
    pytest.mark.judge("agibot_omnihand_pro", driver="cantools", carrier="CAN-FD"),
    pytest.mark.driver,
    pytest.mark.timeout(90),
]
DBC = Path(__file__).parents[1] / "data" / "agibot_omnihand_pro.dbc"
FINGERS = ("thumb", "index", "middle", "ring", "little")
CHANNELS = [f"channel_{k}" for k in range(9)]


def ask(channel, interface, count):
    return run_driver("cantools", "cantools_read.py", DBC, channel, interface, count, 64, *FINGERS, seconds=60)


def test_200_readings_of_every_finger():
    device = fp.create("agibot_omnihand_pro")
    with Rig(device, kind="can", peak=30.0) as rig:
        got = ask(rig.port, INTERFACE, 200)
    assert np.std([[reading[0]["channel_3"]] for reading in got]) > 1000
    for finger, patch in enumerate(device.layout.patches):
        readings = [[one[finger][name] for name in (*CHANNELS, "normal", "tangential", "angle")] for one in got]
        assert_consecutive(
            readings,
            rig.truth,
            decode=lambda counts, rows=patch.taxels: [*counts[rows, 0], *counts[rows][0, 1:] * [0.1, 0.1, 1]],
        )
        assert {one[finger]["online"] for one in got} == {1}


@pytest.mark.parametrize(
    "port", [None, pytest.param("can:socketcan:vcan0", marks=pytest.mark.vcan)], ids=["udp_multicast", "vcan"]
)
def test_a_press_comes_over_the_bus_in_frames_of_32_bytes_with_two_bit_rates(port):
    """Simulation, device, wire and bus; the thumb is pressed."""
    with tactemu.serve("agibot_omnihand_pro", port) as dev:
        dev.wait(0.05)
        dev.press(depth=5e-4, speed=0.1)
        got = ask(dev.can["channel"], dev.can["interface"], 20)
        truth = {tuple(sample.counts[:9, 0].tolist()) for sample in dev.truth.samples}
        sent = [frame for *_, frame in dev.truth.frames]
    thumb = [tuple(reading[0][name] for name in CHANNELS) for reading in got]
    assert set(thumb) <= truth and max(thumb[-1]) > 100, "the thumb feels it"
    assert len(sent) == 100 and all(frame.is_fd and frame.bitrate_switch and len(frame.data) == 32 for frame in sent)
