"""``linkerbot_read.py MODEL SIDE CHANNEL INTERFACE COUNT``: identity and matrices as ``linkerbot`` decodes them."""

import json
import sys
import time

import linkerbot
from linkerbot import TimeoutError

model, side, channel, interface = sys.argv[1:5]
too_early = 0
FINGERS = ("thumb", "index", "middle", "ring", "pinky")


def identity(hand):
    """The SDK waits 20 ms for each answer: on a busy machine that can be too short. It may ask for 20 s."""
    end = time.monotonic() + 20.0
    while time.monotonic() < end:
        try:
            return hand.version.get_device_info()
        except TimeoutError:
            continue
    raise SystemExit("no identity")


def matrices(hand):
    """The SDK asks before it waits: where it is held up in between, the answer comes too early. Three times at most."""
    global too_early
    while True:
        try:
            return hand.force_sensor.get_blocking(timeout_ms=1000)
        except TimeoutError:
            too_early += 1
            if too_early > 3:
                raise


with getattr(linkerbot, model)(side, channel, interface) as hand:
    hand.stop_polling()
    info = identity(hand)
    readings = []
    for _ in range(int(sys.argv[5])):
        data = matrices(hand)
        readings.append([getattr(data, finger).values.tolist() for finger in FINGERS])
    hand.start_polling()
    time.sleep(0.5)
    polled = hand.get_snapshot()
    snapshot = [getattr(polled.force_sensor, finger).values.tolist() for finger in FINGERS]
    hand.stop_polling()
    angles = list(hand.angle.get_blocking(timeout_ms=1000).angles)

versions = {name: str(getattr(info, f"{name}_version")) for name in ("firmware", "mechanical", "pcb")}
print(
    json.dumps({"serial": info.serial_number, **versions, "readings": readings, "snapshot": snapshot, "angles": angles})
)
