"""Resets with a seed: from then on an environment reads what its number alone determines."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
import warp as wp

import tactemu as tt
from tactemu.base.errors import SceneError
from tactemu.base.option_groups import from_flat
from tactemu.sensors.sensor import reading_array
from tactemu.transducers.capacitive import Capacitive
from tactemu.transducers.fluid import Fluid
from tactemu.transducers.material import Material

GRID = np.stack([*np.meshgrid(np.linspace(-3e-3, 3e-3, 3), np.linspace(-3e-3, 3e-3, 3)), np.full((3, 3), 5e-3)], -1)
EVERYTHING: dict[str, Any] = {
    "gain_range": (0.5, 2.0),
    "crosstalk_strength": 0.3, "crosstalk_sigma": 0.001,
    "hysteresis_strength": 0.5, "hysteresis_strength_unloading": 0.2, "creep_strength": 0.1,
    "hysteresis_backlash": 0.01, "scan_time": 2.5e-3, "temperature_course": [(0.0, 20.0), (0.02, 60.0)],
    "temperature_sensitivity": 0.01, "temperature_offset": 0.02, "random_walk": 0.01, "random_walk_density": 0.1,
    "noise": 0.1, "noise_density": 0.01, "bias": 0.3, "dead_taxel_probability": 0.3,
    "dead_taxel_value_range": (-1.0, 1.0), "delay": 2e-3, "jitter": 1e-3, "delay_interpolation": "linear",
    "history_length": 2,
}  # fmt: skip
"""All imperfections, but rounding and saturation, which would hide differences."""
KINEMATIC = {"positions": GRID, "radius": 2e-3, **EVERYTHING, "radius_noise": 1e-4}


class Rig:
    """A pad and a ball that slides over it, with skins on the pad; every environment is pressed alike."""

    def __init__(self, n_envs: int | None = None, *, skins: Sequence[Any] = (), **build: Any):
        scene = tt.Scene(dt=1e-3)
        pad = scene.add_body(tt.Box(size=(0.02, 0.02, 0.01)), name="pad", fixed=True)
        self.ball = scene.add_body(tt.Sphere(radius=5e-3), name="ball", position=(0, 0, 0.05))
        skins = skins or [from_flat(tt.KinematicTaxel, KINEMATIC)]
        self.skins = [scene.add_sensor(skin, link=pad, name=f"{k}") for k, skin in enumerate(skins)]
        self.scene = scene
        self.sim: tt.Simulation = scene.build(n_envs, **build)

    def press(self, k: int) -> None:
        """Take a step with the ball ``k`` places further."""
        self.sim.set_pose(self.ball, position=(1e-4 * k, 0, 9.3e-3), linear_velocity=(0.1, 0, 0))
        self.sim.step()

    def seen(self, env: int | slice = slice(None)) -> bytes:
        """The readings of some environments, of all skins."""
        return b"".join(reading_array(skin).numpy()[env].tobytes() for skin in self.skins)

    def run(self, env: int = 0, steps: int = 12) -> list[bytes]:
        """The readings of an environment in each step of an episode."""
        found = []
        for k in range(steps):
            self.press(k)
            found.append(self.seen(env))
        return found


def alone(seed: int, **rig: Any) -> list[bytes]:
    """The readings of one environment that is reset with a seed, of a fresh simulation."""
    fresh = Rig(**rig)
    fresh.sim.reset(seed=seed)
    return fresh.run()


@pytest.mark.parametrize("threads", [1, 2])
def test_an_environment_reads_the_same_bytes_alone_and_among_a_thousand(threads):
    many = Rig(1000, threads=threads, seed=4, first_env=77)
    many.run(steps=7)
    many.sim.reset(seed=40)
    steps = []
    for k in range(12):
        many.press(k)
        steps.append([many.seen(env) for env in range(1000)])
    assert len(set(steps[-1])) == 1000, "each has numbers of its own"
    for env in (0, 1, 499, 999):
        assert [each[env] for each in steps] == alone(40 + env)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_the_same_seed_gives_the_same_bytes_after_any_history(dtype):
    rig = Rig(dtype=dtype)
    first = alone(7, dtype=dtype)
    assert rig.run() != first
    for history in ("none", "longer", "resets", "another seed", "longer steps"):
        if history == "longer":
            rig.run(steps=23)
        if history == "resets":
            rig.sim.reset()
            rig.sim.reset([0])
            rig.run(steps=2)
        if history == "another seed":
            rig.sim.reset(seed=8)
            assert rig.run() != first
        if history == "longer steps":
            rig.sim.step(dt=0.0021)
            rig.sim.step(dt=0.001)
        rig.sim.reset(seed=7)
        assert rig.run() == first, history


def test_every_model_forgets_all_before_a_seed():
    common = {"positions": GRID, "noise": 0.01, "delay": 2e-3, "jitter": 1e-3, "dead_taxel_probability": 0.2}
    skins = [
        from_flat(tt.ContactProbe, common | {"radius": 1e-3, "contact_threshold": 1e-4}),
        from_flat(tt.ContactDepthProbe, common | {"radius": 1e-3}),
        from_flat(tt.ProximityTaxel, common | {"radius": 5e-3}),
        from_flat(tt.ElastomerTaxel, common),
        from_flat(tt.ElasticLayerTaxel, common),
    ]
    found = []
    for steps in (0, 5):
        rig = Rig(3, skins=skins)
        rig.run(steps=steps)
        rig.sim.reset([2, 0], seed=[5, 6])
        found.append([rig.run(env=0, steps=6), rig.run(env=2, steps=6)])
    assert found[0] == found[1]


@pytest.mark.parametrize("end", [Fluid(tau=0.01), Capacitive(baseline_tau=0.01)])
def test_transducers_forget_all_before_a_seed(end):
    found = []
    worn = Material(creep_per_decade=0.1, loop=0.2, softening=0.05, baseline=0.05)
    for steps in (0, 5):
        scene = tt.Scene(dt=1e-3)
        pad = scene.add_body(tt.Box(size=(0.02, 0.02, 0.01)), name="pad", fixed=True)
        ball = scene.add_body(tt.Sphere(radius=5e-3), name="ball", position=(0, 0, 0.05))
        model = from_flat(tt.KinematicTaxel, KINEMATIC | {"dead_taxel_probability": 0.0})
        skin = scene.add_sensor(model, link=pad, transducers=[worn, end])
        sim = scene.build(2)
        for k in range(steps + 8):
            if k == steps:
                sim.reset([1], seed=9)
            sim.set_pose(ball, position=(1e-4 * (k - steps), 0, 9.3e-3))
            sim.step()
        found.append(reading_array(skin).numpy()[1].tobytes())
    assert found[0] == found[1]


def test_the_first_of_those_reset_takes_the_seed_in_the_order_of_the_list_or_the_mask():
    rig = Rig(8)
    expected = {seed: alone(seed) for seed in (3, 4, 1000)}

    def check(env: int, seed: int) -> None:
        assert rig.run(env) == expected[seed]

    mask = np.zeros(8, bool)
    mask[[2, 7]] = True
    on_device = wp.array(mask, dtype=wp.bool, device="cpu")
    for envs, first, second in (([7, 2], 7, 2), (mask, 2, 7), (on_device, 2, 7), (np.array([7, 2]), 7, 2)):
        for seed, seeds in ((3, (3, 4)), ([4, 3], (4, 3)), (np.array([1000, 3]), (1000, 3))):
            given = seed
            if envs is on_device and not isinstance(seed, int):  # which has one for each environment
                given = np.zeros(8, int)
                given[[2, 7]] = seed
            for env, its in ((first, seeds[0]), (second, seeds[1])):
                rig.sim.reset(envs, seed=given)
                check(env, its)


def test_numbers_may_come_in_an_array_with_dlpack():
    rig = Rig(3)
    for seed, env in (([4, 9, 7], 1), ([8], 1)):
        rig.sim.reset(seed=wp.array(seed, dtype=wp.int32, device="cpu"))
        assert rig.run(env) == alone(9)


def test_the_temperature_follows_the_time_since_the_reset_also_without_a_seed():
    warm = {"temperature_course": [(0.0, 25.0), (0.01, 35.0)], "temperature_offset": 0.1, "positions": GRID}
    rig = Rig(2, skins=[from_flat(tt.ContactDepthProbe, warm)])
    rig.sim.step(4)
    rig.sim.reset([1])
    rig.sim.step(2)
    assert rig.skins[0].read()[:, 0, 0] == pytest.approx([0.6, 0.2])


def test_the_others_go_on_to_the_bit():
    calm, reset = Rig(3), Rig(3)
    for k in range(12):
        if k == 5:
            reset.sim.reset([1], seed=2)
        calm.press(k)
        reset.press(k)
        for env in (0, 2):
            assert calm.seen(env) == reset.seen(env)
    assert calm.seen(1) != reset.seen(1)


def test_without_a_seed_the_next_episode_draws_anew_from_the_number_whatever_its_length():
    found = []
    for steps in (3, 9):
        rig = Rig(2)
        rig.sim.reset([1], seed=5)
        rig.run(steps=steps)
        rig.sim.reset([1])
        found.append(rig.run(env=1))
    assert found[0] == found[1] != alone(5)


def test_large_seeds_differ_in_every_bit():
    seeds = [0, 1, 2**31, 2**32, 2**32 + 1, 2**62, 2**63 - 1]
    rig = Rig(len(seeds))
    rig.sim.reset(seed=seeds)
    rig.run(steps=6)
    assert len({rig.seen(env) for env in range(len(seeds))}) == len(seeds)


def test_gains_and_dead_taxels_are_drawn_at_the_reset():
    rig = Rig(2)
    imperfections = rig.skins[0].imperfections
    rig.sim.reset([1], seed=5)
    before = imperfections.dead[1].copy()
    rig.run(steps=3)
    rig.sim.reset([0], seed=5)
    assert np.array_equal(imperfections.dead[0], before) and before.any() and not before.all()


def test_a_state_carries_the_seed():
    rig, other = Rig(2), Rig(2)
    rig.sim.reset(seed=[11, 3])
    rig.run(steps=4)
    state = rig.sim.state()
    expected = rig.run(env=1)
    other.sim.prepare_restore(state)()
    assert other.run(env=1) == expected


def test_a_clone_and_a_split_take_seeds_alike():
    rig = Rig(5)
    rig.sim.reset(seed=20)
    rig.run(steps=3)
    cloned = rig.sim.clone()
    cloned.reset([3], seed=23)
    split = rig.scene.build_split(5, ["cpu", "cpu"])
    split.reset(seed=1)
    split.step()
    split.reset([4, 0, 3], seed=[24, 20, 23])
    ball = {"position": (0, 0, 9.3e-3)}
    for _ in range(4):
        for sim in (cloned, split):
            sim.set_pose("ball", **ball)
            sim.step()
    among = split.read("0")
    alone = Rig(first_env=3)
    alone.sim.reset(seed=23)
    for _ in range(4):
        alone.sim.set_pose("ball", **ball)
        alone.sim.step()
    expected = alone.skins[0].read()
    assert np.array_equal(among.force[3], expected.force)
    assert np.array_equal(cloned.sensors[0].read().force[3], expected.force)


@pytest.mark.parametrize(
    "envs, seed, says",
    [
        (None, -1, "got -1"),
        (None, 2**63 - 2, "got 9223372036854775806"),
        (None, 2**70, "got 11805"),
        (None, 1.0, "got 1.0"),
        (None, True, "got True"),
        (None, "1", "got '1'"),
        (None, [1, 2], "3 of them, one for each environment reset; got 2"),
        (None, [1, 2, -3], "got [1, 2, -3]"),
        (None, [1, 2, 2.5], "got [1, 2, 2.5]"),
        (None, [[1, 2, 3]], "got [[1, 2, 3]]"),
        (None, [[1], [2, 3]], "got [[1], [2, 3]]"),
        ([0, 2], [1, 2, 3], "2 of them, one for each environment reset; got 3"),
        ([0, 2, 0], 1, "environment 0 is given twice"),
    ],
)
def test_a_seed_that_does_not_fit_is_refused_and_nothing_is_reset(envs, seed, says):
    rig = Rig(3)
    rig.run(steps=3)
    before = rig.seen()
    with pytest.raises(SceneError) as refused:
        rig.sim.reset(envs, seed=seed)
    assert says in str(refused.value) and str(refused.value).startswith("reset: ")
    assert rig.seen() == before and rig.sim.step_count == 3


@pytest.mark.parametrize("threads", [1, 2])
def test_each_environment_counts_from_its_own_reset(threads):
    sim = Rig(3, threads=threads).sim
    for k in range(5):
        sim.step()
        if k == 1:
            sim.reset([2])

    def counts():
        context = sim.context
        steps = (context.step.numpy() - context.began_step.numpy()).tolist()
        return steps, (context.time_ns.numpy() - context.began_ns.numpy()).tolist()

    assert counts() == ([5, 5, 3], [5_000_000, 5_000_000, 3_000_000])
    state = sim.state()
    sim.reset()
    assert counts() == ([0, 0, 0], [0, 0, 0])
    sim.prepare_restore(state)()
    assert counts() == ([5, 5, 3], [5_000_000, 5_000_000, 3_000_000])
