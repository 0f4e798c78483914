"""A ring buffer of the last readings with their times, and the search for the reading of a given time.

Entry ``k`` is the reading ``k`` steps ago; entry 0 is the present step, which is in the ring only after it. Entries
older than an environment's last reset do not count; the step's number decides, since a reset may restart the time.
Times are int64 nanoseconds, so that nothing is rounded to steps.
"""

import math

import warp as wp

from tactemu.base.errors import SceneError
from tactemu.base.kernels import warp_kernel
from tactemu.plan.plan import Context

FRESH = -1
"""A value in place of a step number: no step was taken yet, and the next is the first."""
MAX_RING_READINGS = 2**20
"""The most readings that a ring may hold."""


@wp.func
def slot(step: wp.int64, age: int, depth: int) -> int:
    """Return the slot of the entry ``age`` steps before ``step``."""
    # Without the addition the remainder would be negative before the start.
    return int((step - wp.int64(age) + wp.int64(depth)) % wp.int64(depth))


@wp.func
def entry_time(times: wp.array(dtype=wp.int64), now: wp.int64, step: wp.int64, age: int) -> wp.int64:
    """Return the time of the entry ``age`` steps ago [ns]."""
    if age == 0:
        return now
    return times[slot(step, age, times.shape[0])]


@wp.func
def share_of_newer(
    times: wp.array(dtype=wp.int64), now: wp.int64, step: wp.int64, count: int, age: int, source: wp.int64, dt: wp.int64
) -> wp.float64:
    """Return the share of the entry after ``age``, of ``count``, in a reading interpolated for the time ``source``."""
    share = wp.float64(0.0)
    if age > 0:
        after = entry_time(times, now, step, age - 1)
        # Before a reset nothing is known: readings rise from zero during the first step.
        before = after - dt
        if age < count:
            before = entry_time(times, now, step, age)
        if source > before:
            share = wp.float64(source - before) / wp.float64(after - before)
    return share


@wp.func
def entries(birth: wp.int64, step: wp.int64, depth: int) -> int:
    """Return the number of entries since the reset after step ``birth``, this step's included."""
    if birth < wp.int64(0):
        return 1
    return int(wp.min(step - birth, wp.int64(depth)))


@wp.func
def entry_before(
    times: wp.array(dtype=wp.int64), now: wp.int64, step: wp.int64, count: int, guess: int, source: wp.int64
) -> int:
    """Return the age in steps of the newest of ``count`` entries that is not newer than ``source``.

    It is ``count`` if all are newer: the time lies before the reset. In a full ring it is the age of the oldest entry.
    """
    age = wp.clamp(guess, 0, count - 1)
    while age > 0 and entry_time(times, now, step, age - 1) <= source:
        age -= 1
    while age < count and entry_time(times, now, step, age) > source:
        age += 1
    return wp.min(age, times.shape[0] - 1)


@warp_kernel
def mark_fresh(mask: wp.array(dtype=wp.bool), birth: wp.array(dtype=wp.int64)):
    """Reset environments: their next step is the first, whatever its number."""
    e = wp.tid()
    if mask[e]:
        birth[e] = wp.int64(wp.static(FRESH))


def ring_depth(longest_s: float, context: Context, what: str) -> int:
    """Return the number of readings to keep to interpolate one ``longest_s`` old at the scene's step length.

    Raises:
        SceneError: the number is larger than :data:`MAX_RING_READINGS`.
    """
    dt = round(float(context.dt.numpy()[0]) * 1e9) * 1e-9
    if not dt > 0.0:
        raise SceneError(f"{what} needs steps of at least a nanosecond, got {dt:g} s; make dt larger")
    steps = longest_s / dt
    if not steps < MAX_RING_READINGS:
        raise SceneError(
            f"{what}: {longest_s:g} s at steps of {dt:g} s would keep {steps:.3g} readings; at most {MAX_RING_READINGS}"
        )
    return math.ceil(steps - 1e-9) + 2


class Ring:
    """The times and values of the last readings of every environment."""

    def __init__(self, depth: int, n_columns: int, dtype: type, context: Context):
        self.times = context.zeros(depth, wp.int64)
        self.values = context.zeros((depth, context.n_envs, n_columns), dtype)
        self.birth = context.full(context.n_envs, FRESH, wp.int64)
        """Number of the step after which each environment was reset, or :data:`FRESH`."""

    def reset(self, mask: wp.array) -> None:
        """Discard the readings of the environments in the mask."""
        wp.launch(mark_fresh, dim=mask.shape, inputs=[mask, self.birth], device=self.birth.device)
