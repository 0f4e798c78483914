"""Skins without a wire: many environments at once, measured values beside true ones.

There are eight fingertips of 16 x 16 taxels with worn sensors; a ball presses each to a different depth.
"""

from __future__ import annotations

import numpy as np

import tactemu as tt

N_ENVS, RADIUS = 8, 0.01
TOP = 0.005


def build():
    """Build a pad with a worn skin and a ball that the caller poses; return simulation, ball and skin."""
    line = np.linspace(-0.008, 0.008, 16)
    grid = np.stack([*np.meshgrid(line, line), np.full((16, 16), TOP - 0.001)], axis=-1)
    scene = tt.Scene(dt=1e-3)
    pad = scene.add_body(tt.Box(size=(0.02, 0.02, 2 * TOP)), fixed=True, name="pad")
    ball = scene.add_body(tt.Sphere(radius=RADIUS), name="ball")
    skin = scene.add_sensor(
        tt.KinematicTaxel(
            positions=grid,
            radius=0.001,
            normal_stiffness=400.0,
            imperfections=tt.ImperfectionOptions(hysteresis_strength=0.1, dead_taxel_probability=0.02),
            electronics=tt.ElectronicsOptions(noise=0.002),
        ),
        link=pad,
    )
    return scene.build(n_envs=N_ENVS, seed=3), ball, skin


def main() -> None:
    """Press every skin, and print its total force."""
    sim, ball, skin = build()
    print(sim.plan, "\n")
    depths = np.linspace(0.0, 1.4e-3, N_ENVS)
    for share in np.linspace(0.0, 1.0, 100):
        height = TOP + RADIUS + 1e-3 - share * (1e-3 + depths)
        sim.set_pose(ball, position=np.stack([0 * depths, 0 * depths, height], axis=-1))
        sim.step()
    measured, true = skin.read()[0], skin.read_ground_truth()[0]
    print("depth [mm]   true [N]   measured [N]")
    for depth, f_true, f_measured in zip(depths, true[..., 2].sum((1, 2)), measured[..., 2].sum((1, 2)), strict=True):
        print(f"{depth * 1e3:10.2f} {f_true:10.3f} {f_measured:14.3f}")


if __name__ == "__main__":
    main()
