import subprocess
import sys
from pathlib import Path

import pytest

KIT = ("adc", "dbc", "framing", "idl", "motors", "registers", "sums", "tables")
PROTOCOLS = ("eb90", "feetech", "http", "modbus")
FORBIDDEN = ("tactemu", "pymodbus", "scservo_sdk", "cantools", "warp", "trimesh", "can", "serial")

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("module", [*KIT, *(f"protocols.{name}" for name in PROTOCOLS)])
def test_the_kit_needs_numpy_crcmod_and_h11_alone(module):
    script = f"import sys; sys.modules.update(dict.fromkeys({FORBIDDEN})); import firmware_protocols.{module}"
    result = subprocess.run([sys.executable, "-c", script], check=False, cwd=ROOT, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
