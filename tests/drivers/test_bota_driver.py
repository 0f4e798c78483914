"""bota-driver 1.1.16, the vendor's library, unmodified, reads a SensONE from a bare pty."""

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols.check.readings import reading_of
from tests.drivers.rig import Rig, assert_consecutive, run_driver

pytestmark = [
    pytest.mark.judge("bota_sensone", driver="bota-driver", environment="bota_driver", carrier="serial"),
    pytest.mark.driver,
    pytest.mark.timeout(120),
]


class Pulled(Rig):
    """Every sample another force, torque and temperature, along all axes."""

    def reading(self, stream):
        wrench = self._random.uniform(-1, 1, 6) * [300, 300, 300, 9, 9, 9]
        return reading_of(self.device, 0.0, stream, wrench=wrench, temperature=self._random.uniform(20, 60))


@pytest.mark.parametrize(("sinc_length", "step_us"), [(512, 10_000), (256, 5_000)])
def test_200_readings(sinc_length, step_us):
    with Pulled(fp.create("bota_sensone", serial_number=123), paced_by_driver=True) as rig:
        got = run_driver(
            "bota_driver", "bota_driver_read.py", rig.port, 220, sinc_length, seconds=60, environment="bota_driver"
        )

    def sent(counts):
        felt = counts.item()
        return [*felt["wrench"][0], *felt["temperature"]]

    places = assert_consecutive(got["readings"], rig.truth, decode=sent)
    assert np.diff(places[10:]).max() <= 1, "once it reads, it loses none"
    assert got["times"] == [rig.sampled_ns[place] // 1000 for place in places]
    assert set(got["statuses"]) == {0} and got["step_us"] == step_us == rig.device.period_ns // 1000
    assert rig.device.offset.tolist() == [1.5, 0, 0, 0, 0, -0.25] and not rig.device.running
