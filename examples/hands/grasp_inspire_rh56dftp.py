"""Hold what is between thumb and index of an Inspire RH56DFTP at a force, by touch; with a published driver alone.

    python grasp_inspire_rh56dftp.py HOST:PORT [--newtons 1] [--seconds 6]

The thumb goes where the index will meet it. The index closes slowly, and what its three matrices read moves its target
from then on. A line of JSON says what came of it. The driver writes its log where it is started.
"""

import argparse
import json
import logging
import time

from RH56DFTP.RH56DFTP_TCP import RH56DFTP_TCP

COUNTS_PER_NEWTON = 1000.0  # of all points together; a real hand wants this measured
TOUCH = 50.0  # counts
INDEX, THUMB = "POS_SET(3)", "POS_SET(4)"
PADS = ("TACTILE_INDEX_FINGER_TIP_3x3", "TACTILE_INDEX_FINGER_TIP_12x8", "TACTILE_INDEX_FINGER_PALM_10x8")
THUMB_AT, NEAR = 1309, 1050  # of 2000: where the index will meet it, and the index before it closes slowly
STEP, STEPS_PER_NEWTON = 8.0, 3.0  # change of the target at each reading


def pushed(hand: RH56DFTP_TCP) -> float:
    """What all points of the index read together; the driver gives some more numbers than a matrix has."""
    total = 0.0
    for name in PADS:
        rows, columns = map(int, name.rpartition("_")[2].split("x"))
        total += sum(hand.get(name)[: rows * columns])
    return total


def grasp(hand: RH56DFTP_TCP, newtons: float, seconds: float) -> dict:
    """Close, and hold for so long."""
    hand.set(THUMB, THUMB_AT)
    hand.set(INDEX, NEAR)
    time.sleep(0.8)
    target, counts, touched, reads, start = float(NEAR), 0.0, None, 0, time.monotonic()
    while time.monotonic() < start + 10 if touched is None else time.monotonic() < touched + seconds:
        counts = pushed(hand)
        reads += 1
        if touched is None and counts > TOUCH:
            touched = time.monotonic()
            print(json.dumps({"touched": True}), flush=True)
        target += STEP if touched is None else STEPS_PER_NEWTON * (newtons - counts / COUNTS_PER_NEWTON)
        target = min(max(target, 0.0), 2000.0)
        hand.set(INDEX, round(target))
    rate = reads / (time.monotonic() - start)
    return {"newtons": counts / COUNTS_PER_NEWTON, "target": target, "rate_hz": rate, "held": touched is not None}


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("address")
    parser.add_argument("--newtons", type=float, default=1.0)
    parser.add_argument("--seconds", type=float, default=6.0)
    given = parser.parse_args()
    logging.disable(logging.INFO)
    host, _, port = given.address.removeprefix("socket://").partition(":")
    hand = RH56DFTP_TCP(host=host, port=int(port))
    try:
        print(json.dumps(grasp(hand, given.newtons, given.seconds)))
    finally:
        hand.close()


if __name__ == "__main__":
    main()
