"""Read two sensors with the repository's ``SensorReader``: ``tams_array.py PORT CHECKOUT``, 100 frames and 20 more."""

import json
import os
import sys
from pathlib import Path
from types import ModuleType

import yaml

checkout = Path(sys.argv[2])
sys.path.insert(0, str(checkout / "src" / "tams_tactile_sensor_array"))
sys.modules["bluetooth"] = ModuleType("bluetooth")  # imported, and not used on a serial port
from tactile_sensor_array_standalone import SensorReader  # noqa: E402  # pyright: ignore[reportMissingImports]

config = yaml.safe_load((checkout / "config" / "params_diana.yaml").read_text())["tactile"]
config["serial_port"] = sys.argv[1]
rows = open(os.environ["TACTEMU_ROWS"], "a", buffering=1)
for frames in (100, 20):
    reader = SensorReader(config)
    for _ in range(frames):
        number, values = reader.receive_one()
        rows.write(json.dumps({"as": f"sensor {number}", "values": values}) + "\n")
    reader.serial.close()
