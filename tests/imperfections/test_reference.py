"""Imperfections against readings dumped from the reference implementation: same raw readings in, same readings out."""

import numpy as np
import pytest
import warp as wp

from tests.imperfections.rig import Case, Rig

WIDTHS = [(wp.float32, 2e-5), (wp.float64, 1e-9)]
"""Float width and tolerance, as a share of the case's largest reading."""


def replay(rig: Rig, raw: np.ndarray, events=()) -> np.ndarray:
    """Runs ``raw`` ``(T, n_envs, n_taxels, n_channels)`` through a rig; events reset environments before a step."""
    resets = {e["step"]: [1] if "envs_idx" in e["event"] else None for e in events}
    out = []
    for t, row in enumerate(raw):
        if t in resets:
            rig.reset(resets[t])
        out.append(rig.step(row))
    return np.stack(out)


def assert_close(got, expected, tolerance):
    largest = np.abs(expected).max()
    assert largest > 0.0, "an empty case proves nothing"
    assert np.abs(got - expected).max() <= tolerance * largest


@pytest.mark.parametrize("real, tolerance", WIDTHS)
@pytest.mark.parametrize("key", ["gauss", "k1", "k2g", "k3g", "hyst"])
def test_crosstalk_and_hysteresis(key, real, tolerance):
    case = Case("c05")
    rig = Rig(case.options(key), case.info(key), real=real, dt=case.facts["dt"])
    assert_close(replay(rig, case.raw("plain")), case.raw(key), tolerance)


@pytest.mark.parametrize("key", ["gauss", "all"])
def test_gaussian_kernel(key):
    """The kernel's size and weights, where three sigma is a whole number of pitches too."""
    from tactemu.imperfections.crosstalk import planes

    case = Case("c05")
    expected = case.arrays[f"{key}__crosstalk_k0"]
    got = planes(case.options(key), case.info(key))[0]
    assert got.shape == expected.shape
    np.testing.assert_allclose(got, expected, atol=1e-7 * expected.max())  # the reference keeps it in float32


@pytest.mark.parametrize("real, tolerance", WIDTHS)
@pytest.mark.parametrize("key", ["delay", "bias", "dead", "hyst"])
def test_pipeline_with_a_reset(key, real, tolerance):
    case = Case("c13")
    rig = Rig(case.options(key), case.info(key), real=real, dt=case.facts["dt"])
    assert_close(replay(rig, case.raw("plain"), case.facts["events"]), case.raw(key), tolerance)


@pytest.mark.parametrize("real, tolerance", WIDTHS)
@pytest.mark.parametrize("key", ["res", "biasres"])
def test_rounding(key, real, tolerance):
    """Equal up to readings that a float32 puts on the other side of a half: those are one step of the quantiser off."""
    case = Case("c13")
    quantum = case.sensors[key]["options"]["resolution"]
    gain = case.sensors[key]["options"].get("gain", 1.0)
    raw = case.raw("plain") * gain  # a probe's gain multiplies its depth
    rig = Rig(case.options(key, "gain"), case.info(key), real=real, dt=case.facts["dt"])
    got, expected = replay(rig, raw, case.facts["events"]), case.raw(key)
    exact = (raw + case.sensors[key]["options"].get("bias", 0.0)) / quantum
    clear = np.abs(exact - np.floor(exact) - 0.5) > (1e-4 if real is wp.float32 else 1e-12)
    assert clear.mean() > 0.9
    assert_close(np.where(clear, got, expected), expected, tolerance)


@pytest.mark.parametrize("real, tolerance", WIDTHS)
def test_delay_bias_and_rounding_of_forces(real, tolerance):
    case = Case("c13")
    quantum = case.sensors["kdelay"]["options"]["resolution"]
    rig = Rig(case.options("kdelay"), case.info("kdelay"), real=real, dt=case.facts["dt"])
    raw = case.raw("kdelay_gt")
    got, expected = replay(rig, raw, case.facts["events"]), case.raw("kdelay")
    exact = (raw + 0.01) / quantum
    clear = np.ones_like(got, dtype=bool)
    clear[2:] = (np.abs(exact - np.floor(exact) - 0.5) > 1e-3)[:-2]
    assert clear.mean() > 0.9
    assert_close(np.where(clear, got, expected), expected, tolerance)


@pytest.mark.parametrize("real, tolerance", WIDTHS)
@pytest.mark.parametrize("key, raw", [("hist", "plain"), ("khist", "kdelay_gt")])
def test_history_is_newest_first(key, raw, real, tolerance):
    case = Case("c13")
    rig = Rig(case.options(key), case.info(key), real=real, dt=case.facts["dt"])
    assert_close(replay(rig, case.raw(raw), case.facts["events"]), case.history(key), tolerance)


