"""A pose with a component that is no number, or too large for its square, is an error and never "no contact"."""

import numpy as np
import pytest

import tactemu as tt


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e308])
@pytest.mark.parametrize("component", range(4))
@pytest.mark.parametrize("body", ["ball", "pad"])
def test_of_a_quaternion(body, component, value):
    scene = tt.Scene(dt=1e-3)
    bodies = {"pad": scene.add_body(tt.Box(size=(0.05, 0.05, 0.02)))}
    bodies["ball"] = scene.add_body(tt.Sphere(radius=0.01), position=(0, 0, 0.0195))
    skin = scene.add_sensor(tt.ContactDepthProbe(positions=[[0, 0, 0.01]], radius=1e-3), link=bodies["pad"])
    sim = scene.build()
    quaternion = [1.0, 0.0, 0.0, 0.0]
    quaternion[component] = value
    with pytest.raises(tt.TactemuError, match="finite"):
        sim.set_pose(bodies[body], quaternion=quaternion)
        sim.step()
        skin.read()
