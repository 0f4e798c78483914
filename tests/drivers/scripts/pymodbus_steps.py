"""pymodbus's synchronous RTU client does what it is told: PORT BAUD UNIT TIMES STEPS.

Steps are JSON: ``["write", address, numbers]``, ``["write_one", address, number]``, ``["holding" or "inputs", address,
count]``. Printed are the registers of every read by round; of what is refused the exception's code.
"""

import json
import logging
import sys

from pymodbus.client import ModbusSerialClient

logging.disable(logging.CRITICAL)
port, baud, unit, times, steps = sys.argv[1], *map(int, sys.argv[2:5]), json.loads(sys.argv[5])
client = ModbusSerialClient(port, baudrate=baud, timeout=2, retries=0)
assert client.connect()
calls = {
    "write": lambda address, values: client.write_registers(address, values, device_id=unit),
    "write_one": lambda address, value: client.write_register(address, value, device_id=unit),
    "holding": lambda address, count: client.read_holding_registers(address, count=count, device_id=unit),
    "inputs": lambda address, count: client.read_input_registers(address, count=count, device_id=unit),
}
rounds = []
for _ in range(times):
    rounds.append([])
    for kind, address, argument in steps:
        answer = calls[kind](address, argument)
        if answer.isError():
            rounds[-1].append(answer.exception_code)
        elif not kind.startswith("write"):
            rounds[-1].append(answer.registers)
client.close()
print(json.dumps(rounds))