def test_history_is_delayed_where_the_reference_forgets_the_delay():
    """The reference drops the delay once there is a history; here entry 0 is what a single delayed reading is."""
    case = Case("c13")
    rig = Rig(case.options("delayhist"), case.info("delayhist"), dt=case.facts["dt"])
    got = replay(rig, case.raw("plain"), case.facts["events"])
    delayed, theirs = case.raw("delay"), case.history("delayhist")
    np.testing.assert_allclose(got[:, :, 0], delayed, atol=1e-12)
    np.testing.assert_allclose(got[3:30, :, 3], delayed[:27], atol=1e-12)
    np.testing.assert_allclose(theirs[:, :, 0], case.raw("plain"), atol=1e-12)
    assert np.abs(got - theirs).max() > 1e-3


@pytest.mark.parametrize("real, tolerance", WIDTHS)
def test_reset_of_one_environment(real, tolerance):
    case = Case("c14")
    rig = Rig(case.options("kin"), case.info("kin"), n_envs=3, real=real, dt=case.facts["dt"])
    assert_close(replay(rig, case.raw("kin_gt"), case.facts["events"]), case.raw("kin"), tolerance)


def test_draws_at_a_reset_follow_the_reference():
    """Only the environment reset draws new gains and dead taxels; their laws are those of the reference's draws."""
    case = Case("c14")
    rig = Rig(case.options("depth"), case.info("depth"), n_envs=3, dt=case.facts["dt"])
    raw = case.raw("depth_gt")
    before, after = [], []
    for t, row in enumerate(raw):
        if t == 18:
            before = [rig.gain.numpy().copy(), rig.chain.stuck.numpy().copy()]
            rig.reset([1])
            after = [rig.gain.numpy().copy(), rig.chain.stuck.numpy().copy()]
        rig.step(row)
    reference = [case.arrays["depth__gain"], case.arrays["depth__dead_mask"]]
    for theirs, ours in zip(reference, zip(before, after)):
        their_change = (theirs[17] != theirs[18]).any(axis=1)
        our_change = (ours[0] != ours[1]).any(axis=1)
        np.testing.assert_array_equal(our_change, their_change)
        np.testing.assert_array_equal(our_change, [False, True, False])
    low, high = case.sensors["depth"]["options"]["gain_range"]
    gains = np.concatenate([before[0].ravel(), after[0][1]])
    assert low <= gains.min() and gains.max() <= high
    dead = np.isfinite(after[1])
    values = after[1][dead]
    assert 0.001 <= values.min() and values.max() <= 0.002
    np.testing.assert_array_equal(rig.reading.numpy().reshape(3, -1)[dead], values)


@pytest.mark.parametrize("key, law", [("noise", "noise"), ("walk", "random_walk")])
def test_white_noise_and_walk_have_the_reference_statistics(key, law):
    """400 steps of 16 taxels at rest: both standard deviations agree with the option within 4.5 standard errors of a
    normal sample (1 / sqrt(2 n)), and their ratio with 1."""
    case = Case("c18")
    sigma = case.sensors[key]["options"][law]
    rig = Rig(case.options(key), case.info(key), dt=case.facts["dt"])
    raw = case.raw("plain")
    spreads = []
    for readings in (case.raw(key), replay(rig, raw)):
        error = (readings - raw).reshape(len(raw), -1)
        each = error if law == "noise" else np.diff(error, axis=0, prepend=0.0)
        assert abs(each.mean()) < 4.5 * sigma / np.sqrt(each.size)
        spreads.append(each.std())
        assert each.std() == pytest.approx(sigma, rel=4.5 / np.sqrt(2 * each.size))
    assert spreads[1] / spreads[0] == pytest.approx(1.0, rel=4.5 / np.sqrt(each.size))


def test_radius_noise_has_the_reference_statistics():
    """Depth under a load at rest moves with the radius: uniform noise, so its variance is s^2/3 in both."""
    from scipy.stats import ks_2samp, kstest

    case = Case("c18")
    half = case.sensors["rnoise"]["options"]["radius_noise"]
    theirs = (case.raw("rnoise") - case.raw("plain")).ravel()
    rig = Rig(case.options("rnoise"), case.info("rnoise"), dt=case.facts["dt"])
    ours = np.empty((400, 16))
    for t in range(400):
        rig.step()
        ours[t] = rig.radius.numpy()[0] - 0.004
    inside = case.raw("plain").ravel() > half  # deep enough not to be clipped at no contact
    assert inside.mean() > 0.5
    assert kstest(ours.ravel(), "uniform", args=(-half, 2 * half)).pvalue > 1e-3
    assert ks_2samp(ours.ravel(), theirs[inside]).pvalue > 1e-3
