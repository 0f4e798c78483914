"""A turned skin gives the device vectors in the device's frame, and its chips feel gravity, motion and warmth there."""

import numpy as np
import pytest

import tactemu as tt
from firmware_protocols import grid_layout
from tactemu.base.option_groups import from_flat
from tactemu.geometry import rotation
from tactemu.geometry.motion import Pose
from tactemu.scene import file
from tactemu.scene.building import build_scene, make_devices
from tactemu.scene.placement import PlacedSensor
from tactemu.scene.skins import SkinPart
from tests.scenes import ball, pad

SCENE = (
    pad(0.04, 0.04, 0.04)
    + ball(0.01, "{ball}")
    + """
[[skin]]
device = "xela_uskin"
link = "pad"
position = {at}
quaternion = {turn}
model = "kinematic_taxel"
"""
)
QUARTER = [0.5**0.5, 0.0, 0.5**0.5, 0.0]  # about y: the skin's +z becomes the link's +x


def force(at, turn, ball):
    loaded = file.parse(SCENE.format(at=at, turn=turn, ball=ball))
    scene, sensors = build_scene(loaded, make_devices(loaded))
    sim = scene.build()
    sim.step()
    return sensors["xela_uskin"].quantity("force")


def test_a_turned_skin_reads_as_an_upright_one():
    upright = force([0.0, 0.0, 0.02], [1.0, 0.0, 0.0, 0.0], [0.001, 0.002, 0.0285])
    turned = force([0.02, 0.0, 0.0], QUARTER, [0.0285, 0.002, -0.001])
    assert upright[:, 2].min() < -0.1  # a push, along minus the normal
    assert np.allclose(turned, upright, atol=1e-5)


class Shaken:
    """x = 1 mm sin(2 pi 5 t), turning about z at 2 rad/s."""

    w = 2 * np.pi * 5

    def pose(self, t_s):
        x, v = 1e-3 * np.sin(self.w * t_s), 1e-3 * self.w * np.cos(self.w * t_s)
        turn = rotation.from_rotation_vector((0, 0, 2.0 * t_s))
        return Pose(np.array([x, 0, 0.0]), turn, np.array([v, 0, 0.0]), np.array([0, 0, 2.0]))


def on_link(sensor, turn=(1.0, 0.0, 0.0, 0.0)):
    """A sensor as a skin whose device is turned on the link."""
    layout = grid_layout(4, 4, 0.004)
    return PlacedSensor(sensor, SkinPart("skin", layout, np.arange(16), ("",), "pad", (0.0, 0.0, 0.0), turn))


def placed(turn=(1.0, 0.0, 0.0, 0.0), motion=None, **options):
    scene = tt.Scene(dt=1e-3)
    pad = scene.add_body(tt.Box(size=(0.04, 0.04, 0.04)), motion=motion)
    scene.add_body(tt.Sphere(radius=0.01))
    positions = grid_layout(4, 4, 0.004).positions
    model = from_flat(tt.KinematicTaxel, {"positions": positions, **options})
    return on_link(scene.add_sensor(model, link=pad), turn)


def test_gravity_follows_the_skin():
    assert np.allclose(placed().ambient("acceleration", 0), (0, 0, 9.80665))
    # the device's z lies along the link's x, so the link's up is the device's minus x
    assert np.allclose(placed(QUARTER).ambient("acceleration", 0), (-9.80665, 0, 0))


def test_a_moving_link_is_felt_in_its_own_frame():
    moving = placed(motion=Shaken())
    expected = rotation.rotate(
        rotation.from_rotation_vector((0, 0, -0.06)), (-1e-3 * Shaken.w**2 * np.sin(Shaken.w * 0.03), 0, 9.80665)
    )
    assert np.allclose(moving.ambient("acceleration", 30_000_000), expected, atol=1e-4)
    assert np.allclose(moving.ambient("angular_velocity", 30_000_000), (0, 0, 2.0))


def test_a_link_posed_by_hand_is_felt_as_told():
    scene = tt.Scene(dt=1e-3)
    pad = scene.add_body(tt.Box(size=(0.04, 0.04, 0.04)))
    sensor = on_link(scene.add_sensor(tt.KinematicTaxel(), link=pad))
    sim = scene.build()
    told = {"quaternion": QUARTER, "angular_velocity": (0, 0, 2.0)}
    for k, speed in enumerate((0.0, 0.02, 0.05)):
        sim.set_pose(pad, linear_velocity=(0, 0, speed), **told)
        sim.step()
        acceleration = sensor.ambient("acceleration", 10_000_000 * k)
    assert np.allclose(acceleration, (-3.0 - 9.80665, 0, 0))  # 0.03 m/s more in 10 ms; z is the device's -x
    assert np.allclose(sensor.ambient("angular_velocity", 0), (-2.0, 0, 0))


def test_temperature_follows_its_course():
    sensor = placed(temperature_course=[(0, 25), (10, 45)], temperature_offset=1e-3)
    assert sensor.ambient("temperature", 5_000_000_000) == pytest.approx(35.0)
    assert placed().ambient("temperature", 0) == 25.0
