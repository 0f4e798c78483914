"""``anyskin_read.py PACKAGE PORT COUNT``: frames as the driver decodes them, temperatures kept."""

import contextlib
import json
import sys

package, port, count = sys.argv[1], sys.argv[2], int(sys.argv[3])
with contextlib.redirect_stdout(sys.stderr):
    if package == "anyskin":
        from anyskin.sensor import AnySkinBase

        driver = AnySkinBase(num_mags=5, port=port, temp_filtered=False)
        readings = [sample[1:] for sample in driver.get_data(count)]
    else:
        from reskin_sensor.sensor import ReSkinBase

        driver = ReSkinBase(num_mags=5, port=port)
        readings = [sample.data for sample in driver.get_data(count)]
    driver.close()
print(json.dumps({"readings": [list(map(float, reading)) for reading in readings]}))
