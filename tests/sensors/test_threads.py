"""Threads that share the environments of a batch: the same bytes, however many, and none left behind."""

import gc
import os
import threading

import numpy as np
import pytest

import tactemu as tt
from tactemu.base.errors import SceneError
from tactemu.base.option_groups import from_flat
from tactemu.plan.launches import Launches, in_turn
from tactemu.plan.thread_pool import ThreadPool
from tactemu.sensors.models import MODELS, model_class
from tactemu.sensors.sensor import reading_array
from tactemu.transducers.capacitive import Capacitive
from tactemu.transducers.fluid import Fluid
from tactemu.transducers.magnetic import Magnetic
from tactemu.transducers.material import Material
from tactemu.transducers.piezoresistive import Piezoresistive

N_ENVS = 7
GRID = np.stack([*np.meshgrid(np.linspace(-8e-3, 8e-3, 9), np.linspace(-6e-3, 6e-3, 6)), np.full((6, 9), 0.01)], -1)
SPOILT = {
    "crosstalk_strength": 0.2, "crosstalk_sigma": 2e-3, "hysteresis_strength": 0.2, "hysteresis_tau": 0.01,
    "random_walk": 1e-6, "noise": 1e-6, "noise_density": 1e-7, "dead_taxel_probability": 0.1, "history_length": 2,
    "delay": 1.5e-3, "jitter": 1e-3, "scan_time": 1e-3, "gain_range": (0.9, 1.1),
}  # fmt: skip
CHAINS = {
    "Magnetic": ("KinematicTaxel", [Magnetic(neighbours=(("ball", (0, 0, 0), (0, 0, 1e-3)),), earth=(5e-5, 0, 0))]),
    "Piezoresistive": ("KinematicTaxel", [Piezoresistive(ghosts=0.3)]),
    "Capacitive": ("KinematicTaxel", [Material(creep_per_decade=0.1, loop=0.1), Capacitive(baseline_tau=0.1)]),
    "Fluid": ("KinematicTaxel", [Fluid()]),
}


@pytest.fixture(autouse=True)
def what_other_tests_forgot():
    """Has ended its threads before ours are counted."""
    gc.collect()


def threads_alive() -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name.startswith("tactemu share")]


