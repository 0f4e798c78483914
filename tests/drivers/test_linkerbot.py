"""linkerbot 0.5.4, unmodified, over ``udp_multicast``: L6, O6, L25; as an L20 Lite the L10; as an L25 L20 and G20."""

import numpy as np
import pytest

import firmware_protocols as fp
import tactemu
from tests.drivers.can_link import INTERFACE
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [pytest.mark.driver, pytest.mark.timeout(90)]


def judge(name, *rest, **more):
    """A case that judges the hand ``name``."""
    mark = pytest.mark.judge(f"linker_hand_{name}", driver="linkerbot", carrier="CAN", **more)
    return pytest.param(name, *rest, marks=mark)


@pytest.mark.parametrize(
    ("name", "model", "side", "serial"),
    [
        judge("l6", "L6", "left", "LHL6-03-001-L-B-1-A", every_run=True),
        judge("o6", "O6", "right", "LHO6-03-001-R-F-1-A"),
        judge("l10", "L20lite", "left", "LHL10-03-001-L-B-1-A"),
        judge("l25", "L25", "right", "LHL25-010-001-R-B-1-A"),
        judge("l20", "L25", "left", "LHL20-010-001-L-B-1-A"),
        judge("g20", "L25", "left", "LHG20-010-001-L-B-1-A"),
    ],
)
def test_identity_and_200_readings_of_every_finger(name, model, side, serial):
    device = fp.create(f"linker_hand_{name}", side=side, **({"hardware": "V10"} if name == "l20" else {}))
    with Rig(device, kind="can", peak=0.5) as rig:
        got = run_driver("linkerbot", "linkerbot_read.py", model, side, rig.port, INTERFACE, 200, seconds=60)
    assert got["serial"] == serial
    assert (got["firmware"], got["mechanical"], got["pcb"]) == ("V1.2.3", "V2.0.1", "V1.0.4")
    readings = np.array(got["readings"])
    assert readings.shape == (200, 5, *device.touch.finger) and readings.std() > 50
    for finger, patch in enumerate(device.layout.patches[:5]):
        assert_consecutive(
            readings[:, finger],
            rig.truth,
            decode=lambda counts, taxels=patch.taxels: counts[taxels].reshape(device.touch.finger),
        )


@pytest.mark.parametrize(
    "port", [None, pytest.param("can:socketcan:vcan0", marks=pytest.mark.vcan)], ids=["udp_multicast", "vcan"]
)
@pytest.mark.parametrize("name", [judge("l6"), judge("o6")])
def test_a_press_reaches_the_driver_as_it_was_felt(name, port):
    """Simulation, device, wire and bus; the middle finger is pressed."""
    with tactemu.serve(f"linker_hand_{name}", port) as dev:
        dev.wait(0.05)
        dev.press(depth=5e-4, speed=0.1)
        bus = dev.can
        got = run_driver(
            "linkerbot", "linkerbot_read.py", name.upper(), "left", bus["channel"], bus["interface"], 50, seconds=60
        )
        truth = {sample.counts.astype(np.uint8).tobytes() for sample in dev.truth.samples}
    readings = np.array(got["readings"], np.uint8)
    assert len(readings) == 50 and all(reading.tobytes() in truth for reading in readings)
    assert readings[-1, 2].max() > 20, "the middle finger feels it"
    assert np.array(got["snapshot"], np.uint8).tobytes() in truth, "what the SDK's own polling collects"
