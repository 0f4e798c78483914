"""Hold an object between two fingers at a args force, by touch, and grip harder when it begins to slip.

    python grasp_paxini_gripper.py SERVOS PADS [--newtons 2] [--seconds 6] [--friction 0.8]

The fingers close slowly with little force until the pads measure a force; the pads then control the force. When the
drag on both pads together comes near the limit of friction, the object begins to slip at the rims of the pads, and the
gripper grips harder. Opposite drags of the two pads (a box held askew) do not count, nor does drag that a table causes
from below. The program prints lines of JSON at the first touch, at each slip, and with the result.
"""

import argparse
import json
import math
import time

from paxini_gripper import FINGERS, TOUCH, Gripper

NEAR = 0.0176  # [m] position of the fingers before they close slowly
SLIPS, SAFE = 0.6, 0.45  # drag / friction at which the object slips; drag / friction after the correction
GRASPED = 0.9  # share of the force on both pads; below it the object is pushed rather than held, and may slide


def report(**values) -> None:
    """Print a line of JSON."""
    print(json.dumps(values), flush=True)


def grasp(gripper: Gripper, newtons: float, seconds: float, friction: float) -> dict:
    """Close, hold for ``seconds``, and return the result."""
    gripper.go(FINGERS, NEAR, 1500)
    time.sleep(1.0)
    gripper.press(gripper.newtons)
    began, touched, grasped, force, readings = time.monotonic(), 0.0, False, 0.0, 0
    for passed, pads, _ in gripper.readings():
        now, readings = time.monotonic(), readings + 1
        force = sum(z for _, _, z in pads) / 2
        if not touched and force > TOUCH:
            touched = now
            report(touched=now)
        if now > (touched or began) + seconds:
            break
        if not touched:
            continue
        grasped = grasped or min(z for _, _, z in pads) > GRASPED * newtons
        (x, y, z), (across, down, other) = pads  # the x axes of the two pads are opposite
        drag = math.hypot(x - across, max(y + down, 0.0)) / max(z + other, 0.1)
        if grasped and drag > SLIPS * friction:
            harder = force * drag / (SAFE * friction)
            if harder > newtons:
                report(slips=now, newtons=harder)
                newtons = harder
                gripper.press(gripper.newtons * newtons / force)
                continue
        gripper.correct(newtons, force, passed)
    return {"newtons": force, "held": bool(touched), "rate_hz": readings / (time.monotonic() - began)}


def main() -> None:
    """Parse the command line and run."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("servos")
    parser.add_argument("pads")
    parser.add_argument("--newtons", type=float, default=2.0)
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--friction", type=float, default=0.8, help="coefficient of friction of the pads on the object")
    args = parser.parse_args()
    gripper = Gripper(args.servos, args.pads)
    try:
        report(**grasp(gripper, args.newtons, args.seconds, args.friction))
    finally:
        gripper.close()


if __name__ == "__main__":
    main()
