"""flexitac: 200 raw frames; the board's rows, if they are not 12."""

import json
import sys

from flexitac.sensor import FlexiTacSensor

rows = int(sys.argv[2]) if sys.argv[2:] else 12
with FlexiTacSensor(sys.argv[1], rows=rows, baseline=20.0) as sensor:
    frames = [sensor.read().raw.reshape(-1).tolist() for _ in range(200)]
print(json.dumps(frames))
