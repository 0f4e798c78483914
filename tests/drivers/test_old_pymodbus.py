"""pymodbus of earlier years, each in an environment of its own: they send unit 0 or 1 unless told otherwise."""

import json
import subprocess

import pytest

import tactemu as tt
from tests.drivers.environments import python_with
from tests.drivers.rig import EQUAL

pytestmark = [pytest.mark.driver, pytest.mark.realtime, pytest.mark.timeout(180)]

READ = """
import json, sys, time
try:
    from pymodbus.client.sync import ModbusTcpClient
except ImportError:
    from pymodbus.client import ModbusTcpClient
client = ModbusTcpClient(sys.argv[1], port=int(sys.argv[2]))
assert client.connect()
begun = time.monotonic()
rows = [client.read_holding_registers(3000, 60) for _ in range(200)]
written = client.write_registers(1486, [300, -1 & 0xFFFF])
back = client.read_holding_registers(1486, 2)
print(json.dumps({
    "bad": sum(row.isError() for row in rows), "rows": [row.registers for row in rows if not row.isError()],
    "written": not written.isError(), "back": back.registers, "seconds": time.monotonic() - begun,
}))
"""


@pytest.mark.judge("inspire_rh56dftp", driver="pymodbus", environment="environment", carrier="TCP, Modbus")
@pytest.mark.parametrize("environment", ["pymodbus_2_5", "pymodbus_3_6"])
def test_the_default_unit_is_answered(environment):
    """By its registers; every row is what the hand last converted."""
    python = python_with(environment)
    with tt.serve("inspire_rh56dftp", "tcp:127.0.0.1:0", rate_hz=200) as dev:
        host, _, port = dev.port.removeprefix("socket://").rpartition(":")
        dev.press(depth=5e-4, taxel=20)
        done = subprocess.run(
            [python, "-c", READ, host, port], capture_output=True, text=True, timeout=120, check=False
        )
        assert done.returncode == 0, done.stderr
        got = json.loads(done.stdout)
        truth = {tuple(sample.counts[:60].tolist()) for sample in dev.truth.samples}
    assert got["bad"] == 0 and len(got["rows"]) == 200 and got["written"] and got["back"] == [300, 0xFFFF]
    assert any(any(row) for row in got["rows"]), "the press is seen"
    assert {tuple(row) for row in got["rows"]} <= truth
    EQUAL.append(len(got["rows"]))
