"""pyrh56 over EB 90: the index finger's top 200 times, all matrices once, what its driver reads and writes.

The package has no touch calls, so its transport and frames read the touch map.
"""

import json
import sys
import time

from rh56_sdk import RH56Driver
from rh56_sdk.protocol import RH56Protocol as Frames
from rh56_sdk.protocol import parse_i16_le

hand = RH56Driver(sys.argv[1], timeout=1.0)  # its 0.1 s are short where others keep the machine busy
hand.connect()
line = hand._transport


def matrix(address, points):
    """Points of the touch map."""
    reply = line.request(Frames.build_read_reg16(1, address, 2 * points))
    return parse_i16_le(Frames.parse_read_response(reply, 1, address, 2 * points), points)


many = [matrix(4128, 96) for _ in range(200)]
places = [(3000 + 370 * f + at, points) for f in range(4) for at, points in ((0, 9), (18, 96), (210, 80))]
places += [(4480, 9), (4498, 96), (4690, 9), (4708, 96), (4900, 112)]
once = [(address, matrix(address, points)) for address, points in places]
hand.set_speed([20] * 6)  # the shortest way takes 3 s, so that all move still when they are asked
hand.move_to([0, 200, 400, 600, 800, 900])
moving = hand.read_status()
hand.set_speed([1000] * 6)
until = time.monotonic() + 20
while hand.read_status() != [2] * 6 and time.monotonic() < until:
    time.sleep(0.02)
print(
    json.dumps(
        {
            "many": many,
            "once": once,
            "moving": moving,
            "angles": hand.read_angle(),
            "positions": hand.read_actuator_position(),
            "forces": hand.read_force(),
            "temperatures": hand.read_temperature(),
            "errors": hand.read_error(),
            "status": hand.read_status(),
        }
    )
)
hand.clear_error()
hand.disconnect()
