"""Hold an object between thumb and index of a LinkerHand L6 or O6 at a args force, by touch; uses the vendor's SDK.

    python grasp_linker_l6.py CHANNEL [INTERFACE] [--newtons 1] [--seconds 6] [--side left] [--hand L6]

The thumb moves to the position where the index will meet it. The index closes slowly with little torque until the two
pads measure a force; the force then controls the torque. The program prints the result as a line of JSON. On a real
hand, CHANNEL is can0.
"""

import argparse
import json
import time

from linkerbot import L6, O6, TimeoutError

COUNTS_PER_NEWTON = 500.0  # sum of a pad's taxels; measure this value on a real hand
TOUCH = 25.0  # counts
CLOSING = 6.0  # torque [%] before contact
PERCENT_PER_NEWTON_S = 30.0  # change of torque per second and newton of error
OPEN, NEAR, CLOSED, THUMB = 100.0, 44.0, 0.0, 12.5


def total_counts(hand: L6 | O6, finger: str) -> float:
    """Return the sum of all taxels of a pad."""
    while True:
        try:
            return float(hand.force_sensor.get_finger(finger).get_blocking(timeout_ms=100).values.sum())
        except TimeoutError:  # the SDK asks before it waits, so it loses an early answer
            continue


def grasp(hand: L6 | O6, newtons: float, seconds: float) -> dict:
    """Close, hold for ``seconds``, and return the result."""
    hand.speed.set_speeds([50.0] * 6)
    hand.torque.set_torques([100.0] * 6)
    hand.angle.set_angles([THUMB, OPEN, NEAR, OPEN, OPEN, OPEN])
    time.sleep(1.0)
    hand.speed.set_speeds([50.0, 50.0, 15.0, 50.0, 50.0, 50.0])
    torque, counts, touched, reads = CLOSING, 0.0, None, 0
    hand.torque.set_torques([100.0, 100.0, torque, 100.0, 100.0, 100.0])
    hand.angle.set_angles([THUMB, OPEN, CLOSED, OPEN, OPEN, OPEN])
    began = last = time.monotonic()
    while time.monotonic() < began + 5 if touched is None else time.monotonic() < touched + seconds:
        counts = (total_counts(hand, "thumb") + total_counts(hand, "index")) / 2
        now, reads = time.monotonic(), reads + 1
        passed, last = min(now - last, 0.2), now
        if counts > TOUCH:
            if touched is None:
                touched = time.monotonic()
                print(json.dumps({"touched": True}), flush=True)
            torque += PERCENT_PER_NEWTON_S * passed * (newtons - counts / COUNTS_PER_NEWTON)
            torque = min(max(torque, 0.5), 100.0)
            hand.torque.set_torques([100.0, 100.0, torque, 100.0, 100.0, 100.0])
    rate = reads / (time.monotonic() - began)
    return {"newtons": counts / COUNTS_PER_NEWTON, "torque": torque, "rate_hz": rate, "held": touched is not None}


def main() -> None:
    """Parse the command line and run."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("channel")
    parser.add_argument("interface", nargs="?", default="socketcan")
    parser.add_argument("--newtons", type=float, default=1.0)
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--side", default="left")
    parser.add_argument("--hand", choices=["L6", "O6"], default="L6")
    args = parser.parse_args()
    with {"L6": L6, "O6": O6}[args.hand](args.side, args.channel, args.interface) as hand:
        hand.stop_polling()
        print(json.dumps(grasp(hand, args.newtons, args.seconds)))


if __name__ == "__main__":
    main()
