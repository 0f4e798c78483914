"""Read an AFT200 with the laboratory's driver, for ``tests.clients.record``.

PYTHONPATH=CHECKOUT:tests/clients/readers python aidin_rise.py      (canlib.py there stands in for Kvaser's)
"""

import json
import os

from rise_aft_can.sensors import AFT200D80


def main() -> None:
    """Read, set the rate, bias as the driver's example does, read again; all of it twice."""
    rows = []
    for count in (80, 40):
        with AFT200D80(0) as sensor:
            sensor.set_sampling_rate(200)
            sensor.set_continuous_transmitting()
            for _ in range(count):
                rows.append(list(sensor.read()))
            sensor.set_bias_setting()
            sensor.set_continuous_transmitting()
            sensor.wait_for_bias_info(timeout_sec=10)
            for _ in range(count):
                rows.append(list(sensor.read()))
            sensor.set_bias_clear()
    with open(os.environ["TACTEMU_ROWS"], "a") as file:
        file.writelines(json.dumps({"as": "wrench", "values": row}) + "\n" for row in rows)


main()
