"""pyrobotiqtactile: version, autosend, 200 frames with new timestamps."""

import json
import sys

from pyrobotiqtactile import RobotiqTactileSensor

with RobotiqTactileSensor(port=sys.argv[1]) as sensor:
    version = sensor.get_version()
    sensor.configure(update_period_ms=int(sys.argv[2]), synchronous=sys.argv[3] == "sync")
    seen = []
    while len(seen) < 200:
        reading = sensor.read_frame(timeout=2.0)
        stamps = reading.timestamp.tolist()
        if stamps[0] == stamps[1] > 0 and (not seen or seen[-1]["timestamp"] != stamps):
            seen.append(
                {
                    "pressure": reading.pressure.reshape(-1).tolist(),
                    "accelerometer": reading.accelerometer.tolist(),
                    "temperature": reading.temperature.tolist(),
                    "timestamp": stamps,
                }
            )
    sensor.configure(update_period_ms=0)

print(json.dumps({"version": version.hex(), "readings": seen}))
