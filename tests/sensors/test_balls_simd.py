"""Probes near balls on a CPU: eight at once read, bit for bit, what each of them reads alone."""

from contextlib import nullcontext

import numpy as np
import pytest

import tactemu as tt
from tactemu.plan.plan import Dtype
from tactemu.sensors.probes import strips

N_ENVS = 5
MODELS = {
    "depth": lambda **options: tt.ContactDepthProbe(**options),
    "touch": lambda **options: tt.ContactProbe(**options),
    "springs": lambda **options: tt.KinematicTaxel(**options),
    "still springs": lambda **options: tt.KinematicTaxel(
        normal_damping=0.0, shear_scalar=0.0, twist_scalar=0.0, **options
    ),
    "Hertzian springs": lambda **options: tt.KinematicTaxel(normal_exponent=1.5, clamp_adhesion=True, **options),
}


def positions(n: int) -> np.ndarray:
    """A bent skin of ``n`` probes, of which one is the centre of a ball."""
    angle = np.linspace(-0.7, 0.7, n)
    points = np.stack([0.02 * np.sin(angle), 0.002 * np.cos(9 * angle), 0.02 * np.cos(angle)], axis=-1)
    points[n // 2] = (0.001, 0.0, 0.021)
    return points


def radii(n: int) -> np.ndarray:
    """Radii of ``n`` probes; every seventh is a filler."""
    return np.where(np.arange(n) % 7 == 3, 0.0, np.linspace(1e-3, 3e-3, n))


def readings(model, n: int, dtype: Dtype, imperfections) -> list[np.ndarray]:
    """All readings of steps in which three balls move, and the pose of one is not finite in one environment."""
    scene = tt.Scene(dt=1e-3)
    pad = scene.add_body(fixed=True, name="pad")
    balls = [scene.add_body(tt.Sphere(radius=r), name=f"ball {r}") for r in (0.004, 0.006, 0.003)]
    skin = model(positions=positions(n), radius=radii(n), imperfections=imperfections)
    sensor = scene.add_sensor(skin, link=pad, name="skin")
    sim = scene.build(N_ENVS, dtype=dtype, seed=3)
    random, seen = np.random.default_rng(5), []
    for step in range(6):
        for ball in balls:
            place = random.uniform(-1, 1, (N_ENVS, 3)) * (0.015, 0.002, 0.003) + (0.0, 0.0, 0.021)
            if step == 4 and ball is balls[1]:
                place[2] = np.nan
            if step == 5 and ball is balls[0]:
                place[1] = (0.001, 0.0, 0.021)
            sim.set_pose(ball, position=place, linear_velocity=(0.1, 0.02, -0.1), angular_velocity=(1.0, 0.5, 3.0))
        with nullcontext() if step != 4 else pytest.raises(tt.PoseError):
            sim.step()
        for reading in (sensor.read(), sensor.read_ground_truth()):
            seen += list(reading) if isinstance(reading, tuple) else [reading]
    return [np.array(each) for each in seen]


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("name", MODELS)
def test_eight_at_once_read_what_each_reads_alone(name, dtype, monkeypatch):
    noisy = tt.ImperfectionOptions(gain_range=(0.8, 1.2), radius_noise=4e-4)
    for n, imperfections in ((29, noisy), (16, tt.ImperfectionOptions(gain=1.1)), (3, tt.ImperfectionOptions())):
        monkeypatch.undo()
        together = readings(MODELS[name], n, dtype, imperfections)
        monkeypatch.setattr(strips, "is_ball_formula", lambda _: False)
        alone = readings(MODELS[name], n, dtype, imperfections)
        assert all(np.array_equal(a, b, equal_nan=a.dtype.kind == "f") for a, b in zip(together, alone, strict=True))
        assert any(a.any() for a in alone)
        if alone[0].dtype.kind == "f":
            assert any(np.isnan(a).any() for a in alone)
            signs = [(np.signbit(a) == np.signbit(b))[~np.isnan(a)].all() for a, b in zip(together, alone)]
            assert all(signs)
