"""A vector environment of a hand that feels: MuJoCo Warp moves it, tactemu feels, torch decides, all on one device.

    pip install 'tactemu[mujoco-warp]' torch
    python examples/hand_env.py --envs 4096 --device cuda:0

The interface is that of ``gymnasium.vector.VectorEnv``; environments that end are reset within ``step``.
"""

import argparse
import time
from pathlib import Path

import mujoco
import numpy as np
import torch
import warp as wp

import tactemu as tt

HAND = Path(__file__).parent / "hands" / "ability_hand_ball.xml"
JOINTS = "index", "middle", "ring", "pinky", "thumb_flexor", "thumb_rotator"
PAD = np.stack([*np.meshgrid(np.linspace(-5e-3, 5e-3, 6), np.linspace(-8e-3, 8e-3, 6)), np.full((6, 6), 4e-3)], -1)
CLOSED = 1.4, 1.4, 1.4, 1.4, 1.0, 0.0  # [rad]
WANTED_N, HORIZON, FALLEN_M = 2.0, 250, 0.03


class HandEnv:
    """Hold a ball: the fingertips shall feel :data:`WANTED_N` together."""

    def __init__(self, num_envs: int, device: str):
        spec = mujoco.MjSpec.from_file(str(HAND))
        for joint in JOINTS:
            motor = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
            motor.set_to_position(kp=0.4, kv=0.02)
            motor.forcerange = -0.3, 0.3
        self.num_envs = num_envs
        scene = tt.Scene(dt=4e-3)
        self.engine = tt.MujocoWarpEngine(scene, spec.compile())
        fingers = [f"{joint.removesuffix('_flexor')}_tip" for joint in JOINTS[:5]]
        about = {"probe_local_pos": PAD, "probe_radius": 1.5e-3, "normal_stiffness": 200.0, "forces_on_skin": True}
        model = tt.KinematicTaxel(**about, track_link_idx=(self.engine.source.geom("object").index,))
        skins = [scene.add_sensor(model, link=self.engine.source.geom(tip)) for tip in fingers]
        self.sim = scene.build(num_envs, device=device)
        self.touch = [torch.from_dlpack(skin.force_array) for skin in skins]  # the steps write into them
        self.orders = torch.from_dlpack(self.engine.data.ctrl)
        self.qpos = torch.from_dlpack(self.engine.data.qpos)
        self.age = torch.zeros(num_envs, dtype=torch.int32, device=self.orders.device)

    def observation(self) -> torch.Tensor:
        felt = [force[..., 2].flatten(1) for force in self.touch]
        return torch.cat([self.qpos, *felt], dim=1)

    def reset(self):
        self.sim.reset()
        self.age.zero_()
        return self.observation(), {}

    def step(self, actions: torch.Tensor):
        self.orders.copy_(actions)
        self.sim.step()
        self.age += 1
        felt = torch.stack([force[..., 2].abs().flatten(1).sum(1) for force in self.touch]).sum(0)
        terminated, truncated = self.qpos[:, -5] < FALLEN_M, self.age >= HORIZON
        done = terminated | truncated
        self.sim.reset(done)
        self.age.masked_fill_(done, 0)
        return self.observation(), -(felt - WANTED_N).abs(), terminated, truncated, {"force": felt}


def main() -> None:
    ask = argparse.ArgumentParser()
    ask.add_argument("--envs", type=int, default=4096)
    ask.add_argument("--device", default="cuda:0")
    ask.add_argument("--steps", type=int, default=1000)
    told = ask.parse_args()
    env = HandEnv(told.envs, told.device)
    seen, _ = env.reset()
    widths = seen.shape[1], 64, len(JOINTS)
    policy = torch.nn.Sequential(torch.nn.Linear(*widths[:2]), torch.nn.Tanh(), torch.nn.Linear(*widths[1:]))
    policy.to(seen.device)
    closed = torch.tensor(CLOSED, device=seen.device)
    with torch.no_grad():
        for name, turn in (
            ("step alone", env.sim.step),
            ("whole loop", lambda: env.step(closed + 0.1 * policy(env.observation()))),
        ):
            for _ in range(10):
                turn()
            wp.synchronize()
            start = time.perf_counter()
            for _ in range(told.steps):
                turn()
            wp.synchronize()
            took = time.perf_counter() - start
            print(f"{name}: {told.steps / took:.0f} steps/s of {told.envs}: {1e6 * took / told.steps:.0f} µs")
        env.reset()
        for _ in range(80):
            *_, about = env.step(closed + 0.1 * policy(env.observation()))
        env.sim.check()
        print(f"felt: {about['force'].mean().item():.2f} N on average, {about['force'].max().item():.2f} N at most")


if __name__ == "__main__":
    main()
