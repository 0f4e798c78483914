"""NetFT: single measurements, then a stream; the address, whose port is always 49152."""

import json
import sys

from NetFT import Sensor

sensor = Sensor(sys.argv[1])
sensor.sock.settimeout(5)
single = [sensor.getMeasurement() for _ in range(200)]
sensor.startStreaming(handler=False)
streamed = [sensor.receive() for _ in range(200)]
sensor.stopStreaming()
print(json.dumps({"single": single, "streamed": streamed}))
