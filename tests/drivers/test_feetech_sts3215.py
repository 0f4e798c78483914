"""feetech-servo-sdk 1.0.0 and the motor bus of lerobot 0.4.4, unmodified: six servos, loads, an arm that is led."""

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
    assert np.median(np.abs(led - followed)) < 80, "and they follow, 20 ms behind, on a busy machine now and then more"


LEROBOT = {"driver": "lerobot", "environment": "lerobot", "carrier": "RS-485, Feetech"}


@pytest.mark.judge("feetech_sts3215", **LEROBOT)
def test_lerobot_s_bus_reads_200_loads():
    device = fp.create("feetech_sts3215")
    device.period_ns = 3_000_000
    with Loaded(device) as rig:
        got = run_driver("lerobot", "lerobot_bus_read.py", rig.port, environment="lerobot")
    places = assert_consecutive(got, rig.truth)
    assert len(set(places)) > 20, "the loads changed in between"


@pytest.mark.judge("feetech_sts3215", **LEROBOT)
def test_lerobot_calibrates_a_leader_and_a_follower_follows_it(tmp_path):
    scene = tmp_path / "arms.toml"
    scene.write_text(ARMS)
    with tactemu.serve(scene) as dev:
        ports = [dev.ports["leader"], dev.ports["follower"]]
        got = run_driver("lerobot", "lerobot_bus_read.py", *ports, seconds=80, environment="lerobot")
    assert got["found"] == {str(ident): 777 for ident in range(1, 7)}
    assert got["calibrated"] and all(600 < span <= 653 for span in got["ranges"]), "0.5 rad to either side"
    led, followed = np.array(got["led"]), np.array(got["followed"])
    assert np.ptp(led, axis=0).min() > 100 and np.percentile(np.abs(led - followed)[40:], 90) < 80
    assert all(-30 < got["degrees"][name] < 30 for name in list(got["degrees"])[:5])
    assert 0 <= got["degrees"]["gripper"] <= 100
    assert set(got["torque"].values()) == {1}
    assert got["scanned"] == {"1000000": [1, 2, 3, 4, 5, 6]}, "at its own speed, and at no other"
