"""A skin at the world's origin and one body, for tests of what a probe reads."""

import numpy as np

import tactemu as tt


def scene_with(shape, model, *, link_shape=None, n_envs=None, dtype="float32", **poses):
    """``(sim, body, sensor)``: ``model`` on a fixed link at the origin, ``shape`` free to be posed."""
    scene = tt.Scene(dt=1e-3)
    link = scene.add_body(link_shape, fixed=True, name="link")
    body = scene.add_body(shape, name="body", **poses)
    sensor = scene.add_sensor(model, link=link, name="skin")
    return scene.build(n_envs, dtype=dtype), body, sensor


def depth_of(shape, points, radius, *, position=(0, 0, 0), quaternion=(1, 0, 0, 0), dtype="float32", **options):
    """What depth probes of this radius read at ``points`` in the body's pose given."""
    model = tt.ContactDepthProbe(positions=np.asarray(points, float), radius=radius, **options)
    sim, body, sensor = scene_with(shape, model, dtype=dtype)
    sim.set_pose(body, position=position, quaternion=quaternion)
    sim.step()
    return sensor.read()
