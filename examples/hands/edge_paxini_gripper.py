"""Find the edge of a plate by touch.

    python edge_paxini_gripper.py SERVOS PADS [--newtons 6]

The fingers grip the plate some way before its edge, let go and grip again a little farther, until part of the pads
measures less than at first. The share of the pads that is still on the plate gives the edge. The program prints a line
of JSON.
"""

import argparse
import json
import time

from paxini_gripper import CARRIAGE, FINGERS, TOUCH, Force, Gripper

NEAR = 0.0176  # [m] position of the open fingers
BEGIN, END, STEP, SPEED = -0.02, 0.03, 0.005, 1000  # [m] along x, [steps/s]
PAD, COLUMNS = 0.02, 3
COVERED = 0.85  # share of the pads on the plate at which the program reports the edge
SETTLING, READINGS, TOUCH_TIMEOUT = 0.4, 10, 2.0  # [s] to settle after touch; readings; [s] to wait for touch


def columns(taxels: list[list[Force]]) -> list[float]:
    """Return the force on each column of both pads together [N], the rear column first; the pads face each other."""
    left, right = ([sum(z for _, _, z in pad[k::COLUMNS]) for k in range(COLUMNS)] for pad in taxels)
    return [a + b for a, b in zip(left, reversed(right))]


def take_hold(gripper: Gripper, readings, newtons: float) -> list[float]:
    """Grip, return the mean force on each column [N], and let go."""
    gripper.press(newtons / 2)
    began, touched, forces = time.monotonic(), 0.0, []
    for passed, pads, taxels in readings:
        force, now = sum(z for _, _, z in pads) / 2, time.monotonic()
        if not touched:
            touched = now if force > TOUCH else 0.0
        elif now < touched + SETTLING:
            gripper.correct(newtons, force, passed)
        else:
            forces.append(columns(taxels))
        if len(forces) == READINGS or (not touched and now > began + TOUCH_TIMEOUT):
            break
    gripper.go(FINGERS, NEAR, SPEED)
    time.sleep(0.1)
    return [sum(column) / READINGS for column in zip(*forces)] or [0.0] * COLUMNS


def find(gripper: Gripper, newtons: float) -> float | None:
    """Return the position of the plate's edge [m], or None if it is out of reach."""
    gripper.go(FINGERS, NEAR, SPEED)
    readings, target, reference = gripper.readings(), BEGIN, None
    while target < END:
        gripper.go(CARRIAGE, target, SPEED)
        while abs(gripper.carriage() - target) > 0.0005:
            time.sleep(0.02)
        forces = take_hold(gripper, readings, newtons)
        reference = reference or forces
        shares = [now / max(first, 0.1) for now, first in zip(forces, reference)]
        covered = sum(min(share / max(shares[0], 0.01), 1.0) for share in shares) / COLUMNS
        if covered < COVERED:
            return gripper.carriage() + (covered - 0.5) * PAD
        target += STEP
    return None


def main() -> None:
    """Parse the command line and run."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("servos")
    parser.add_argument("pads")
    parser.add_argument("--newtons", type=float, default=6.0)
    args = parser.parse_args()
    gripper = Gripper(args.servos, args.pads)
    try:
        print(json.dumps({"edge": find(gripper, args.newtons)}))
    finally:
        gripper.close()


if __name__ == "__main__":
    main()
