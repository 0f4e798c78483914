"""Any values of all options at once: finite loads give finite readings, and what is no number stays none.

All laws are switched on in every example, so that one set of kernels serves them all.
"""

import numpy as np
import warp as wp
from hypothesis import given
from hypothesis import strategies as st

from tests.fuzz import examples
from tests.imperfections.rig import Rig, info, options

LARGEST = 1e6
"""Loads and parameters stay where a product of several of them is a float32."""


def positive(least=1e-12, most=LARGEST):
    return st.floats(least, most, allow_subnormal=False)


def interval():
    return st.tuples(st.floats(-LARGEST, LARGEST), st.floats(0, LARGEST)).map(lambda p: (p[0], p[0] + p[1]))


SECONDS = st.one_of(st.just(0.0), positive(1e-15, 1e12))
OPTIONS = st.fixed_dictionaries(
    {
        "crosstalk_strength": positive(1e-6, 10.0),
        "crosstalk_sigma": positive(1e-9, 0.01),
        "crosstalk_conserving": st.booleans(),
        "hysteresis_strength": positive(),
        "hysteresis_tau": SECONDS,
        "hysteresis_strength_unloading": positive(),
        "hysteresis_tau_unloading": SECONDS,
        "hysteresis_backlash": positive(),
        "creep_strength": positive(),
        "creep_tau": SECONDS,
        "scan_time": positive(1e-12, 0.02),
        "scan_order": st.sampled_from(["taxel", "row", "column"]),
        "temperature_course": st.lists(
            st.tuples(st.floats(-1e3, 1e6), st.floats(-273, 1e4)), min_size=1, max_size=4
        ).map(sorted),
        "temperature_sensitivity": positive(1e-9, 1.0),
        "temperature_offset": positive(),
        "random_walk": positive(),
        "random_walk_density": positive(),
        "random_walk_tau": st.one_of(st.none(), SECONDS),
        "noise": positive(),
        "noise_density": positive(),
        "bias": positive(),
        "saturation_range": interval(),
        "resolution": positive(1e-45),
        "dead_taxel_probability": positive(1e-3, 1.0),
        "dead_taxel_value_range": interval(),
        "dead_taxel_mode": st.sampled_from(["value", "last"]),
        "delay": positive(1e-12, 0.02),
        "jitter": positive(1e-12, 0.02),
        "jitter_reorder": st.just(False),
        "delay_interpolation": st.just("linear"),
        "history_length": st.integers(1, 4),
    }
)


@examples(60)
@given(OPTIONS, st.data())
def test_finite_in_finite_out(chosen, data):
    layout = data.draw(st.sampled_from([(2, 3), (1, 4), (5, 1)]))
    rig = Rig(options(**chosen), info(layout, ("force",)), n_envs=2, real=wp.float32)
    n = int(np.prod(layout))
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    scale = data.draw(positive(1e-12))
    bad_step, bad = data.draw(st.integers(0, 5)), data.draw(st.sampled_from([np.nan, np.inf, -np.inf]))
    low, high = chosen["saturation_range"]
    for k in range(6):
        load = rng.normal(size=(2, n, 3)) * scale
        if k == bad_step:
            load[1, -1, 0] = bad  # the last taxel of a scan is read at its end: now
        dt_ns = data.draw(st.sampled_from([rig.dt_ns, 10 * rig.dt_ns, 3_600_000_000_000]))
        rig.step(load, dt_ns=dt_ns)
        measured = rig.measured.numpy()
        assert np.isfinite(measured[0]).all()
        if k == bad_step:
            assert not np.isfinite(measured[1, -1, 0])
        alive = measured[0][~rig.chain.dead[0]]
        # Rounding may go past the range by half a step.
        slack = chosen["resolution"] / 2 + 1e-6 * (abs(low) + abs(high))
        assert (alive >= low - slack).all() and (alive <= high + slack).all()
        assert np.isfinite(rig.reading.numpy()[0]).all()
        if data.draw(st.booleans()):
            rig.reset([data.draw(st.integers(0, 1))])
