"""tactile-pressure-sdk: who it is, 220 readings of all points both ways, another unit, units of mN, a zero."""

import json
import sys

from tactile_sdk import TactilePressureSDK

with TactilePressureSDK(sys.argv[1]) as sdk:
    got = {"info": vars(sdk.device.get_info()), "points": sdk.config.get_pressure_point_count()}
    got["area"] = sdk.config.get_sensor_point_area()
    got["many"] = [sdk.pressure.read_all().values if k % 2 else sdk.pressure.read_fast() for k in range(220)]
    sdk.config.set_pressure_value_type(1)
    got["newtons"] = sdk.pressure.read_all().values
    sdk.device.set_address(7)
    got["address"] = sdk.device.get_address()
    got["write_only"] = sdk.config.get_auto_zero_enable()
    sdk.config.trigger_dynamic_zero()
    got["mode"] = int(sdk.calibration.get_mode())
print(json.dumps(got))
