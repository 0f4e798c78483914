"""modbus_tk's RTU master: the index finger's top matrix 200 times, an exception."""

import json
import sys

import modbus_tk.defines as cst
import modbus_tk.modbus
import serial
from modbus_tk import modbus_rtu

master = modbus_rtu.RtuMaster(serial.Serial(sys.argv[1], 115200))
master.set_timeout(2.0)
many = [master.execute(1, cst.READ_HOLDING_REGISTERS, 4128, 96) for _ in range(200)]
try:
    master.execute(1, cst.READ_HOLDING_REGISTERS, 65535, 1)
    refused = 0
except modbus_tk.modbus.ModbusError as error:
    refused = error.get_exception_code()
print(json.dumps({"many": many, "refused": refused}))
