"""Hold an object between thumb and index of an Ability Hand at a args force, by touch; uses the vendor's SDK alone.

    python grasp_ability_hand.py PORT [--newtons 8] [--seconds 6]

The thumb moves to the position where the index will meet it. The index closes slowly until its pad or the thumb's
measures a force; the force then controls the target of the index. A site reads 0 below 0.88 N, so the program cannot
hold less than some newtons, and it estimates the hidden part of the force. It prints the result as a line of JSON. The
SDK writes its log and settings into the working directory.
"""

import argparse
import json
import time

from ah_wrapper import AHSerialClient

THUMB, ROTATOR = 60.0, 0.0  # [deg]
NEAR, SPEED = 45.0, 12.0  # index: [deg] before it closes slowly, [deg/s] while it does
DEGREES_PER_NEWTON = 0.03  # change of the target per reading
PERIOD_S = 0.01
HIDDEN = 0.4  # [N] mean force on the sites at the rim of the contact, which read 0
INDEX, THUMB_SITES = slice(0, 6), slice(24, 30)


def connect(port: str) -> AHSerialClient:
    """Return the connect hand; try again where the SDK exits because the first answer took longer than 50 ms."""
    for _ in range(10):
        try:
            return AHSerialClient(port=port, baud_rate=460800, rate_hz=200, auto_start_threads=False)
        except SystemExit:
            continue
    raise SystemExit(f"{port}: no hand answers")


def grasp(client: AHSerialClient, wanted: float, seconds: float) -> dict:
    """Close, hold for ``seconds``, and return the result."""
    index, touched, force, began = NEAR, None, 0.0, time.monotonic()
    client.set_position([NEAR, 0.0, 0.0, 0.0, THUMB, ROTATOR])
    time.sleep(0.8)
    reads, loops, start = client.n_reads, 0, time.monotonic()
    while time.monotonic() < start + 8 if touched is None else time.monotonic() < touched + seconds:
        sites = client.hand.get_fsr() or [0] * 30
        force = sum((*sites[INDEX], *sites[THUMB_SITES])) / 2  # the SDK converts them into newtons
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
    """Parse the command line and run."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("port")
    parser.add_argument("--newtons", type=float, default=8.0)
    parser.add_argument("--seconds", type=float, default=6.0)
    args = parser.parse_args()
    client = connect(args.port)
    client.set_position([NEAR, 0.0, 0.0, 0.0, THUMB, ROTATOR])
    client.start_threads()
    try:
        print(json.dumps(grasp(client, args.newtons, args.seconds)))
    finally:
        client.close()


if __name__ == "__main__":
    main()
