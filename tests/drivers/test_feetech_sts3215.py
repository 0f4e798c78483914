"""feetech-servo-sdk 1.0.0, unmodified, on a bare pty: six servos, what they feel of loads, and an arm that is led."""

import json
import subprocess
import sys

import numpy as np
import pytest

import firmware_protocols as fp
import tactemu
from firmware_protocols.check.readings import reading_of
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [pytest.mark.driver, pytest.mark.timeout(90)]
JUDGE = {"driver": "feetech-servo-sdk", "carrier": "RS-485, Feetech"}


class Loaded(Rig):
    """Every sample another load on every shaft."""

    def reading(self, stream):
        return reading_of(self.device, 0.0, stream, load=self._random.uniform(-2.0, 2.0, 6))


def as_sent(loads):
    """Sign and magnitude, sign in bit 10."""
    return np.abs(loads) | (loads < 0) << 10


@pytest.mark.judge("feetech_sts3215", **JUDGE, every_run=True)
def test_200_readings_of_six_loads():
    device = fp.create("feetech_sts3215")
    device.period_ns = 3_000_000
    with Loaded(device) as rig:
        got = run_driver("scservo_sdk", "feetech_read.py", rig.port)
    places = assert_consecutive(got["loads"], rig.truth, decode=as_sent)
    assert len(set(places)) > 20, "the loads changed in between"
    assert got["models"] == [777] * 6
    assert got["offset"] == [2388] * 6, "encoder 2048, offset -340"
    assert got["waiting"] == [0] * 5 + [1]
    assert got["there"] == [1100, 1200, 1300, 1400, 1500, 2048]
    assert got["error"] == 32, "overload"
    assert device.ports[0].baud == 500_000 and device.flash["0"]["baud"] == [1]
    assert device.counters["refused"] == device.counters["bad_checksum"] == 0


LEAD = """
import json, sys, time
import scservo_sdk as sdk
def opened(name):
    port = sdk.PortHandler(name)
    assert port.openPort() and port.setBaudRate(1_000_000)
    return port
handler, (leader, follower) = sdk.PacketHandler(0), map(opened, sys.argv[1:])
def asked(port):  # a busy machine is late for the SDK's time-out: again
    group = sdk.GroupSyncRead(port, handler, 56, 2)
    assert all(group.addParam(ident) for ident in range(1, 7))
    while group.txRxPacket() != 0:
        pass
    return [group.getData(ident, 56, 2) for ident in range(1, 7)]
for ident in range(1, 7):
    while handler.write1ByteTxRx(follower, ident, 40, 1)[0] != 0:
        pass
led, followed = [], []
for _ in range(200):
    goals = asked(leader)
    group = sdk.GroupSyncWrite(follower, handler, 42, 2)
    assert all(group.addParam(ident, [goal & 255, goal >> 8]) for ident, goal in zip(range(1, 7), goals))
    assert group.txPacket() == 0
    led.append(goals), time.sleep(0.015), followed.append(asked(follower))
print(json.dumps([led, followed]))
"""

ARMS = """
[[body]]
name = "table"
shape = "frame"
fixed = true

[[skin]]
name = "leader"
device = "feetech_sts3215"
link = "table"
device_options = { swing = 0.5 }

[[skin]]
name = "follower"
device = "feetech_sts3215"
link = "table"
"""


@pytest.mark.realtime
def test_a_follower_goes_where_a_leader_is_led(tmp_path):
    scene = tmp_path / "arms.toml"
    scene.write_text(ARMS)
    with tactemu.serve(scene) as dev:
        ports = [dev.ports["leader"], dev.ports["follower"]]
        done = subprocess.run(
            [sys.executable, "-c", LEAD, *ports], capture_output=True, text=True, timeout=80, check=False
        )
    assert done.returncode == 0, done.stderr
    led, followed = map(np.array, json.loads(done.stdout))
    assert np.ptp(led, axis=0).min() > 100, "a hand swings every joint"
    assert np.abs(led - followed).max() < 80, "and they follow, 20 ms behind"
