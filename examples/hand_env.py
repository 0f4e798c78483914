"""A vector environment of a hand with touch: MuJoCo Warp or Newton simulates the motion, tactemu the taxels, and torch
runs the policy, all on one device.

    pip install 'tactemu[newton]' torch  # or tactemu[mujoco-warp]
    python examples/hand_env.py --envs 4096 --device cuda:0
    python examples/hand_env.py --envs 4096 --device cuda:0 --engine newton --steps 10000

The interface is that of ``gymnasium.vector.VectorEnv``; ``step`` resets the environments that end. No part of a step
waits for the device.
"""

import argparse
import os
import time
from pathlib import Path

import numpy as np
import torch
import warp as wp

import tactemu as tt

ENGINES = {"mujoco-warp": tt.MujocoWarpEngine, "newton": tt.NewtonEngine}
HAND = Path(__file__).parent / "hands" / "ability_hand_motors.xml"
JOINTS = "index", "middle", "ring", "pinky", "thumb_flexor", "thumb_rotator"
PAD = np.stack([*np.meshgrid(np.linspace(-5e-3, 5e-3, 6), np.linspace(-8e-3, 8e-3, 6)), np.full((6, 6), 4e-3)], -1)
CLOSED = 1.4, 1.4, 1.4, 1.4, 1.0, 0.0  # [rad]
TARGET_FORCE_N, MAX_STEPS, DROP_HEIGHT_M = 2.0, 250, 0.03


class HandEnv:
    """A task: hold a ball with :data:`TARGET_FORCE_N` on the fingertips. Actions are angles of :data:`JOINTS` [rad]."""

    def __init__(self, num_envs: int, device: str, engine: str = "mujoco-warp"):
        self.num_envs = num_envs
        scene = tt.Scene(dt=4e-3)
        self.engine = ENGINES[engine](scene, HAND)
        model = self.engine.source
        fingers = [f"{joint.removesuffix('_flexor')}_tip" for joint in JOINTS[:5]]
        about = {"probe_local_pos": PAD, "probe_radius": 1.5e-3, "normal_stiffness": 200.0}
        taxels = tt.KinematicTaxel(**about, track_link_idx=(model.body_of("object").index,))
        skins = [scene.add_sensor(taxels, link=model.body_of(tip)) for tip in fingers]
        self.sim = scene.build(num_envs, device=device)
        self.touch = [torch.from_dlpack(skin.arrays.force) for skin in skins]  # the steps write into them
        self.positions = torch.from_dlpack(self.engine.positions)
        columns = [model.column(joint) for joint in JOINTS]
        if engine == "newton":  # one row has the target of each position of all environments
            targets, motors = self.engine.control.joint_target_q, columns
        else:
            targets, motors = self.engine.data.ctrl, [self.engine.model.actuator(joint).id for joint in JOINTS]
        self.targets = torch.from_dlpack(targets).view(num_envs, -1)
        self.motors = torch.tensor(motors, device=self.targets.device)
        self.joints = torch.tensor(columns, device=self.targets.device)
        ball = model.column("object")
        self.ball = self.positions[:, ball : ball + 3]
        self.age = torch.zeros(num_envs, dtype=torch.int32, device=self.targets.device)

    def observation(self) -> torch.Tensor:
        """Return angles [rad], the ball's position [m] and the normal force on each taxel [N]: ``(num_envs, 189)``."""
        normal = [force[..., 2].flatten(1) for force in self.touch]
        return torch.cat([self.positions[:, self.joints], self.ball, *normal], dim=1)

    def reset(self):
        self.sim.reset()
        self.age.zero_()
        return self.observation(), {}

    def step(self, actions: torch.Tensor):
        self.targets[:, self.motors] = actions
        self.sim.step()
        self.age += 1
        force = torch.stack([force[..., 2].abs().flatten(1).sum(1) for force in self.touch]).sum(0)
        terminated, truncated = self.ball[:, 2] < DROP_HEIGHT_M, self.age >= MAX_STEPS
        done = terminated | truncated
        self.sim.reset(done)
        self.age.masked_fill_(done, 0)
        return self.observation(), -(force - TARGET_FORCE_N).abs(), terminated, truncated, {"force": force}


def memory(device: wp.Device) -> str:
    """Return the memory in use by the process and on the GPU, as text."""
    with open("/proc/self/statm") as file:
        used = f"{int(file.read().split()[1]) * os.sysconf('SC_PAGESIZE') / 1e6:.0f} MB"
    return (
        f"{used} and {(device.total_memory - device.free_memory) / 1e6:.0f} MB of the GPU" if device.is_cuda else used
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description="Closes a hand in many environments; prints the speed and the force on the fingertips."
    )
    parser.add_argument("--envs", type=int, default=4096)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--engine", choices=ENGINES, default="mujoco-warp")
    args = parser.parse_args()
    env = HandEnv(args.envs, args.device, args.engine)
    observed, _ = env.reset()
    widths = observed.shape[1], 64, len(JOINTS)
    torch.manual_seed(0)
    policy = torch.nn.Sequential(torch.nn.Linear(*widths[:2]), torch.nn.Tanh(), torch.nn.Linear(*widths[1:]))
    policy.to(observed.device)
    closed = torch.tensor(CLOSED, device=observed.device)

    def act():
        return env.step(closed + 0.1 * policy(env.observation()))

    with torch.no_grad():
        for name, turn in (("step alone", env.sim.step), ("step and policy", act)):
            for _ in range(10):
                turn()
            wp.synchronize()
            before, start = memory(env.sim.device), time.perf_counter()
            for _ in range(args.steps):
                turn()
            wp.synchronize()
            took = time.perf_counter() - start
            print(f"{name}: {args.steps / took:.0f} steps/s of {args.envs}: {1e6 * took / args.steps:.0f} µs")
        print(f"memory: {before} before the loop, {memory(env.sim.device)} after {args.steps} steps")
        env.reset()
        for _ in range(79):
            act()
        *_, about = act()
        env.sim.check()
        print(f"force: {about['force'].mean().item():.2f} N on average, {about['force'].max().item():.2f} N at most")


if __name__ == "__main__":
    main()
