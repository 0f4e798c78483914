"""A program with episodes, as a user writes it, under pyright's strict rules. Read by pyright, never run."""

# pyright: strict

import numpy as np

import tactemu as tt
from tactemu import Pose


class Mine:
    """A motion of the user's own."""

    def pose(self, t_s: float) -> Pose:
        """Return the pose at a time."""
        return Pose(np.zeros(3))


scene = tt.Scene()
ball = scene.add_body(
    tt.Sphere(radius=0.01), name="ball", motion=tt.Press(depth=1e-3), quaternion=(0, 0, 0, 1), order="xyzw"
)
scene.add_body(tt.Sphere(radius=0.01), motion=tt.FromFunction(function=lambda t: (0, 0, -2 * t)))
scene.add_body(tt.Sphere(radius=0.01), motion=Mine())
sim = scene.build(4)
sim.step(10)
sim.step(dt=1e-3)
sim.set_pose("ball", position=(0, 0, 1), quaternion=np.ones(4), order="xyzw", envs=[1])
sim.release(ball)
sim.reset([1])
sim.reset(np.array([True, False, True, True]))
t: float = sim.time
e = sim.env_time
p = sim.pose("ball", 2).position
sim.bind_poses(position=np.zeros((4, 1, 3)), index={ball: 0})
print(t, e.shape, p, sim.pose_array)
