"""An SO-101 arm whose servos close its gripper on a soft box and lift it, as a hand leads the leader; by a script."""

# MuJoCo's functions come from a compiled module that a checker cannot see into.
# pyright: reportAttributeAccessIssue=false

from functools import partial

import numpy as np
import pytest

import firmware_protocols as fp
from tactemu.base.clock import VirtualClock
from tactemu.emulator.assembly import assemble
from tactemu.emulator.options import AssemblyOptions
from tactemu.scene import file
from tactemu.scene.steering import steered
from tests.hands.holding import HANDS, contact_forces
from tests.hands.test_gripper import MS, packet

LIFT, GRIPPER, STEPS = 2, 6, 4096 / (2 * np.pi)
PADS = ("fixed_pad", "moving_pad")


def test_the_jaws_grasp_and_the_arm_lifts():
    whole = assemble(steered(file.load(HANDS / "so101.toml")), AssemblyOptions(port="memory:"), clock=VirtualClock())
    emulator, engine = whole.emulator, whole.simulation.posers[0].__self__
    write = emulator.channels[0].wire.transport.driver.write
    box, orders = engine.data.body("object"), [(0.01 * k, k, 40, 1) for k in range(1, 7)]
    orders += [(0.1, LIFT, 42, round(2048 - 0.03 * STEPS)), (0.1, GRIPPER, 42, round(2048 - 0.1 * STEPS))]
    orders += [(0.6 + 0.01 * k, GRIPPER, 42, round(2048 + (0.025 * k - 0.1) * STEPS)) for k in range(11)]
    orders += [(1.0 + 0.01 * k, LIFT, 42, round(2048 + (0.002 * k - 0.03) * STEPS)) for k in range(31)]
    with emulator:
        for t_s, servo, register, value in orders:
            emulator.at(round(t_s * 1e3) * MS, partial(write, packet(servo, register, value)))
        emulator.run(0.5)
        rest = box.xpos[2]
        assert contact_forces(engine, PADS).max() == 0, "open"
        emulator.run(1.5)
        lifted, pressed = box.xpos[2] - rest, contact_forces(engine, PADS)
        felt = [pad.skin_force() for pad in engine.pads.values()]
    assert lifted > 0.01
    assert pressed.min() > 2.0
    np.testing.assert_allclose(felt, pressed, rtol=0.05)


def test_a_hand_moves_some_servos_of_a_leader():
    arm = fp.create("feetech_sts3215", swing=(0.0, 0.02, 0.0, 0.0, 0.0, 0.15))
    places = np.array([list(arm.joints(t_ns).values()) for t_ns in range(0, 4000 * MS, 50 * MS)])
    assert np.ptp(places, axis=0) == pytest.approx([0, 0.04, 0, 0, 0, 0.3], abs=0.002)
