"""Hold what is between thumb and index of an Ability Hand at a force, by touch; with the vendor's SDK alone.

    python grasp_ability_hand.py PORT [--newtons 8] [--seconds 6]

The thumb goes where the index will meet it. The index closes slowly, and what its pad and the thumb's read moves its
target from then on. A site reads nothing below 0.88 N, so that less than some newtons cannot be held; what that hides
of a pad's force is guessed. A line of JSON says what came of it. The SDK writes its log and its settings where it is
started.
"""

import argparse
import json
import time

from ah_wrapper import AHSerialClient

THUMB, ROTATOR = 60.0, 0.0  # [deg]
NEAR, SPEED = 45.0, 12.0  # [deg] index before it closes slowly, [deg/s] then
DEGREES_PER_NEWTON = 0.03  # change of the target at each reading
PERIOD_S = 0.01
HIDDEN = 0.4  # [N] in the mean, on sites at the rim of what is touched
INDEX, THUMB_SITES = slice(0, 6), slice(24, 30)


def connected(port: str) -> AHSerialClient:
    """The hand; the SDK waits 50 ms for its first answer, once, and then ends the program."""
    for _ in range(10):
        try:
            return AHSerialClient(port=port, baud_rate=460800, rate_hz=200, auto_start_threads=False)
        except SystemExit:
            continue
    raise SystemExit(f"{port}: no hand answers")


def grasp(client: AHSerialClient, wanted: float, seconds: float) -> dict:
    """Close, and hold for so long."""
    index, touched, force, began = NEAR, None, 0.0, time.monotonic()
    client.set_position([NEAR, 0.0, 0.0, 0.0, THUMB, ROTATOR])
    time.sleep(0.8)
    reads, loops, start = client.n_reads, 0, time.monotonic()
    while time.monotonic() < start + 8 if touched is None else time.monotonic() < touched + seconds:
        sites = client.hand.get_fsr() or [0] * 30
        force = sum((*sites[INDEX], *sites[THUMB_SITES])) / 2  # the SDK has made newtons of them
        if force > 0:
            force += HIDDEN
        if touched is None and force > 0:
            touched = time.monotonic()
            print(json.dumps({"touched": True}), flush=True)
        index += SPEED * PERIOD_S if touched is None else DEGREES_PER_NEWTON * (wanted - force)
        index = min(max(index, 0.0), 100.0)
        client.set_position([index, 0.0, 0.0, 0.0, THUMB, ROTATOR])
        loops += 1
        time.sleep(max(0.0, start + loops * PERIOD_S - time.monotonic()))
    rate = (client.n_reads - reads) / (time.monotonic() - start)
    return {"newtons": force, "index": index, "rate_hz": rate, "held": touched is not None, "s": start - began}


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("port")
    parser.add_argument("--newtons", type=float, default=8.0)
    parser.add_argument("--seconds", type=float, default=6.0)
    given = parser.parse_args()
    client = connected(given.port)
    client.set_position([NEAR, 0.0, 0.0, 0.0, THUMB, ROTATOR])
    client.start_threads()
    try:
        print(json.dumps(grasp(client, given.newtons, given.seconds)))
    finally:
        client.close()


if __name__ == "__main__":
    main()
