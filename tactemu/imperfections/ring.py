"""The last readings with their times, and which of them belongs to a given time.

Entry ``k`` is the reading ``k`` steps ago; entry 0 is the step being taken, which is in the ring only after it. Entries
older than an environment's last reset do not count. Times are int64 nanoseconds, so that nothing is rounded to steps.
"""

import math

import numpy as np
import warp as wp

from tactemu.errors import SceneError
from tactemu.physics.plan import Context

NEVER = -(2**62)
"""Time of an entry that was never written."""
LARGEST = 2**20
"""Most readings that a ring may hold."""


@wp.func
def slot(step: wp.int64, age: int, depth: int) -> int:
    """Where the entry ``age`` steps before ``step`` lies."""
    # Before the start the remainder would be negative.
    return int((step - wp.int64(age) + wp.int64(depth)) % wp.int64(depth))


@wp.func
def entry_time(times: wp.array(dtype=wp.int64), now: wp.int64, step: wp.int64, age: int) -> wp.int64:
    """Time of the entry ``age`` steps ago [ns]."""
    if age == 0:
        return now
    return times[slot(step, age, times.shape[0])]


@wp.func
def entry_before(times: wp.array(dtype=wp.int64), now: wp.int64, step: wp.int64, guess: int, source: wp.int64) -> int:
    """Age in steps of the newest entry that is not newer than ``source``; the oldest one if all are newer."""
    age = wp.clamp(guess, 0, times.shape[0] - 1)
    while age > 0 and entry_time(times, now, step, age - 1) <= source:
        age -= 1
    while age < times.shape[0] - 1 and entry_time(times, now, step, age) > source:
        age += 1
    return age


@wp.kernel(module="unique", enable_backward=False)
def mark_birth(
    mask: wp.array(dtype=wp.bool),
    now: wp.array(dtype=wp.int64),
    birth: wp.array(dtype=wp.int64),
    newest: wp.array(dtype=wp.int64),
):
    """A reset: what lies before now does not count any more for these environments."""
    e = wp.tid()
    if mask[e]:
        birth[e] = now[0]
        newest[e] = now[0]


def ring_depth(longest_s: float, context: Context, what: str) -> int:
    """Readings to keep so that one ``longest_s`` old can be interpolated, at the step length of the scene.

    Raises:
        SceneError: if that is more than :data:`LARGEST`.
    """
    dt = float(np.asarray(context.dt.numpy())[0])
    steps = longest_s / dt if dt > 0.0 else 0.0
    if not steps < LARGEST:
        raise SceneError(
            f"{what}: {longest_s:g} s at steps of {dt:g} s would keep {steps:.3g} readings; at most {LARGEST}"
        )
    return math.ceil(steps - 1e-9) + 2


class Ring:
    """Times and values of the last readings of every environment."""

    def __init__(self, depth: int, n_columns: int, dtype: type, context: Context):
        device = context.device
        self.depth = depth
        self.times = wp.full(depth, NEVER, dtype=wp.int64, device=device)
        self.values = wp.zeros((depth, context.n_envs, n_columns), dtype=dtype, device=device)
        self.birth = wp.zeros(context.n_envs, dtype=wp.int64, device=device)
        """Time of each environment's last reset [ns]."""
        self.newest = wp.full(context.n_envs, NEVER, dtype=wp.int64, device=device)
        """Latest time whose reading was delivered [ns]."""
        self._now = context.time_ns

    def reset(self, mask: wp.array) -> None:
        """Forgets the readings of the environments in the mask."""
        wp.launch(
            mark_birth, dim=mask.shape, inputs=[mask, self._now, self.birth, self.newest], device=self.birth.device
        )
