"""Hold an object between thumb and index of an Inspire RH56DFTP at a args force, by touch; uses a published driver.

    python grasp_inspire_rh56dftp.py HOST:PORT [--newtons 1] [--seconds 6]

The thumb moves to the position where the index will meet it. The index closes slowly until the matrices of both fingers
measure a force; the force then controls the target of the index. The program prints the result as a line of JSON. The
driver writes its log into the working directory.
"""

import argparse
import json
import logging
import time

from Register.RegisterKey.ftp_registers_keys import RegisterName
from RH56DFTP.RH56DFTP_TCP import RH56DFTP_TCP

COUNTS_PER_NEWTON = 1000.0  # of all points together; measure this value on a real hand
TOUCH = 50.0  # counts
INDEX, THUMB = "POS_SET(3)", "POS_SET(4)"
PADS: tuple[tuple[RegisterName, ...], ...] = (  # matrices of index and thumb
    ("TACTILE_INDEX_FINGER_TIP_3x3", "TACTILE_INDEX_FINGER_TIP_12x8", "TACTILE_INDEX_FINGER_PALM_10x8"),
    ("TACTILE_THUMB_TIP_3x3", "TACTILE_THUMB_TIP_12x8", "TACTILE_THUMB_MIDDLE_3x3", "TACTILE_THUMB_PALM_12x8"),
)
THUMB_AT, NEAR = 1309, 1150  # of 2000: thumb where the index will meet it; index before it closes slowly
STEPS_PER_S, STEPS_PER_NEWTON_S = 40.0, 120.0  # speed of closing; speed of correction per newton of error
FAR = 2.0  # largest change per command: the hand moves at full speed, and a large change strikes the object


def total_counts(hand: RH56DFTP_TCP, finger: int) -> float:
    """Return the sum of all points of a finger; the driver returns some more numbers than a matrix has."""
    total = 0.0
    for name in PADS[finger]:
        rows, columns = map(int, name.rpartition("_")[2].split("x"))
        total += sum(hand.get(name)[: rows * columns])
    return total


def grasp(hand: RH56DFTP_TCP, newtons: float, seconds: float) -> dict:
    """Close, hold for ``seconds``, and return the result."""
    hand.set(THUMB, THUMB_AT)
    hand.set(INDEX, NEAR)
    time.sleep(0.8)
    target, counts, touched, reads = float(NEAR), 0.0, None, 0
    start = last = time.monotonic()
    while time.monotonic() < start + 10 if touched is None else time.monotonic() < touched + seconds:
        pads = total_counts(hand, 0), total_counts(hand, 1)
        counts = sum(pads) / 2
        now, reads = time.monotonic(), reads + 1
        passed, last = min(now - last, 0.1), now
        if touched is None and min(pads) > TOUCH:
            touched = now
            print(json.dumps({"touched": True}), flush=True)
        missing = newtons - counts / COUNTS_PER_NEWTON
        change = passed * (STEPS_PER_S if touched is None else STEPS_PER_NEWTON_S * missing)
        target = min(max(target + min(max(change, -FAR), FAR), 0.0), 2000.0)
        hand.set(INDEX, round(target))
    rate = reads / (time.monotonic() - start)
    return {"newtons": counts / COUNTS_PER_NEWTON, "target": target, "rate_hz": rate, "held": touched is not None}


def main() -> None:
    """Parse the command line and run."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("address")
    parser.add_argument("--newtons", type=float, default=1.0)
    parser.add_argument("--seconds", type=float, default=6.0)
    args = parser.parse_args()
    logging.disable(logging.INFO)
    host, _, port = args.address.removeprefix("socket://").partition(":")
    hand = RH56DFTP_TCP(host=host, port=int(port))
    try:
        print(json.dumps(grasp(hand, args.newtons, args.seconds)))
    finally:
        hand.close()


if __name__ == "__main__":
    main()
