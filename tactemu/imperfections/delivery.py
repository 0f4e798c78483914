"""The delivery of readings: delay and jitter to the nanosecond, and the history of delivered readings."""

from __future__ import annotations

import functools

import numpy as np
import warp as wp

from tactemu.base.errors import SceneError
from tactemu.base.options import numbers
from tactemu.imperfections.columns import environment_indices
from tactemu.imperfections.delivery_kernels import deliver_kernel, remember_kernel, select_kernel
from tactemu.imperfections.info import ReadingInfo
from tactemu.imperfections.options import ChainOptions
from tactemu.imperfections.random import stream_keys
from tactemu.imperfections.ring import Ring, ring_depth
from tactemu.plan.clearing import clear_rows
from tactemu.plan.launches import in_turn
from tactemu.plan.plan import Context, Stage


class Delay:
    """The delay of a sensor's readings; made only for a sensor with a delay or jitter."""

    def __init__(self, options: ChainOptions, info: ReadingInfo, context: Context):
        self._options, self._info, self._context = options, info, context
        dt = float(context.dt.numpy()[0])
        jitter = max(options.jitter, dt) if "jitter" in options.adjustable else options.jitter
        self._depth = ring_depth(options.delay + jitter, context, f"sensor {info.name!r}: delay + jitter")
        self._longest_s = max(options.delay + jitter, (self._depth - 2) * dt)
        lags = np.rint(np.array([options.delay, options.jitter]) * 1e9).astype(np.int64)
        self._lags = context.array(np.tile(lags, (context.n_envs, 1)), wp.int64)

    def compile(self, measured: wp.array) -> tuple[wp.array, list[Stage]]:
        """Return the delivered readings, in the shape and type of ``measured``, and the stages that fill them."""
        options, info, context = self._options, self._info, self._context
        flat = (context.n_envs, info.n_columns)
        ring = Ring(self._depth, info.n_columns, measured.dtype, context)
        linear = options.delay_interpolation == "linear" and measured.dtype is not wp.bool
        newest = context.zeros(context.n_envs, wp.int64)
        chosen = context.zeros(context.n_envs, wp.vec3i)
        share = context.zeros(context.n_envs, wp.float64)
        keys = stream_keys(context.seed, f"{info.name}/jitter")
        nearest = options.delay_interpolation == "nearest"
        select = context.record(
            select_kernel(self.has_jitter, nearest, linear, options.jitter_reorder),
            context.n_envs,
            [context.clock, keys, self._lags, ring.birth],
            [ring.times, newest, chosen, share],
        )
        out = context.zeros(measured.shape, measured.dtype)
        deliver = context.record(
            deliver_kernel(measured.dtype, linear),
            (context.n_envs, -(-info.n_columns // 4)),
            [measured.reshape(flat), chosen, share],
            [ring.values, out.reshape(flat)],
        )

        def reset(mask: wp.array) -> None:
            ring.reset(mask)
            clear_rows(out, mask)

        reason = f"delay {options.delay:g} s, jitter {options.jitter:g} s, {options.delay_interpolation}"
        return out, [Stage(name=f"{info.name}: delay", reason=reason, launch=in_turn(select, deliver), reset=reset)]

    @property
    def has_jitter(self) -> bool:
        """True if a further delay is drawn."""
        return self._options.jitter > 0.0 or "jitter" in self._options.adjustable

    def set(self, value, envs=None, taxels=None) -> None:
        """Change the jitter [s] of the chosen environments, to one number or one for each.

        Raises:
            SceneError: the jitter is negative or too large for the ring, or ``taxels`` are given.
        """
        if taxels is not None:
            raise SceneError(f"sensor {self._info.name!r}: jitter applies to the sensor, not to single taxels")
        chosen = environment_indices(envs, self._context.n_envs)
        jitter = numbers(f"sensor {self._info.name!r}", "jitter", value)
        if jitter.shape not in ((), (1,), chosen.shape):
            raise SceneError(
                f"sensor {self._info.name!r}: jitter must be one number or one for each environment, got {value!r}"
            )
        if not np.all((jitter >= 0.0) & (self._options.delay + jitter <= self._longest_s + 1e-12)):
            room = self._longest_s - self._options.delay
            raise SceneError(
                f"sensor {self._info.name!r}: jitter must be in 0..{room:g} s, for which the scene was built;"
                f" got {value!r}. Build the scene with a larger jitter, then set it to less"
            )
        lags = self._lags.numpy()
        lags[chosen, 1] = np.broadcast_to(np.rint(jitter * 1e9), chosen.shape)
        self._lags.assign(lags)


def compile_history(
    length: int, reading: wp.array, info: ReadingInfo, context: Context
) -> tuple[wp.array, list[Stage]]:
    """Return the array of the last ``length`` readings, newest first, and its stages; 0 returns ``reading`` itself.

    The array has shape ``(n_envs, length, n_taxels, n_channels)``.
    """
    if length <= 0:
        return reading, []
    columns = info.n_columns
    out = context.zeros((context.n_envs, length, *reading.shape[1:]), reading.dtype)
    launch = context.record(
        remember_kernel(reading.dtype),
        (context.n_envs, columns),
        [reading.reshape((context.n_envs, columns))],
        [out.reshape((context.n_envs, length, columns))],
    )
    reset = functools.partial(clear_rows, out)
    reason = f"history_length {length}"
    return out, [Stage(name=f"{info.name}: history", reason=reason, launch=launch, reset=reset)]
