"""ft300python: the stream, then, after the stop that its object sends at its end, Modbus."""

import json
import sys
import time

from ft300python import FT300ModbusRTU, FT300Stream

port, count = sys.argv[1], int(sys.argv[2])
stream = FT300Stream(port, 1, zero_reset=False)
streamed = [stream.get_force_torque_raw() for _ in range(count)]
del stream
time.sleep(0.2)  # a pty does not wait, where a port is closed, until what was written has gone
modbus = FT300ModbusRTU(port, 1, zero_reset=False)
asked = [modbus.get_force_torque_raw() for _ in range(count)]
accelerations = [modbus.get_acceralation() for _ in range(count)]
about = [modbus.get_production_year(), modbus.get_serial_number()]
modbus.disconnect()
print(json.dumps({"streamed": streamed, "asked": asked, "accelerations": accelerations, "about": about}))