def poses(step: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(step)
    return {
        "position": np.c_[rng.uniform(-2e-3, 2e-3, (N_ENVS, 2)), rng.uniform(0.017, 0.0195, N_ENVS)],
        "quaternion": rng.normal(size=(N_ENVS, 4)),
        "linear_velocity": rng.normal(size=(N_ENVS, 3)) * 0.1,
        "angular_velocity": rng.normal(size=(N_ENVS, 3)),
    }


def built(model: str, threads: int | None, n_envs: int | None = N_ENVS, transducers=(), **options):
    scene = tt.Scene(dt=1e-3)
    pad = scene.add_body(tt.Box(size=(0.03, 0.02, 0.02)), fixed=True, name="pad")
    ball = scene.add_body(tt.Sphere(radius=0.01), name="ball", position=(0, 0, 0.019))
    sensor = from_flat(getattr(tt, model), {"positions": GRID, "radius": 2e-3, **options})
    skin = scene.add_sensor(sensor, link=pad, name="skin", transducers=transducers)
    return scene.build(n_envs, threads=threads), ball, skin


def readings(threads: int, model: str, **options) -> bytes:
    """All that is read in five steps, one of them after a reset of two environments."""
    found = []
    with built(model, threads, **options)[0] as sim:
        skin = sim.sensors[0]
        for step in range(5):
            sim.set_pose("ball", **poses(step))
            sim.step()
            found += [reading_array(skin).numpy().tobytes(), reading_array(skin, ground_truth=True).numpy().tobytes()]
            if step == 2:
                sim.reset([1, 5])
        assert len(threads_alive()) == threads - 1
        assert f"threads: {threads} (as asked for)" in str(sim.plan)
    assert not threads_alive() and any(any(each) for each in found)
    return b"".join(found)


@pytest.mark.parametrize("spoilt", [False, True], ids=["ideal", "spoilt"])
@pytest.mark.parametrize("model", [model_class(path).__name__ for path in MODELS])
def test_any_number_of_threads_reads_the_same(model, spoilt):
    options = SPOILT if spoilt else {}
    one = readings(1, model, **options)
    assert one == readings(2, model, **options) == readings(3, model, **options)


@pytest.mark.parametrize("chain", CHAINS)
def test_so_do_transducers(chain):
    model, transducers = CHAINS[chain]
    assert readings(1, model, transducers=transducers) == readings(3, model, transducers=transducers)


def test_free_layouts_and_shear_too():
    free = {"taxel_area": 1e-6, "contact_threshold": 1e-6}
    for options in ({}, free):
        grid = {"normals": np.tile([0, 0.1, 1.0], (*GRID.shape[:2], 1)) + GRID * 5}
        assert readings(1, "ElastomerTaxel", **options, **grid) == readings(3, "ElastomerTaxel", **options, **grid)


def test_threads_only_where_they_pay(monkeypatch):
    monkeypatch.setattr("tactemu.sensors.thread_count.cores", lambda: 3)
    for n_envs, model, expected in (
        (None, "ElasticLayerTaxel", "threads: 1 (one environment)"),
        (4, "ContactDepthProbe", "threads: 1 (a step is too short for more)"),
        (61, "ElasticLayerTaxel", "threads: 2, 31 of 61 environments at most to each"),
        (1000, "ContactDepthProbe", "threads: 3, 334 of 1000 environments at most to each"),
    ):
        sim, _ball, _skin = built(model, None, n_envs)
        assert str(sim.plan).splitlines()[-1] == expected
        sim.step()
        assert len(threads_alive()) == int(expected[9]) - 1
        sim.close()
        assert not threads_alive()
    assert "threads: 2 (as asked for)" in str(built("ContactDepthProbe", 5, 2)[0].plan)  # no more than environments


def test_a_simulation_that_is_forgotten_leaves_no_thread():
    sim, _ball, _skin = built("ContactDepthProbe", 3)
    sim.step()
    assert len(threads_alive()) == 2
    del sim, _ball, _skin
    gc.collect()
    assert not threads_alive()


@pytest.mark.parametrize("threads", [0, -1, 1.5, True])
def test_a_number_that_is_none_is_refused(threads):
    with pytest.raises(SceneError, match="threads must be None or a whole number >= 1"):
        built("ContactDepthProbe", threads)


def test_a_stage_that_cannot_be_shared_runs_once_between_the_others():
    """A model from elsewhere may record its launches without shares."""
    sim, _ball, _skin = built("ContactDepthProbe", 3)
    order = []
    whole, shared = lambda: order.append("whole"), Launches([[lambda k=k: order.append(k)] for k in range(3)])
    for stage, launch in zip(sim.plan.stages, (whole, shared, in_turn(shared, whole))):
        stage.launch = launch
    sim.step()
    assert order[0] == "whole" and sorted(order[1:4]) == [0, 1, 2] and order[4:] == [0, 1, 2, "whole"]
    sim.close()


def test_a_large_reading_is_a_copy_made_by_all(monkeypatch):
    monkeypatch.setattr("tactemu.plan.plan.MIN_SHARED_COPY_BYTES", 1)
    sim, _ball, skin = built("KinematicTaxel", 3)
    sim.step()
    reading, array = skin.read(), reading_array(skin).numpy()
    assert np.array_equal(np.concatenate(reading, -1).reshape(array.shape), array) and array.any()
    assert not np.shares_memory(reading.force, array)
    sim.close()
    assert np.array_equal(skin.read().force, reading.force) and not threads_alive()


def test_an_error_of_any_share_is_raised_when_all_have_ended():
    thread_pool, ended = ThreadPool(3), []

    def fail() -> None:
        raise ValueError("share 1")

    for shares in ([[], [fail], [lambda: ended.append(2)]], [[fail], [], [lambda: ended.append(2)]]):
        with pytest.raises(ValueError, match="share 1"):
            thread_pool.run(shares)
    thread_pool.run([[], [lambda: ended.append(1)], []])
    assert sorted(ended) == [1, 2, 2]
    thread_pool.close()


def test_a_fork_starts_threads_of_its_own():
    thread_pool, done = ThreadPool(2), []
    thread_pool.run([[], [lambda: done.append(1)]])
    child = os.fork()
    if not child:
        thread_pool.run([[], [lambda: done.append(2)]])
        os._exit(0 if done == [1, 2] else 1)
    assert os.waitpid(child, 0)[1] == 0
    thread_pool.close()
