"""Find where a plate ends, by touch.

    python edge_paxini_gripper.py SERVOS PADS [--newtons 6]

The fingers take hold of the plate some way before its end, let go, and take hold again a little farther, until a part
of the pads feels less than at first. How much of them is still on the plate tells where it ends: a line of JSON.
"""

import argparse
import json
import time

from paxini_gripper import CARRIAGE, FINGERS, TOUCH, Force, Gripper

NEAR = 0.0176  # [m] the fingers when they let go
BEGIN, END, STEP, SPEED = -0.02, 0.03, 0.005, 1000  # [m] along x, [steps/s]
PAD, COLUMNS = 0.02, 3
ENOUGH = 0.85  # share of the pads that is still on the plate when its end is told
SETTLES, READINGS, PATIENCE = 0.4, 10, 2.0  # [s] from the first touch on, then so many; [s] until there is none


def columns(taxels: list[list[Force]]) -> list[float]:
    """What presses on the columns of both pads, those behind first; the pads face each other."""
    left, right = ([sum(z for _, _, z in pad[k::COLUMNS]) for k in range(COLUMNS)] for pad in taxels)
    return [a + b for a, b in zip(left, reversed(right))]


def take_hold(gripper: Gripper, readings, newtons: float) -> list[float]:
    """What the columns feel in all [N], and let go again."""
    gripper.press(newtons / 2)
    began, touched, felt = time.monotonic(), 0.0, []
    for passed, pads, taxels in readings:
        force, now = sum(z for _, _, z in pads) / 2, time.monotonic()
        if not touched:
            touched = now if force > TOUCH else 0.0
        elif now < touched + SETTLES:
            gripper.correct(newtons, force, passed)
        else:
            felt.append(columns(taxels))
        if len(felt) == READINGS or (not touched and now > began + PATIENCE):
            break
    gripper.go(FINGERS, NEAR, SPEED)
    time.sleep(0.1)
    return [sum(column) / READINGS for column in zip(*felt)] or [0.0] * COLUMNS


def find(gripper: Gripper, newtons: float) -> float | None:
    """Where the plate ends [m]."""
    gripper.go(FINGERS, NEAR, SPEED)
    readings, place, whole = gripper.felt(), BEGIN, None
    while place < END:
        gripper.go(CARRIAGE, place, SPEED)
        while abs(gripper.carriage() - place) > 0.0005:
            time.sleep(0.02)
        felt = take_hold(gripper, readings, newtons)
        whole = whole or felt
        shares = [now / max(first, 0.1) for now, first in zip(felt, whole)]
        covered = sum(min(share / max(shares[0], 0.01), 1.0) for share in shares) / COLUMNS
        if covered < ENOUGH:
            return gripper.carriage() + (covered - 0.5) * PAD
        place += STEP
    return None


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("servos")
    parser.add_argument("pads")
    parser.add_argument("--newtons", type=float, default=6.0)
    given = parser.parse_args()
    gripper = Gripper(given.servos, given.pads)
    try:
        print(json.dumps({"edge": find(gripper, given.newtons)}))
    finally:
        gripper.close()


if __name__ == "__main__":
    main()
