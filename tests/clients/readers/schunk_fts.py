"""Read a SCHUNK FTS with the vendor's library, for ``tests.clients.record``.

PYTHONPATH=CHECKOUT/schunk_fts_library python schunk_fts.py PORT STREAMING_PORT
"""

import json
import os
import sys
import time

from schunk_fts_library.driver import Driver

AXES = ("fx", "fy", "fz", "tx", "ty", "tz")


def main() -> None:
    """Stream twice, tare between."""
    rows = []
    time.sleep(1.0)  # until it has booted: the library gives up after 100 ms without readings
    for turn, count in enumerate((120, 60)):
        driver = Driver(host="127.0.0.1", port=int(sys.argv[1]), streaming_port=int(sys.argv[2]))
        assert driver.streaming_on(timeout_sec=1.0)
        for _ in range(count):
            data = driver.sample()
            if data is not None:
                rows.append({"as": "wrench", "values": [data[axis] for axis in AXES]})
        status = driver.get_status()
        told = [driver.name, driver.hardware_id, vars(status)]
        told += [driver.get_parameter("0001", "00").param_value, driver.get_parameter("9999", "ff").error_code]
        told += [driver.set_parameter("00", "0050").error_code]
        answers = [driver.tare(), driver.tare_reset(), driver.select_tool_setting(1), driver.select_noise_filter(0)]
        told += [answer.error_code for answer in answers]
        rows.append({"as": f"name, id, status, parameters, errors {turn + 1}", "value": told})
        driver.streaming_off()
    with open(os.environ["TACTEMU_ROWS"], "a") as file:
        file.writelines(json.dumps(row) + "\n" for row in rows)


main()
