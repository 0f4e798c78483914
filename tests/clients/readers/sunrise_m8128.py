"""Read an M8128 with PyForce, for ``tests.clients.record``.

PYTHONPATH=CHECKOUT python sunrise_m8128.py PORT        with NumPy and Matplotlib
"""

import json
import os
import sys
import time

from pyforce import ForceSensor


def main() -> None:
    """Query, set, stream; twice."""
    rows = []
    for turn, count in enumerate((100, 40)):
        sensor = ForceSensor("127.0.0.1", int(sys.argv[1]))
        assert sensor.connect()
        told = {name: answer.decode() for name, answer in sensor.query_info().items()}
        assert sensor.set_sample_rate(50) and sensor.set_compute_unit() and sensor.set_data_format()
        assert sensor.start_stream()
        while sensor.read() is None:
            time.sleep(0.001)
        for _ in range(count):
            rows.append({"as": "wrench", "values": sensor.read().astype(float).tolist()})
            time.sleep(0.02)
        rows.append({"as": f"queried {turn + 1}", "value": told})
        assert sensor.stop_stream() and sensor.disconnect()
    with open(os.environ["TACTEMU_ROWS"], "a") as file:
        file.writelines(json.dumps(row) + "\n" for row in rows)


main()
