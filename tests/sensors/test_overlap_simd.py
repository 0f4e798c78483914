"""The overlap of balls with an elastic layer on a CPU: eight cells at once read, bit for bit, what each reads alone."""

from contextlib import nullcontext

import numpy as np
import pytest

import tactemu as tt
from tactemu.plan.plan import Dtype
from tactemu.sensors.layer import compiled_layer


def readings(dtype: Dtype, friction: float) -> list[np.ndarray]:
    """All readings while two balls press, slide and turn, and one pose is not finite in one environment."""
    x = (np.arange(21) - 10) * 1e-3
    positions = np.stack([*np.meshgrid(x, x[:13]), np.full((13, 21), 0.005)], axis=-1)
    scene = tt.Scene(dt=1e-3)
    pad = scene.add_body(tt.Box(size=(0.05, 0.05, 0.01)), fixed=True, name="pad")
    balls = [scene.add_body(tt.Sphere(radius=r), name=f"ball {r}") for r in (0.006, 0.003)]
    skin = scene.add_sensor(tt.ElasticLayerTaxel(positions=positions, friction=friction), link=pad, name="skin")
    sim, seen = scene.build(3, dtype=dtype, seed=1), []
    for step in range(8):
        for k, ball in enumerate(balls):
            place = np.array([[0.004 - 0.01 * k + 1e-4 * step, -0.004, 0.0045 + (0.006, 0.003)[k]]] * 3)
            place[1] += (0.007, 0.002, -1e-3)
            if step == 6 and k == 0:
                place[2] = np.nan
            angle = 0.02 * step * (1 + k)
            sim.set_pose(ball, position=place, quaternion=(np.cos(angle), 0.3 * np.sin(angle), 0.0, np.sin(angle)))
        with nullcontext() if step != 6 else pytest.raises(tt.PoseError):
            sim.step()
        seen += [np.array(values) for values in skin.read()]
    return seen


@pytest.mark.parametrize("dtype, friction", [("float32", 0.5), ("float64", 0.0)])
def test_eight_cells_at_once_read_what_each_reads_alone(dtype, friction, monkeypatch):
    together = readings(dtype, friction)
    monkeypatch.setattr(compiled_layer, "is_ball_overlap", lambda *_: False)
    alone = readings(dtype, friction)
    assert all(np.array_equal(a, b, equal_nan=a.dtype.kind == "f") for a, b in zip(together, alone, strict=True))
    assert any(np.isnan(a.astype(float)).any() for a in alone)
