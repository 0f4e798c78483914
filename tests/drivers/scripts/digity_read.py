"""digity: so many packets of every board, by sequence number."""

import json
import sys

from digity import AnglesSensor, GloveStream, ImuSensor, TouchSensor


def shown(frame):
    angles, imu, touch = frame.sensors
    assert isinstance(angles, AnglesSensor) and isinstance(imu, ImuSensor) and isinstance(touch, TouchSensor)
    (at,), (moved,) = angles.samples, imu.samples
    assert {angles.finger, imu.finger, touch.finger} == {frame.node_id} and at.ts_us == moved.ts_us == touch.ts_us
    return [touch.channels_raw, [*moved.acc, *moved.gyro], at.angles_deg]


port, count = sys.argv[1], int(sys.argv[2])
packets, sides = {}, set()
with GloveStream(port=port) as stream:
    for frame in stream:
        packets.setdefault(frame.seq, {})[frame.node_id] = shown(frame)
        sides.add((frame.side, frame.group))
        if len(packets) > count + 1:
            break
whole = sorted(packets)[1:-1]
print(
    json.dumps(
        {"sides": sorted(sides), "sequence": whole, "boards": [[packets[k][b] for b in range(5)] for k in whole]}
    )
)
