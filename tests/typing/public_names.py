"""What a type checker must see of ``tactemu``. Read by pyright with the packages, never run.

An expectation that does not hold is an error there, as is a mistake that it does not find.
"""

# pyright: reportUnnecessaryTypeIgnoreComment=error

from typing import assert_type

import numpy as np
from numpy.typing import NDArray

import firmware_protocols as fp
import tactemu as tt
from tactemu import devices, models
from tactemu.integrations.pytest_plugin import TactileDevice
from tactemu.transducers.piezoresistive import Piezoresistive

scene = tt.Scene(dt=1e-3)
assert_type(scene, tt.Scene)
assert_type(scene.add_body(tt.Sphere(radius=0.01)), tt.Body)
skin = scene.add_sensor(tt.ContactDepthProbe(positions=[(0.0, 0.0, 0.0)]), link="pad")
assert_type(skin, tt.Sensor[NDArray[np.floating]])
assert_type(scene.add_sensor(tt.KinematicTaxel(), link="pad").read(), tt.ForceTorque)
assert_type(scene.add_sensor(tt.ElasticLayerTaxel(), link="pad").read().slip, NDArray[np.int8])
assert_type(scene.add_sensor(tt.ContactProbe(), link="pad").read(), NDArray[np.bool_])
cells = [Piezoresistive()]
assert_type(scene.add_sensor(tt.ElasticLayerTaxel(), link="pad", transducers=cells).read(), NDArray[np.floating])
assert_type(scene.build(), tt.Simulation)

with tt.serve("anyskin", faults=["flip 5%"]) as dev:
    assert_type(dev, tt.Served)
    assert_type(dev.port, str)
    assert_type(dev.truth, tt.Truth)

assert_type(fp.create("anyskin"), fp.Device)
assert_type(tt.__version__, str)
assert_type(devices.create("anyskin"), fp.Device)
assert_type(fp.sums.xor8(b""), int)
assert_type(devices.modbus.Banks(), fp.modbus.Banks)
assert_type(models.model_class("contact_probe"), type[models.SensorModel])


def test_my_driver(tactile_device: TactileDevice):
    assert_type(tactile_device("anyskin", rate_hz=100), tt.Served)


unknown = tt.Spehre  # pyright: ignore[reportAttributeAccessIssue]
wrong = tt.Sphere(radius="1 cm")  # pyright: ignore[reportArgumentType]
