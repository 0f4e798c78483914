"""Unmodified drivers below the whole of tactemu: scene, noise, sampling, firmware, paced wire, transport, truth log.

Every taxel carries noise, so that each reading names the sample it was made from.
"""

import numpy as np
import pytest

import tactemu
from tests.drivers.rig import assert_consecutive, run_driver
from tests.drivers.test_ability_hand import documented_force
from tests.drivers.test_flexitac_optoforce import SCALE
from tests.drivers.test_inspire_rh56dftp import INDEX_TOP, PALM
from tests.scenes import ball, pad

pytestmark = [pytest.mark.driver, pytest.mark.timeout(120)]

SCENE = (
    """
[scene]
dt = 0.001
"""
    + pad(0.01, 0.01, 0.01, more="position = [0.0, 0.0, -0.02]")
    + ball(0.05, [0.0, 0.0, 0.05], 'motion = {{ kind = "press", depth = 0.002, speed = 0.01, repeat = 0 }}')
    + """

[[skin]]
name = "skin"
device = "{device}"
link = "pad"
position = [0.0, 0.0, 0.02]
rate_hz = {rate_hz}
device_options = {{ {device_options} }}
options = {{ noise = {noise} }}
"""
)

TOUCH_FORCE = [documented_force(count) for count in range(4096)]


@pytest.fixture
def serve(tmp_path):
    def start(device, port=None, *, rate_hz=100, noise=0.1, device_options=""):
        path = tmp_path / "scene.toml"
        path.write_text(SCENE.format(device=device, rate_hz=rate_hz, noise=noise, device_options=device_options))
        return tactemu.serve(path, port)

    return start


def counts_of(served):
    return [sample.counts for sample in served.truth.samples]


@pytest.mark.judge("robotiq_tsf85", driver="pyrobotiqtactile", carrier="USB serial, packets")
def test_pyrobotiqtactile(serve):
    with serve("robotiq_tsf85") as dev:
        got = run_driver("pyrobotiqtactile", "pyrobotiqtactile_read.py", dev.port, 10, "sync")
    assert_consecutive([reading["pressure"] for reading in got["readings"]], counts_of(dev))


@pytest.mark.judge("ability_hand", driver="ability-hand", carrier="serial, PPP", every_run=True)
def test_ability_hand(serve, tmp_path):
    with serve("ability_hand", rate_hz=250, noise=1.0) as dev:
        got = run_driver("ah_wrapper", "ability_hand_read.py", dev.port, 0, cwd=tmp_path)
    assert_consecutive(got["fsr"], counts_of(dev), decode=lambda counts: [TOUCH_FORCE[c] for c in counts])


@pytest.mark.judge("inspire_rh56dftp", driver="plusml-rh56dftp", carrier="TCP, Modbus", every_run=True)
def test_plusml_rh56dftp(serve, tmp_path):
    with serve("inspire_rh56dftp", "tcp:127.0.0.1:0", noise=0.5) as dev:
        address = "{}:{}".format(*dev.host_port)
        got = run_driver("RH56DFTP", "plusml_rh56dftp_read.py", address, cwd=tmp_path)
    readings = [values[:96] for values in got["many"]]
    assert_consecutive(readings, counts_of(dev), decode=lambda counts: counts[INDEX_TOP])


RTU = "RS-485, Modbus"


@pytest.mark.parametrize(
    ("package", "where", "refused"),
    [
        pytest.param(
            "pymodbus",
            PALM,
            1,
            marks=pytest.mark.judge("inspire_rh56dftp", driver="pymodbus", carrier=RTU, every_run=True),
        ),
        pytest.param(
            "modbus_tk", INDEX_TOP, 2, marks=pytest.mark.judge("inspire_rh56dftp", driver="modbus_tk", carrier=RTU)
        ),
    ],
)
def test_modbus_rtu(serve, package, where, refused):
    with serve("inspire_rh56dftp", noise=0.5) as dev:
        got = run_driver(package, f"{package}_read.py", dev.port)
    assert_consecutive(got["many"], counts_of(dev), decode=lambda counts: counts[where])
    assert got["refused"] == refused and got.get("silent", True)


@pytest.mark.judge("flexitac", driver="flexitac", carrier="serial, marker", every_run=True)
def test_flexitac(serve):
    with serve("flexitac", noise=0.1) as dev:
        frames = run_driver("flexitac", "flexitac_read.py", dev.port)
    assert_consecutive(frames, counts_of(dev))


OPTOFORCE = {"driver": "optoforce", "carrier": "USB serial, packets"}


@pytest.mark.parametrize(
    ("axes", "kind"),
    [
        pytest.param("3", "OptoForce16", marks=pytest.mark.judge("optoforce", **OPTOFORCE, every_run=True)),
        pytest.param("4x3", "OptoForce34", marks=pytest.mark.judge("optoforce", **OPTOFORCE)),
    ],
)
def test_optoforce(serve, axes, kind):
    with serve("optoforce", noise=20.0, device_options=f'axes = "{axes}"') as dev:
        packets = run_driver("optoforce", "optoforce_read.py", dev.port, kind)
    assert all(packet["valid_checksum"] for packet in packets)
    values = [[v for name, v in packet.items() if name[0] == "F"] for packet in packets]
    assert_consecutive(values, counts_of(dev), decode=lambda counts: (counts * SCALE).reshape(-1))
    assert np.ptp(values, axis=0).min() > 0
