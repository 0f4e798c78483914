"""flexitac: 200 raw frames of a board with so many rows."""

import json
import sys

from flexitac.sensor import FlexiTacSensor

with FlexiTacSensor(sys.argv[1], rows=int(sys.argv[2]), baseline=20.0) as sensor:
    frames = [sensor.read().raw.reshape(-1).tolist() for _ in range(200)]
print(json.dumps(frames))
