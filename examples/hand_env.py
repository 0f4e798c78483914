"""A hand closes on a ball and holds it with a given force, in many environments of Gymnasium at once: MuJoCo Warp or
Newton simulates the motion, tactemu the taxels.

    pip install 'tactemu[gym,newton]'  # or tactemu[gym,mujoco-warp]
    python examples/hand_env.py --envs 4
    python examples/hand_env.py --envs 4096 --device cuda:0 --engine newton --arrays torch

With ``--arrays torch`` observations and actions stay on the device, and no part of a step waits for it.
"""

import argparse
import time

import numpy as np
import warp as wp

import tactemu as tt

CLOSED = np.array([1.4, 1.4, 1.4, 1.4, 1.0, 0.0], np.float32)
"""Angles of the closed hand [rad]."""
LOW, HIGH = np.array([0, 0, 0, 0, 0, -1.75], np.float32), np.array([1.75, 1.75, 1.75, 1.75, 1.75, 0], np.float32)
"""Ranges of the joints [rad]: actions are -1 to 1 for them."""
APPROACH, GAIN, MAX_ERROR_N, SMOOTHING = 5e-3, 5e-4, 3.0, 0.3
"""Closing in each step before the touch; closing per error of the force [1/N], and its limit; share of a new force."""


class Grip:
    """A controller: closes until it touches, then follows the force."""

    def __init__(self, envs: tt.envs.HandVectorEnv):
        arrays = envs.task.arrays
        self.xp = arrays.xp
        self.share = arrays.zeros((envs.num_envs, 1)) + 0.6
        self.force = arrays.zeros((envs.num_envs, 1))
        self.closed, self.low, self.high = map(arrays.asarray, (CLOSED, LOW, HIGH))

    def act(self, observation):
        tips = [values for name, values in observation.items() if name.endswith("_force")]
        force = -sum(tip[..., 2].sum((-2, -1)) for tip in tips)[:, None]
        self.force = (1 - SMOOTHING) * self.force + SMOOTHING * force
        error = self.xp.clip(observation["target"] - self.force, -MAX_ERROR_N, MAX_ERROR_N)
        closing = self.xp.where(self.force > 0.3, GAIN * error, APPROACH)
        self.share = self.xp.clip(self.share + closing, 0.0, 1.3)
        return 2 * (self.share * self.closed - self.low) / (self.high - self.low) - 1


def main() -> None:
    parser = argparse.ArgumentParser(description="Closes hands on balls; prints return, force and speed.")
    parser.add_argument("--envs", type=int, default=4)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--steps", type=int, default=250)
    parser.add_argument("--engine", choices=["mujoco-warp", "newton"], default="mujoco-warp")
    parser.add_argument("--arrays", choices=["numpy", "torch"], default="numpy")
    args = parser.parse_args()
    envs = tt.envs.HandVectorEnv(args.envs, engine=args.engine, device=args.device, arrays=args.arrays)
    envs.step(Grip(envs).act(envs.reset(seed=0)[0]))  # the first step compiles the kernels
    observation, infos = envs.reset(seed=0)
    grip, total = Grip(envs), 0.0
    start = time.perf_counter()
    for _ in range(args.steps):
        observation, reward, _terminated, _truncated, infos = envs.step(grip.act(observation))
        total = total + reward
    wp.synchronize()
    took = time.perf_counter() - start
    envs.task.sim.check()
    print(f"return: {float(total.mean()):.1f} on average, of {args.steps}")
    print(f"force: {float(infos['force'].mean()):.2f} N on average, {float(infos['force'].max()):.2f} N at most")
    print(f"{args.envs * args.steps / took:.0f} steps/s: {1e3 * took / args.steps:.2f} ms for a step of {args.envs}")


if __name__ == "__main__":
    main()
