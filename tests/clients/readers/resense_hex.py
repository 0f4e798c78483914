"""Read 400 samples by the maker's library, in two goes: ``resense_hex.py PORT``."""

import json
import os
import sys

from resense.sensor import HEXSensor

sensor = HEXSensor(sys.argv[1])
with open(os.environ["TACTEMU_ROWS"], "a", buffering=1) as rows:
    for _ in range(2):
        assert sensor.connect()
        for _ in range(200):
            sample = sensor.record_sample()
            force, torque = sample.force, sample.torque
            values = [force.x, force.y, force.z, torque.x, torque.y, torque.z]
            rows.write(json.dumps({"as": "wrench", "values": values}) + "\n")
        sensor.disconnect()
