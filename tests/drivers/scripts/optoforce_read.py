"""optoforce: configure, then 200 packets."""

import json
import sys

import optoforce

kind = getattr(optoforce, sys.argv[2])
with kind(port=sys.argv[1], speed_hz=333, filter_hz=15) as sensor:
    packets = [sensor.read(only_latest_data=False)._asdict() for _ in range(200)]
print(json.dumps(packets))
