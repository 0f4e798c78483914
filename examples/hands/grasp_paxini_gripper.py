"""Hold what is between two fingers at a force, by touch; and, if it is to slip, harder.

    python grasp_paxini_gripper.py SERVOS PADS [--newtons 2] [--seconds 6] [--friction 0.8]

The fingers close slowly and with little force, and what the pads read sets that force from then on. What drags
at both pads together with much of what friction holds begins to slip at their rims: from there on the gripper holds
harder. What they do against each other, as with a box that is held askew, does not count, nor what a table holds up.
Lines of JSON say when it touched, when it noticed slip, and what came of it.
"""

import argparse
import json
import math
import time

from paxini_gripper import FINGERS, TOUCH, Gripper

NEAR = 0.0176  # [m] the fingers before they close slowly
SLIPS, SAFE = 0.6, 0.45  # of friction: drag from which something slips, and at which it is held then
GRASPED = 0.9  # of the force, on both pads: until then something is pushed, not held, and may slide


def say(**words) -> None:
    """A line of JSON."""
    print(json.dumps(words), flush=True)


def grasp(gripper: Gripper, newtons: float, seconds: float, friction: float) -> dict:
    """Close, and hold for so long."""
    gripper.go(FINGERS, NEAR, 1500)
    time.sleep(1.0)
    gripper.press(gripper.newtons)
    began, touched, grasped, force, readings = time.monotonic(), 0.0, False, 0.0, 0
    for passed, pads, _ in gripper.felt():
        now, readings = time.monotonic(), readings + 1
        force = sum(z for _, _, z in pads) / 2
        if not touched and force > TOUCH:
            touched = now
            say(touched=now)
        if now > (touched or began) + seconds:
            break
        if not touched:
            continue
        grasped = grasped or min(z for _, _, z in pads) > GRASPED * newtons
        (x, y, z), (across, down, other) = pads  # each sees the other's x the other way round
        drag = math.hypot(x - across, max(y + down, 0.0)) / max(z + other, 0.1)
        if grasped and drag > SLIPS * friction:
            harder = force * drag / (SAFE * friction)
            if harder > newtons:
                say(slips=now, newtons=harder)
                newtons = harder
                gripper.press(gripper.newtons * newtons / force)
                continue
        gripper.correct(newtons, force, passed)
    return {"newtons": force, "held": bool(touched), "rate_hz": readings / (time.monotonic() - began)}


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("servos")
    parser.add_argument("pads")
    parser.add_argument("--newtons", type=float, default=2.0)
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--friction", type=float, default=0.8, help="of the pads on what is held")
    given = parser.parse_args()
    gripper = Gripper(given.servos, given.pads)
    try:
        say(**grasp(gripper, given.newtons, given.seconds, given.friction))
    finally:
        gripper.close()


if __name__ == "__main__":
    main()
