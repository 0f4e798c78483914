"""LeRobot's motor bus: on one port reads loads 200 times; on two calibrates a leader that is led by hand, and has a
follower go where it is, 200 times.

The bus imports one file that imports torch, accelerate and datasets, which it never uses: they are stood in for.
"""

import json
import sys
import time
import types


class StandIn(types.ModuleType):
    """A module of which anything can be imported."""

    def __getattr__(self, name):
        if name.startswith("__"):
            raise AttributeError(name)
        return type(name, (), {})


for name in ("torch", "accelerate", "datasets", "datasets.utils", "datasets.utils.logging"):
    sys.modules[name] = StandIn(name)

from lerobot.motors import Motor, MotorCalibration, MotorNormMode  # noqa: E402
from lerobot.motors.feetech import FeetechMotorsBus, OperatingMode  # noqa: E402

NAMES = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
RETRIES = 20  # a busy machine is late for the SDK's time-out


def bus(port, calibration=None):
    modes = [MotorNormMode.DEGREES] * 5 + [MotorNormMode.RANGE_0_100]
    motors = {name: Motor(k + 1, "sts3215", modes[k]) for k, name in enumerate(NAMES)}
    return FeetechMotorsBus(port, motors, calibration)


def again(ask, *args):
    """What the bus asks without retries, until it is answered in time."""
    for _ in range(RETRIES):
        try:
            return ask(*args)
        except (ConnectionError, RuntimeError) as error:
            late = error
    raise late


def connected(port):
    arm = bus(port)
    try:
        arm.connect()
    except BaseException:
        arm.port_handler.closePort()
        raise
    return arm


def position(bus, normalize=False):
    return bus.sync_read("Present_Position", normalize=normalize, num_retry=RETRIES)


if len(sys.argv) == 2:
    arm = again(connected, sys.argv[1])
    loads = [arm.sync_read("Present_Load", normalize=False, num_retry=RETRIES) for _ in range(200)]
    print(json.dumps([[row[name] for name in NAMES] for row in loads]))
    sys.exit()

leader, follower = (again(connected, port) for port in sys.argv[1:])
got = {"found": leader.broadcast_ping(num_retry=RETRIES)}

leader.disable_torque(num_retry=RETRIES)
for name in NAMES:
    leader.write("Operating_Mode", name, OperatingMode.POSITION.value, num_retry=RETRIES)
offsets = again(leader.set_half_turn_homings)
first = position(leader)
low, high = dict(first), dict(first)
end = time.monotonic() + 4.5
while time.monotonic() < end:
    for name, value in position(leader).items():
        low[name], high[name] = min(low[name], value), max(high[name], value)
calibration = {name: MotorCalibration(k + 1, 0, offsets[name], low[name], high[name]) for k, name in enumerate(NAMES)}
again(leader.write_calibration, calibration)
got["calibrated"] = again(lambda: leader.is_calibrated)
got["ranges"] = [high[name] - low[name] for name in NAMES]

again(follower.write_calibration, {name: MotorCalibration(k + 1, 0, 0, 0, 4095) for k, name in enumerate(NAMES)})
follower.disable_torque(num_retry=RETRIES)
again(follower.configure_motors)
follower.enable_torque(num_retry=RETRIES)
got["led"], got["followed"] = [], []
for _ in range(200):
    goals = position(leader)
    follower.sync_write("Goal_Position", goals, normalize=False, num_retry=RETRIES)
    time.sleep(0.01)
    got["led"].append([goals[name] for name in NAMES])
    got["followed"].append([position(follower)[name] for name in NAMES])
got["degrees"] = position(leader, normalize=True)
got["torque"] = follower.sync_read("Torque_Enable", normalize=False, num_retry=RETRIES)
for arm in (leader, follower):
    arm.disable_torque(num_retry=RETRIES)
    arm.disconnect(disable_torque=False)
got["scanned"] = FeetechMotorsBus.scan_port(sys.argv[1])
print(json.dumps(got))
