"""Models for the tests of engines of many environments, and the engines."""

import importlib.util

import pytest

import tactemu as tt

FINGER = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 0.1" pos="0 0 -0.5"/>
    <body name="hand" pos="0.1 0.2 0.3" euler="10 20 30">
      <freejoint/>
      <geom name="palm" type="box" size=".02 .03 .01" pos=".01 .02 0" euler="0 40 0" mass=".2"/>
      <body name="finger" pos="0.06 0 0.01">
        <joint name="bend" type="hinge" axis="0 1 0.3"/>
        <geom name="tip" type="capsule" size=".006 .02" pos="0.02 0 0.01" euler="30 0 0" mass=".05"/>
      </body>
    </body>
    <body name="ball" pos="0 0 0.02"><freejoint/><geom name="ball" type="sphere" size=".01" mass=".1"/></body>
  </worldbody>
</mujoco>
"""
DROP = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 0.1"/>
    <body name="ball" pos="0 0 0.02"><freejoint/><geom name="ball" type="sphere" size=".01" mass=".1"/></body>
  </worldbody>
</mujoco>
"""
ENGINES = {"mujoco-warp": tt.MujocoWarpEngine, "newton": tt.NewtonEngine}
BUILT = ["mujoco-warp", pytest.param("newton", marks=pytest.mark.nightly)]
"""Newton's solver compiles kernels for a minute where none are cached."""
NEEDS_ENGINES = pytest.mark.skipif(
    any(importlib.util.find_spec(name) is None for name in ("mujoco_warp", "newton")),
    reason="could not import mujoco_warp and newton: pip install 'tactemu[newton]'",
)
"""They are imported by the tests that use them: it takes seconds, in every process that collects the tests."""
