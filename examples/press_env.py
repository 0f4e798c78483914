"""A small controller presses a ball with a given force, in many environments of Gymnasium at once.

pip install 'tactemu[gym]'
python examples/press_env.py --envs 4096
python examples/press_env.py --envs 4096 --device cuda:0 --random
"""

import argparse
import time

import numpy as np

import tactemu as tt

SPEED_PER_NEWTON = 1.0
"""Action, a share of the ball's speed, per error of the force [1/N]."""


def press(observation: dict[str, np.ndarray]) -> np.ndarray:
    """Return actions that move the ball down while the taxels measure too little force, and up while too much."""
    force = -observation["pad_force"][..., 2].sum((-2, -1))
    actions = np.zeros((len(force), 3), np.float32)
    actions[:, 2] = SPEED_PER_NEWTON * (force - observation["target"][:, 0])
    return actions


def main() -> None:
    parser = argparse.ArgumentParser(description="Presses balls into pads; prints the return and the speed.")
    parser.add_argument("--envs", type=int, default=64)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--random", action="store_true", help="Take random actions.")
    args = parser.parse_args()
    envs = tt.envs.PressVectorEnv(args.envs, device=args.device)
    envs.action_space.seed(args.seed)
    observation, _ = envs.reset(seed=args.seed)
    steps, total, start = envs.task.max_episode_steps, np.zeros(args.envs), time.perf_counter()
    for _ in range(steps):
        actions = envs.action_space.sample() if args.random else press(observation)
        observation, reward, *_ = envs.step(actions)
        total += reward
    took = time.perf_counter() - start
    envs.close()
    print(f"return: {total.mean():.1f} on average, {total.min():.1f} at least, of {steps}")
    print(f"{args.envs * steps / took:.0f} steps/s: {1e3 * took / steps:.2f} ms for a step of {args.envs} environments")


if __name__ == "__main__":
    main()
