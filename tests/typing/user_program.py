"""A program as a user writes it, which passes the strict rules; read by pyright with the packages, never run."""

# pyright: strict

import numpy as np

import tactemu as tt

x = np.linspace(-0.01, 0.01, 16)
grid = np.stack([*np.meshgrid(x, x), np.full((16, 16), 0.01)], axis=-1)

scene = tt.Scene(dt=1e-3)
pad = scene.add_body(tt.Box(size=(0.08, 0.08, 0.02)), name="pad", fixed=True)
ball = scene.add_body(tt.Sphere(radius=0.01), position=(0, 0, 0.022), motion=tt.Press(approach=0.002, depth=0.001))
tool = scene.add_body(tt.Capsule(radius=0.01, length=0.02), position=(0, 0, 0.1))
skin = scene.add_sensor(tt.KinematicTaxel(positions=grid, radius=0.001, normal_stiffness=400.0), link=pad)
layer = scene.add_sensor(tt.ElasticLayerTaxel(positions=grid), link="pad")
probe = scene.add_sensor(tt.ContactProbe(positions=grid, electronics=tt.ElectronicsOptions(noise=1e-5)), link=pad)
sim = scene.build(n_envs=64)
for _ in range(250):
    sim.step()
sim.set_pose(tool, position=(0, 0, 0.0199), envs=[1])
sim.set_pose("ball", position=np.zeros((64, 3)), quaternion=[1, 0, 0, 0])
sim.bind_poses(position=np.zeros((64, 3, 3)), index={tool: 2})
sim.step(5)
sim.reset([1, 2])

force, torque = skin.read()
truth = skin.read_ground_truth()
print(force.sum(), torque.max() - truth.torque.max(), layer.read().slip.max(), int(probe.read().sum()))
print(skin.touching(tool).any(), skin.positions.shape, skin.normals[0, 0], skin.n_taxels, skin.layout, skin.unit)
on_device = np.from_dlpack(skin.arrays.force)
mine = skin.host_array()
skin.read(out=mine)
skin.read(out=np.zeros((64, 256, 6), np.float32))
probe.set("noise", 2e-5, envs=[3])
probe.set_dead([0, 1], envs=np.array([True] * 64))
probe.set_noise(1e-5)
print(on_device.mean(), sim.pose(tool).position, sim.time)

with tt.serve("anyskin", seed=7, faults=["drop 1%"]) as dev:
    dev.press(depth=1e-3, dwell=0.5)
    print(dev.sample().measured, dev.sample().counts, dev.port, dev.truth.injected)
with tt.connect() as running:
    print(running.sample().measured, running.state())
print(tt.read_log("truth.mcap")["anyskin"].counts.shape)
