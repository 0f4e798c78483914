"""A batch over several devices reads as on one, bit for bit."""

import numpy as np
import pytest

import tactemu as tt
from tactemu.base.errors import SceneError
from tactemu.base.option_groups import from_flat
from tactemu.transducers.registry import make_transducer

GRID = np.stack([*np.meshgrid(np.linspace(-8e-3, 8e-3, 6), np.linspace(-6e-3, 6e-3, 4)), np.full((4, 6), 0.01)], -1)
HOME = np.array([0, 0, 0.0195])
N_ENVS = 7
SPOILED = {
    "noise": 0.02,
    "random_walk": 0.01,
    "dead_taxel_probability": 0.2,
    "delay": 2e-3,
    "jitter": 1e-3,
    "gain_range": (0.8, 1.2),
}
"""Everything that draws random numbers."""


def scene():
    built = tt.Scene(dt=1e-3)
    pad = built.add_body(tt.Box(size=(0.03, 0.02, 0.02)), name="pad", fixed=True)
    built.add_body(tt.Sphere(radius=0.01), name="tool", position=(0, 0, 0.0195))
    model = from_flat(tt.KinematicTaxel, {"positions": GRID, "radius": 2e-3, **SPOILED})
    return built, built.add_sensor(model, link=pad, name="skin")


def run(sim, read) -> np.ndarray:
    """Readings of ten steps under poses of their own, with a reset of some between."""
    rng, found = np.random.default_rng(0), []
    for step in range(10):
        sim.set_pose("tool", position=HOME + rng.uniform(-1e-3, 1e-3, (N_ENVS, 3)))
        if step == 4:
            sim.reset([1, 2, 5])
            sim.set_pose("tool", position=[[0, 0, 0.019]] * 2, envs=[5, 0])
        sim.step()
        found.append(np.concatenate(read(), -1))
    return np.stack(found)


@pytest.mark.parametrize("n_parts", [2, 3])
def test_any_number_of_devices_reads_as_one(n_parts):
    built, skin = scene()
    with built.build(N_ENVS, seed=3) as sim:
        expected = run(sim, skin.read)
    built, skin = scene()
    with built.build_split(N_ENVS, ["cpu"] * n_parts, seed=3) as split:
        found = run(split, lambda: split.read(skin))
        assert [part.n_envs for part in split.parts] == [b - a for a, b in zip(split.starts, split.starts[1:])]
    assert np.abs(expected).max() > 0 and expected[-1].std(axis=0).max() > 0
    np.testing.assert_array_equal(found, expected)


def test_environments_draw_by_their_numbers():
    built, skin = scene()
    with built.build(N_ENVS, seed=3) as sim:
        expected = run(sim, skin.read)[:4]
    built, skin = scene()
    sim, found = built.build(2, seed=3, first_env=5), []
    rng = np.random.default_rng(0)
    for _ in range(4):
        sim.set_pose("tool", position=(HOME + rng.uniform(-1e-3, 1e-3, (N_ENVS, 3)))[5:])
        sim.step()
        found.append(np.concatenate(skin.read(), -1))
    np.testing.assert_array_equal(found, expected[:, 5:])


@pytest.mark.parametrize(
    ("do", "said"),
    [
        (lambda split: split.set_pose("tool", position=[[0, 0, 0]] * 2), "a row for each of 4"),
        (lambda split: split.set_pose("tool", speed=3), "no argument 'speed'"),
        (lambda split: split.reset([4]), r"indices in 0\.\.3"),
        (lambda split: split.reset(np.array([True])), "a mask must have shape"),
        (lambda split: split.read("sknn"), "no sensor 'sknn'"),
    ],
)
def test_what_does_not_fit(do, said):
    built, _ = scene()
    split = built.build_split(4, ["cpu", "cpu"])
    with pytest.raises((SceneError, TypeError), match=said):
        do(split)


def test_fewer_environments_than_devices():
    with pytest.raises(SceneError, match="2 devices share"):
        scene()[0].build_split(1, ["cpu", "cpu"])


def test_another_simulation_has_the_transducers_too():
    built = tt.Scene()
    pad = built.add_body(tt.Box(size=(0.03, 0.02, 0.02)), name="pad", fixed=True)
    built.add_body(tt.Sphere(radius=0.01), name="tool", position=(0, 0, 0.0195))
    model = tt.KinematicTaxel(positions=GRID, radius=2e-3)
    skin = built.add_sensor(model, link=pad, transducers=[make_transducer("skin", {"kind": "piezoresistive"})])
    sim = built.build()
    other = sim.clone()
    for each in (sim, other):
        each.step()
    found = other.sensors[0].read()
    assert found.shape == GRID.shape[:2]  # numbers of the material, not forces
    np.testing.assert_array_equal(found, skin.read())
