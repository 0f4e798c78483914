"""modbus_tk's RTU master does what it is told; arguments and output as of ``pymodbus_steps.py``."""

import json
import sys

import modbus_tk.defines as cst
import modbus_tk.modbus
import serial
from modbus_tk import modbus_rtu

port, baud, unit, times, steps = sys.argv[1], *map(int, sys.argv[2:5]), json.loads(sys.argv[5])
master = modbus_rtu.RtuMaster(serial.Serial(port, baud))
master.set_timeout(2.0)
calls = {
    "write": lambda address, values: master.execute(unit, cst.WRITE_MULTIPLE_REGISTERS, address, output_value=values),
    "write_one": lambda address, value: master.execute(unit, cst.WRITE_SINGLE_REGISTER, address, output_value=value),
    "holding": lambda address, count: master.execute(unit, cst.READ_HOLDING_REGISTERS, address, count),
    "inputs": lambda address, count: master.execute(unit, cst.READ_INPUT_REGISTERS, address, count),
}
rounds = []
for _ in range(times):
    rounds.append([])
    for kind, address, argument in steps:
        try:
            answer = calls[kind](address, argument)
        except modbus_tk.modbus.ModbusError as error:
            rounds[-1].append(error.get_exception_code())
        else:
            if not kind.startswith("write"):
                rounds[-1].append(answer)
print(json.dumps(rounds))
