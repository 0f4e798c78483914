"""Find where a plate ends, by touch.

    python edge_paxini_gripper.py SERVOS PADS [--newtons 6]

The fingers take hold of the plate some way before its end, and the gripper slides along it until a part of the pads
feels nothing any more. How much of them is still on the plate tells where it ends. A line of JSON says that.
"""

import argparse
import json
import time

from paxini_gripper import CARRIAGE, FINGERS, TOUCH, Force, Gripper

NEAR = 0.0176  # [m] the fingers before they close slowly
BEGIN, END, SPEED = -0.02, 0.03, 300  # [m] along x, [steps/s]
PAD, COLUMNS = 0.02, 3
ENOUGH, READINGS = 0.7, 5  # share of the pads that is still on the plate when its end is told, and how often it is


def columns(taxels: list[list[Force]]) -> list[float]:
    """What presses on the columns of both pads, those behind first; the pads face each other."""
    left, right = ([sum(z for _, _, z in pad[k::COLUMNS]) for k in range(COLUMNS)] for pad in taxels)
    return [a + b for a, b in zip(left, reversed(right))]


def find(gripper: Gripper, newtons: float) -> dict:
    """Where the plate ends [m]."""
    gripper.go(FINGERS, NEAR, 1500)
    gripper.go(CARRIAGE, BEGIN, 1500)
    time.sleep(1.0)
    gripper.press(gripper.newtons)
    settled, ends = 0.0, []
    for passed, pads, taxels in gripper.felt():
        force = sum(z for _, _, z in pads) / 2
        if force < TOUCH and not settled:
            continue
        if not settled or time.monotonic() < settled + 1.0:
            settled = settled or time.monotonic()
            gripper.correct(newtons, force, passed)
            continue
        gripper.go(CARRIAGE, END, SPEED)
        behind, *rest = columns(taxels)
        covered = (1 + sum(min(each / max(behind, 0.1), 1.0) for each in rest)) / COLUMNS
        if covered < ENOUGH:
            ends.append(gripper.carriage() + (covered - 0.5) * PAD)
        if len(ends) == READINGS or gripper.carriage() > END - 0.001:
            break
    gripper.go(FINGERS, NEAR, 1500)
    return {"edge": sum(ends) / len(ends) if ends else None}


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("servos")
    parser.add_argument("pads")
    parser.add_argument("--newtons", type=float, default=6.0)
    given = parser.parse_args()
    gripper = Gripper(given.servos, given.pads)
    try:
        print(json.dumps(find(gripper, given.newtons)))
    finally:
        gripper.close()


if __name__ == "__main__":
    main()
