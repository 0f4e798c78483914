"""A skin on a MuJoCo body: a ball drops on a tilted pad and rolls off; MuJoCo moves it, tactemu computes the taxels.

pip install 'tactemu[mujoco]'
python examples/mujoco_skin.py
"""

import mujoco
import numpy as np

import tactemu as tt

XML = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <body name="pad" euler="0 1 0">
      <geom name="pad" type="box" size="0.03 0.02 0.01" friction="0.8"/>
    </body>
    <body name="ball" pos="-0.02 0 0.025">
      <freejoint/>
      <geom name="ball" type="sphere" size="0.01" mass="0.05"/>
    </body>
  </worldbody>
</mujoco>
"""
SHADES = " .:-=+*#%@"


def picture(pressure: np.ndarray) -> str:
    """Draw the rows of the skin as text: the darker, the larger the pressure."""
    level = (pressure / max(pressure.max(), 1e-9) * (len(SHADES) - 1)).astype(int)
    return "\n".join("  " + "".join(SHADES[v] * 2 for v in row) for row in level)


def main() -> None:
    model = mujoco.MjModel.from_xml_string(XML)
    data = mujoco.MjData(model)
    scene = tt.Scene(dt=model.opt.timestep)
    source = tt.MujocoSource(scene, model)
    x, y = np.linspace(-0.028, 0.028, 29), np.linspace(-0.018, 0.018, 19)
    grid = np.stack([*np.meshgrid(x, y), np.full((19, 29), 0.01)], -1)
    taxels = tt.KinematicTaxel(positions=grid, radius=5e-4, normal_stiffness=300.0)
    skin = scene.add_sensor(taxels, link=source.geom("pad"))
    sim = scene.build()
    for step in range(400):
        mujoco.mj_step(model, data)
        source.update(sim, data)
        sim.step()
        if step % 80 == 79:
            force = skin.read().force
            total = force.sum((0, 1))
            where = f"t = {sim.time_ns * 1e-9:.2f} s, ball at x = {data.qpos[0] * 1e3:5.1f} mm"
            print(f"{where}, force on the skin {np.round(total, 3)} N")
            print(picture(-force[..., 2].clip(max=0)))


if __name__ == "__main__":
    main()
