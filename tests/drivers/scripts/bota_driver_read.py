"""bota-driver: configures a sensor of generation 0, reads what was asked for; its log goes to stdout, ours last."""

import json
import sys

import bota_driver

port, count, sinc_length = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
config = bota_driver.BotaDriverConfig()
config.product_name, config.serial_number = "BFT-SENS-SER-M8", "SN000123"
config.communication_interface_name = "Bota_Binary_gen0"
line = bota_driver.BotaBinaryCommunicationInterfaceConfig()
line.com_port = port
config.binary_communication_interface_params = line
operation, offset = bota_driver.Gen0SensorOperationConfig(), bota_driver.WrenchOffset()
offset.fx, offset.tz = 1.5, -0.25
operation.sinc_length, operation.wrench_offset = sinc_length, offset
config.gen0_sensor_operation_params = operation

driver = bota_driver.BotaDriver(config)
assert driver.configure() and driver.activate()
step_us = driver.get_expected_timestep_us()
frames = [driver.read_frame_blocking() for _ in range(count)]
readings = [[*frame.force, *frame.torque, frame.temperature] for frame in frames]
times = [frame.timestamp for frame in frames]
statuses = [frame.status.val for frame in frames]
assert driver.deactivate() and driver.shutdown()
del driver
print(json.dumps({"step_us": step_us, "readings": readings, "times": times, "statuses": statuses}))
