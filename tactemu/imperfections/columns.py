"""Parameters that you give as one number or one per column, and their arrays on the device."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from firmware_protocols.bounds import LARGEST
from tactemu.base.errors import SceneError, shown
from tactemu.base.options import numbers
from tactemu.imperfections.info import ReadingInfo
from tactemu.plan.plan import Context


def per_column(value, info: ReadingInfo, option: str) -> np.ndarray:
    """Return ``value`` as float64 of shape ``(1,)`` if it is one number, else ``(n_columns,)``, taxel by taxel.

    Raises:
        SceneError: the shape fits neither taxels nor columns, or a number is not finite.
    """
    array = numbers(f"sensor {info.name!r}", option, value)
    n, c = info.n_taxels, info.n_channels
    if array.ndim == 0:
        return array.reshape(1)
    if array.shape in ((n,), info.layout):
        return np.repeat(array.reshape(n), c)
    if array.shape in ((n, c), (*info.layout, c)):
        return array.reshape(n * c)
    if array.shape == (n * c,):
        return _blocks_to_taxels(array, info)
    raise SceneError(
        f"sensor {info.name!r}: {option} has shape {array.shape}; expected one number, {info.layout} or ({n},) for one"
        f" per taxel, or ({n}, {c}) or ({n * c},) for one per column"
    )


def _blocks_to_taxels(flat: np.ndarray, info: ReadingInfo) -> np.ndarray:
    """Return a flat list of successive groups of channels in taxel-major order."""
    widths = [1 if kind == "scalar" else 3 for kind in info.channels]
    ends = np.cumsum(widths) * info.n_taxels
    blocks = [part.reshape(info.n_taxels, w) for part, w in zip(np.split(flat, ends[:-1]), widths)]
    return np.concatenate(blocks, axis=1).reshape(-1)


def environment_indices(envs, n_envs: int) -> np.ndarray:
    """Return the indices of environments given as ``None`` (all of them), a mask or a list of indices.

    Raises:
        SceneError: an index is outside ``0 .. n_envs - 1``.
    """
    if envs is None:
        return np.arange(n_envs)
    chosen = np.atleast_1d(np.asarray(envs))
    if chosen.dtype == bool and chosen.shape == (n_envs,):
        return np.flatnonzero(chosen)
    chosen = chosen.astype(np.int64)
    if chosen.size and (chosen.min() < 0 or chosen.max() >= n_envs):
        raise SceneError(f"environment {int(chosen.min())}..{int(chosen.max())} is outside 0..{n_envs - 1}")
    return chosen


SIGNED = {"bias", "temperature_offset", "temperature_sensitivity", "saturation_range", "gain"}
"""Options that may be negative."""


class ParameterTable:
    """A parameter of each environment, one number or one per column: ``(n_envs, 1)`` or ``(n_envs, n_columns)``."""

    def __init__(self, value, info: ReadingInfo, option: str, context: Context, *, wide: bool = False):
        row = per_column(value, info, option)
        if wide and row.size == 1:
            row = np.repeat(row, info.n_columns)
        self.option, self._info = option, info
        self.array = context.array(np.tile(row, (context.n_envs, 1)), context.real)

    def set(self, value, envs: Sequence[int] | None = None, taxels: Sequence[int] | None = None) -> None:
        """Set a new value in the chosen environments; a value with a leading axis has one entry for each of them.

        Args:
            value: the new value.
            envs: the environments; ``None``: all.
            taxels: the taxels that change, to one number or one for each; ``None``: all.

        Raises:
            SceneError: the value does not fit, or is negative where the option has no sign.
        """
        chosen = environment_indices(envs, self.array.shape[0])
        columns = value if taxels is None else self._all_columns(value, chosen, np.asarray(taxels, np.int64))
        rows = self._rows(columns, len(chosen))
        if self.option not in SIGNED and (rows < 0.0).any():
            raise SceneError(f"sensor {self._info.name!r}: {self.option} must be zero or positive, got {shown(value)}")
        if rows.shape[-1] > self.array.shape[1]:
            raise SceneError(
                f"sensor {self._info.name!r}: {self.option} was built with one number for all columns; list it in"
                f" `adjustable` to set one per column while running"
            )
        now = self.array.numpy()
        now[chosen] = rows
        self.array.assign(now)

    def _all_columns(self, value, envs: np.ndarray, taxels: np.ndarray) -> np.ndarray:
        """Return the values of all columns with new ones for some taxels.

        The shape is ``(chosen environments, n_taxels, n_channels)``.
        """
        info = self._info
        given = numbers(f"sensor {info.name!r}", self.option, value)
        if given.shape not in ((), (1,), taxels.shape):
            raise SceneError(
                f"sensor {info.name!r}: {self.option}: expected one number, or one for each of {len(taxels)} taxels, "
                f"got shape {given.shape}"
            )
        now = self.array.numpy()[envs if len(envs) else [0]]
        columns = (
            np.broadcast_to(now, (len(now), info.n_columns)).reshape(len(now), info.n_taxels, info.n_channels).copy()
        )
        columns[:, taxels] = given.reshape(-1, 1)
        return columns if len(envs) else columns[0]

    def _rows(self, value, n: int) -> np.ndarray:
        try:
            return per_column(value, self._info, self.option)
        except SceneError:
            per_env = numbers(f"sensor {self._info.name!r}", self.option, value)
            if per_env.ndim == 0 or not n or len(per_env) != n:
                raise
            rows = [per_column(v, self._info, self.option) for v in per_env]
            return np.stack(rows)


class ParameterRange:
    """A range of each environment, low and high: ``(n_envs, 1)`` each; ``None`` is the range of all numbers."""

    def __init__(self, value, info: ReadingInfo, option: str, context: Context, *, wide: bool = False):
        self._info, self._option = info, option
        self.low, self.high = (ParameterTable(bound, info, option, context, wide=wide) for bound in self._bounds(value))

    def set(self, value, envs: Sequence[int] | None = None, taxels: Sequence[int] | None = None) -> None:
        """Set new bounds in the chosen environments, one pair for all, or one for each if the bounds are arrays.

        Raises:
            SceneError: the bounds are no range.
        """
        low, high = self._bounds(value)
        self.low.set(low, envs, taxels)
        self.high.set(high, envs, taxels)

    def _bounds(self, value) -> tuple:
        where = f"sensor {self._info.name!r}"
        limits = np.array((-LARGEST, LARGEST)) if value is None else numbers(where, self._option, value)
        if limits.shape[:1] != (2,) or (limits[0] > limits[1]).any():
            raise SceneError(f"{where}: {self._option} must be (low, high), low <= high, got {value!r}")
        return limits[0], limits[1]
