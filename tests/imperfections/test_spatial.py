"""Crosstalk over the grid and taxels read one after the other."""

import numpy as np
import pytest
import warp as wp

from tactemu.imperfections.crosstalk import gaussian_plane, separated
from tests.imperfections.rig import Rig, info, options


def correlate(field: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    """Cross-correlation of the same size with zeros outside."""
    from scipy.signal import correlate2d

    return correlate2d(field, kernel, mode="same")


def spread(given, field, about) -> np.ndarray:
    field = np.asarray(field, dtype=float)
    return Rig(options(**given), about).step(field.reshape(1, about.n_taxels, -1))[0].reshape(field.shape)


@pytest.mark.parametrize("shape", [(3, 5), (5, 3), (1, 3), (7, 7)])
def test_explicit_kernel_is_a_correlation_with_zeros_outside(shape):
    rng = np.random.default_rng(0)
    kernel, field = rng.normal(size=shape), rng.normal(size=(6, 9))
    seen = spread({"crosstalk_kernel": kernel}, field, info((6, 9)))
    np.testing.assert_allclose(seen, correlate(field, kernel), atol=1e-12)


@pytest.mark.parametrize("channels", [("scalar",), ("force", "torque")])
@pytest.mark.parametrize("shape", [(3, 5), (9, 3), (11, 13)])
def test_a_kernel_that_is_a_product_but_for_its_middle_is_taken_apart(shape, channels):
    """It may be larger than the grid."""
    rng = np.random.default_rng(3)
    kernel = np.outer(rng.uniform(0.1, 1, shape[0]), rng.normal(size=shape[1]))
    kernel[shape[0] // 2, shape[1] // 2] += 0.7
    down, along, centre = separated(kernel) or pytest.fail("it is a product")
    assert down.shape + along.shape == shape and centre == pytest.approx(0.7)
    about = info((6, 9), channels)
    field = rng.normal(size=(6, 9, 6 if len(channels) > 1 else 1))
    seen = spread({"crosstalk_kernel": kernel}, field, about)
    wanted = np.stack([correlate(field[..., c], kernel) for c in range(field.shape[2])], -1)
    np.testing.assert_allclose(seen, wanted, atol=1e-12)


@pytest.mark.parametrize("sigma", [4e-3, 2e-3, 5e-4, 2.5e-4, 1e-4, 8e-5, 5.3e-5, 5e-5, 1e-6, 1e-9])
@pytest.mark.parametrize("strength", [0.3, 1.0, 10.0])
def test_a_gaussian_of_any_width_stays_within_float32(strength, sigma):
    """From what reaches the whole grid, over what is below the least number beside its middle, to no neighbours."""
    plane = gaussian_plane(strength, sigma, (2e-3, 2e-3), (6, 9))
    field = np.random.default_rng(4).normal(size=(6, 9))
    rig = Rig(options(crosstalk_strength=strength, crosstalk_sigma=sigma), info((6, 9)), real=wp.float32)
    seen = rig.step(field.reshape(1, -1, 1)).reshape(6, 9)
    np.testing.assert_allclose(seen, correlate(field, plane), atol=1e-5 * strength)


NEARLY = [[1, 1e3, 1], [1e3, 1, 1e3], [1, 1e3, 1]]
"""A product with 1e6 in the middle, less nearly as much."""


@pytest.mark.parametrize("kernel", [np.eye(3), [[0, 1, 0], [1, 1, 1], [0, 1, 0]], [[0.2, 0.6, 0.2]], [[0.5]], NEARLY])
def test_other_kernels_are_no_products(kernel):
    assert separated(np.array(kernel, dtype=float)) is None


def test_planes_act_on_normal_shear_and_torque():
    rng = np.random.default_rng(1)
    kernels, field = rng.normal(size=(3, 3, 3)), rng.normal(size=(4, 5, 6))
    normal = np.array([0.6, 0.0, 0.8])
    about = info((4, 5), ("force", "torque"))
    object.__setattr__(about, "normal", tuple(normal))
    seen = spread({"crosstalk_kernel": kernels}, field, about)

    def over(channels, k):
        return np.stack([correlate(c, kernels[k]) for c in np.moveaxis(channels, -1, 0)], axis=-1)

    pushed = (field[..., :3] @ normal)[..., None] * normal
    np.testing.assert_allclose(seen[..., :3], over(pushed, 0) + over(field[..., :3] - pushed, 1), atol=1e-12)
    np.testing.assert_allclose(seen[..., 3:], over(field[..., 3:], 2), atol=1e-12)


GAUSS = {"crosstalk_strength": 1.0, "crosstalk_sigma": 0.002}


def test_the_plain_law_loses_force_at_the_border_as_the_reference_does():
    seen = spread(GAUSS, np.ones((12, 12)), info((12, 12)))
    assert 0.7 < seen.mean() < 0.9
    assert seen[0, 0] == pytest.approx(0.49, abs=0.01)


def test_conserving_crosstalk_keeps_the_total_and_a_uniform_press():
    rng = np.random.default_rng(2)
    radius = np.full((10, 12), 0.002)
    radius[3, 4] = radius[0, 0] = 0.0
    about = info((10, 12), radius=radius)
    present = radius > 0
    for given in (GAUSS, {"crosstalk_kernel": [[0.1, 0.2, 0.0], [0.1, 0.4, 0.2], [0.0, 0.0, 0.0]]}):
        field = rng.uniform(size=(10, 12)) * present
        seen = spread(given | {"crosstalk_conserving": True}, field, about)
        assert seen.sum() == pytest.approx(field.sum(), rel=1e-12)
        assert (seen[~present] == 0.0).all()
    uniform = spread(GAUSS | {"crosstalk_conserving": True}, present * 1.0, about)
    np.testing.assert_allclose(uniform[present], 1.0, rtol=1e-12)


def test_width_of_the_gaussian_is_sigma_in_metres_on_both_axes():
    """Variance of the spread of a single taxel, on unequal pitches: sigma^2 less what lies beyond 3 sigma (2.7 %)."""
    pitch = (0.001, 0.0015)
    field = np.zeros((41, 41))
    field[20, 20] = 1.0
    seen = spread({"crosstalk_strength": 1.0, "crosstalk_sigma": 0.004}, field, info((41, 41), spacing=pitch))
    offset = np.arange(41) - 20
    for axis, d in ((0, pitch[1]), (1, pitch[0])):
        along = seen.sum(axis=1 - axis)
        assert np.sum(along * (offset * d) ** 2) == pytest.approx(0.004**2, rel=0.05)
    assert seen.sum() == pytest.approx(1.0)


def test_a_single_row_has_no_neighbours_across():
    seen = spread({"crosstalk_strength": 1.0, "crosstalk_sigma": 0.002}, np.ones((1, 21)), info((1, 21)))
    assert seen[0, 10] == pytest.approx(1.0)


# -- scan


def ramp_times(order, scan_time, layout=(2, 3), dt=1e-3, steps=12):
    """What time each taxel was read at [s], seen on a load that is the time itself."""
    rig = Rig(options(scan_time=scan_time, scan_order=order), info(layout), dt=dt)
    return np.array([rig.step((k + 1) * dt).ravel() for k in range(steps)])


@pytest.mark.parametrize(
    "order, slots",
    [
        ("taxel", [0, 1, 2, 3, 4, 5]),
        ("row", [0, 1, 2, 0, 1, 2]),
        ("column", [0, 0, 0, 1, 1, 1]),
        ([5, 4, 3, 2, 1, 0], [5, 4, 3, 2, 1, 0]),
    ],
)
@pytest.mark.parametrize("scan_time", [0.9e-3, 1e-3, 4.25e-3])
def test_taxels_are_read_in_their_slots(order, slots, scan_time):
    """A load that grows with time gives each taxel's own sampling time back, to a nanosecond; a scan may last steps."""
    seen = ramp_times(order, scan_time)
    slots = np.array(slots)
    age = scan_time * (1 - (slots + 1) / (slots.max() + 1))
    t = np.arange(1, 13)[:, None] * 1e-3
    np.testing.assert_allclose(seen[6:], (t - age)[6:], atol=1e-9)


def test_a_scan_smears_a_touch_down_over_its_taxels():
    """A jump between two steps is a ramp to the scan: the earlier the slot, the less of it is seen."""
    rig = Rig(options(scan_time=1e-3), info((1, 4)))
    rig.run(3, 0.0)
    np.testing.assert_allclose(rig.step(1.0).ravel(), [0.25, 0.5, 0.75, 1.0], atol=1e-9)


def test_a_scan_forgets_what_was_before_a_reset():
    rig = Rig(options(scan_time=3e-3), info((1, 3)), n_envs=2)
    rig.run(10, 1.0)
    rig.reset([1])
    seen = rig.step(1.0)[..., 0]
    np.testing.assert_allclose(seen[0], 1.0)
    np.testing.assert_allclose(seen[1], [0.0, 0.0, 1.0], atol=1e-9)
