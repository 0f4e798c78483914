"""i2cdriver: SingleTact's settings from 0 on in one long read, then readings as the vendor's demo asks for them."""

import json
import sys
import time

from i2cdriver import I2CDriver

ADDRESS = 4
bus = I2CDriver(sys.argv[1])
found = [address for address in (ADDRESS, ADDRESS + 1) if bus.start(address, 0)]
bus.stop()


def read(location, count):
    assert bus.start(ADDRESS, 0) and bus.write([0x01, location, count])
    bus.stop()
    assert bus.start(ADDRESS, 1)
    data = bus.read(count)
    bus.stop()
    return data


settings = read(0, 128)
readings = {}  # by their number: the host may ask twice for one
while len(readings) < int(sys.argv[2]):
    data = read(128, 6)
    readings[data[:2]] = list(data)
    time.sleep(0.004)
bus.start(ADDRESS, 1)
print(
    json.dumps(
        {"found": found, "settings": list(settings), "readings": list(readings.values()), "unasked": list(bus.read(6))}
    )
)
