"""All imperfections at once, on the CPU and on CUDA: the same draws, and readings equal within rounding.

Run on a machine with a CUDA device: ``python -m pytest tests/gpu``.
"""

import numpy as np
import pytest
import warp as wp

from tests.imperfections.rig import Rig, info, options
from tests.imperfections.test_electronics import EVERYTHING

pytestmark = pytest.mark.gpu

# Without rounding: a float32 on the other side of a half would be a whole step off.
GIVEN = EVERYTHING | {"resolution": 0.0, "gain_range": (0.5, 2.0), "radius_noise": 1e-4}
WIDTHS = [(wp.float32, 2e-5), (wp.float64, 1e-9)]


def run(device: str, real, given=GIVEN, channels=("force", "torque")):
    """Readings, gains, radii and dead taxels of 30 steps with a reset of one environment in between."""
    rig = Rig(options(**given), info((5, 7), channels), n_envs=3, real=real, device=device, seed=11)
    seen, masks = [], []
    for k in range(30):
        if k == 12:
            rig.reset([1])
        load = np.sin(0.2 * k + np.arange(35))[:, None] * np.linspace(0.5, 1.0, rig.info.n_channels)
        parts = [rig.step(load)] + [a.numpy() for a in (rig.gain, rig.radius) if a is not None]
        seen.append(np.concatenate([p.reshape(3, -1) for p in parts], axis=1).astype(float))
        masks.append(rig.chain.dead.copy())
    return np.array(seen), np.array(masks)


@pytest.mark.parametrize("real, tolerance", WIDTHS)
@pytest.mark.parametrize("conserving", [False, True])
def test_same_numbers(real, tolerance, conserving):
    given = GIVEN | {"crosstalk_conserving": conserving, "hysteresis_strength_unloading": 0.1}
    (cpu, dead), (cuda, dead_cuda) = run("cpu", real, given), run("cuda:0", real, given)
    np.testing.assert_array_equal(dead, dead_cuda)
    assert np.isfinite(cuda).all()
    assert np.abs(cpu - cuda).max() <= tolerance * np.abs(cpu).max()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_no_number_stays_none(bad):
    rig = Rig(options(**GIVEN | {"delay": 0.0, "jitter": 0.0, "history_length": 0}), info((5, 7)), device="cuda:0")
    load = np.ones((35, 1))
    load[17] = bad
    rig.step(load)
    assert not np.isfinite(rig.step(load)[0, 17, 0])


@pytest.mark.parametrize("resolution", [1e-40, 0.25])
def test_rounding_on_cuda(resolution):
    """Half to even, and a quantiser below the smallest normal float (which CUDA may flush to zero) changes nothing."""
    loads = np.array([-2.5, -1.5, -0.5, 0.5, 1.5, 2.5, 3.5]) * 0.25
    rig = Rig(options(resolution=resolution), info((7,)), real=wp.float32, device="cuda:0")
    expected = loads if resolution < 1e-30 else np.rint(loads / 0.25) * 0.25
    np.testing.assert_array_equal(rig.step(loads[:, None]).ravel(), expected)


def test_a_graph_draws_anew_at_each_launch():
    rig = Rig(options(noise=1.0, delay=1e-3, jitter=1e-3), info((100,)), device="cuda:0")
    rig.step(0.0)
    with wp.ScopedCapture(rig.device, force_module_load=False) as capture:
        for stage in rig.stages:
            stage.launch()
    seen = []
    for k in range(2, 12):
        rig.context.step.assign([k])
        rig.context.time_ns.assign([k * 10**6])
        wp.capture_launch(capture.graph)
        seen.append(rig.measured.numpy().ravel())
    assert np.abs(np.corrcoef(seen) - np.eye(10)).max() < 0.45
