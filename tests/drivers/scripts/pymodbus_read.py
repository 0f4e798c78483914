"""pymodbus's synchronous RTU client: the palm 200 times, an exception, a silent unit, a write."""

import json
import logging
import sys

from pymodbus.client import ModbusSerialClient

logging.disable(logging.CRITICAL)
client = ModbusSerialClient(sys.argv[1], baudrate=115200, timeout=10, retries=0)
assert client.connect()
many = []
for _ in range(200):
    answer = client.read_holding_registers(4900, count=112, device_id=1)
    assert not answer.isError(), answer
    many.append(answer.registers)
refused = client.read_coils(0, count=1, device_id=1).exception_code
written = client.write_registers(1486, [0, 0, 0, 0, 0, 0], device_id=1)
assert not written.isError()
client.comm_params.timeout_connect = 0.2
try:
    silent = client.read_holding_registers(0, count=1, device_id=9).isError()
except Exception as error:
    silent = type(error).__name__ == "ModbusIOException"
client.close()
print(json.dumps({"many": many, "refused": refused, "silent": silent}))
