"""Learning of the columns of a driver's rows from a run without faults.

First the delay: each row is compared with the sample that the last frame before it carried, then with earlier samples,
and the delay with the best rank correlation is taken; if the delay drifts, consecutive rows are matched with
consecutive samples. Then the content, from simple to complex: a line of one channel; a line after a known mistake
(bytes swapped, sign lost); a curve that rises or falls; a mix of channels; nothing. Nothing is guessed: a column that
fits several channels, or none, is reported as such.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactemu.judge.checks import is_named
from tactemu.judge.columns import ABSOLUTE, TABLES, TRANSFORMS, Channel, Column, Columns
from tactemu.judge.line_fits import Line, distinct, is_line, is_monotone, line, ranks
from tactemu.judge.trial_record import DriverRow
from tactemu.truth import Passage, Sample

MIN_ROWS = 20
"""Least number of rows to learn from."""
_MAX_LAG = 300
"""Number of delays that are tried [samples]."""
_MIN_SHARE = 0.97
"""Least share of the rows that a rule must explain; otherwise the next rule is tried."""
_MIN_SHARE_HELD = 0.85
"""The same for the few rows that there are when samples are held."""
ALIKE = 0.97
"""Channels with at least this share of the best correlation are tried too."""
_MIN_SHARE_FIRST = 0.25
"""Least explained share in the first pass, in which half of the rows may be assigned to wrong samples."""
_MIN_SHARE_SECOND = 0.6
"""Least explained share in the second pass; a column with less holds something else."""
_HELD_SAMPLES = 4
"""Number of equal consecutive samples by which a held sample is recognised."""
_MIN_LIMIT_SHARE = 0.02
"""Least share of rows with one and the same extreme value, for a limit."""
_MIN_INNER_ROWS = 12
"""Least number of rows between the limits, for a line."""
_CLOSER = 0.1
"""Share of the residual of an earlier mistake below which a later mistake that explains the column is preferred."""
_GAIN_TOLERANCE = 0.01
"""Relative difference of two gains of opposite signs that belong to an absolute value."""
_INTEGER_TOLERANCE = 0.2
"""Largest distance of a zero from an integer count at which it is rounded."""
_MAX_MIX = 24
"""Maximum number of channels in a mix."""


class UnlearnableError(Exception):
    """The rows are too few to learn from; the message says why."""


def learn(
    rows: Sequence[DriverRow],
    samples: Sequence[Sample],
    frames: Sequence[Passage],
    channels: Sequence[Channel],
    seed: int = 0,
    steps: bool = False,
) -> Columns:
    """Return the learned columns of a driver's rows.

    Args:
        rows: printed by the driver.
        samples: sent by the device.
        frames: that carried the samples.
        channels: of a sample, in its order.
        seed: of the random choices.
        steps: True if samples were held, for a driver that filters: only the rows at the end of each are used.

    Raises:
        UnlearnableError: there are too few rows.
    """
    names = _usual_names(rows)
    good = [printed for printed in rows if tuple(printed.row) == names]
    if len(good) < MIN_ROWS:
        raise UnlearnableError(f"{len(good)} rows of numbers: at least {MIN_ROWS} are needed")
    return _ColumnFitter(good, names, samples, frames, channels, seed, steps).columns()


def _usual_names(rows: Sequence[DriverRow]) -> tuple[str, ...]:
    counts: dict[tuple[str, ...], int] = {}
    for printed in rows:
        counts[tuple(printed.row)] = counts.get(tuple(printed.row), 0) + 1
    return max(counts, key=lambda names: counts[names], default=())


class _ColumnFitter:
    def __init__(
        self, rows: Sequence[DriverRow], names: tuple[str, ...], samples: Sequence[Sample], frames: Sequence[Passage],
        channels: Sequence[Channel], seed: int, steps: bool,
    ):  # fmt: skip
        width = max((len(sample.counts) for sample in samples), default=0)
        samples = [sample for sample in samples if len(sample.counts) == width]
        self.names, self.channels, self.steps = names, channels, steps
        self.min_share = _MIN_SHARE_HELD if steps else _MIN_SHARE
        self.random = np.random.default_rng(seed)
        self._kept: dict[tuple, np.ndarray] = {}
        self.t = np.array([printed.t_ns for printed in rows])
        self.y = np.array([[printed.row[name] for name in names] for printed in rows])
        self.x = np.array([sample.counts for sample in samples]).reshape(len(samples), width)
        self.columns_ = [_role(name, self.y[:, k]) for k, name in enumerate(names)]
        self.open = [k for k, column in enumerate(self.columns_) if column.role == "other"]
        self.live = np.flatnonzero(np.ptp(self.x, axis=0) > 0) if len(self.x) else np.zeros(0, int)
        self.distinct, self.equal = distinct(self.x, self.live)
        self.newest = self._newest(samples, frames)
        if steps:
            self._keep_settled_rows()
        self.ranked = ranks(self.x[:, self.distinct]) if len(self.distinct) else np.zeros((0, 0))

    def _newest(self, samples: Sequence[Sample], frames: Sequence[Passage]) -> np.ndarray:
        """Return the sample index of the last frame before each row; without frames, the last sample before it."""
        at = {sample.number: k for k, sample in enumerate(samples)}
        carried = [(f.t_ns, at[f.sample]) for f in frames if f.kind == "tx" and f.sample in at]
        carried = carried or [(sample.t_ns, k) for k, sample in enumerate(samples)]
        if not carried:
            return np.full(len(self.t), -1)
        times, index = np.array(carried).T
        last = np.searchsorted(times, self.t, side="right") - 1
        return np.where(last >= 0, index[np.maximum(last, 0)], -1)

    def _keep_settled_rows(self) -> None:
        """Keep only the rows that come when a sample has been held longest."""
        changes = np.append(np.any(np.diff(self.x, axis=0) != 0, axis=1), False)
        # Except the change after it.
        still = np.convolve(~changes, np.ones(_HELD_SAMPLES))[: len(changes)] == _HELD_SAMPLES - 1
        last = changes & still  # a device may filter too: its samples go on changing for a while
        settled = (self.newest >= 0) & last[self.newest] if len(last) else np.zeros(len(self.t), bool)
        self.t, self.y, self.newest = self.t[settled], self.y[settled], self.newest[settled]
        if len(self.t) < MIN_ROWS:
            raise UnlearnableError(f"{len(self.t)} rows at the end of a sample that was held: {MIN_ROWS} are needed")

    def columns(self) -> Columns:
        """Learn the columns and return them."""
        if self.open and len(self.live):
            index = self._aligned()
            # Again with the rows at their own samples. Random numbers beside few held samples reach the lower share.
            for least in (_MIN_SHARE_FIRST, _MIN_SHARE_SECOND)[self.steps :]:
                for k in self.open:
                    self.columns_[k] = self._fit(k, index, least)
                found = Columns(self.columns_, list(self.channels))
                if not found.values or self.steps:
                    break
                index = self._matched(found, index)
            self._mixes(index)
        return Columns(self.columns_, list(self.channels), self.steps)

    # -- delay ---------------------------------------------------------------------------------------------------------

    def _aligned(self) -> np.ndarray:
        """Return the sample index of each row under a constant delay; -1 before the first sample."""
        ry = ranks(self.y[:, self.open[:16]])
        score, lag = self._lag(ry, self.ranked)
        if score < 0.5 * ry.shape[1]:
            if (wandering := self._by_sequence()) is not None:
                return wandering
            tried = [  # every column may be decoded wrongly
                self._lag(ry, ranks(_transformed(how, self.x[:, channels])))
                for how in TRANSFORMS
                if how != "line" and len(channels := self._tried(how, self.x))
            ]
            score, lag = max([(score, lag), *((each, at) for each, at in tried if each > 0.5 * ry.shape[1])])
        return self.newest - lag

    def _lag(self, ry: np.ndarray, ranked: np.ndarray) -> tuple[float, int]:
        """Return the best score of the rank correlation of columns and channels, and its delay."""
        scores = []
        for lag in range(min(_MAX_LAG, max(1, len(self.x) - MIN_ROWS))):
            index = self.newest - lag
            ok = index >= 0
            like = np.abs(ry[ok].T @ ranked[index[ok]]) / max(1, ok.sum()) if ok.sum() >= MIN_ROWS else 0.0
            scores.append(float(np.sum(np.max(like, axis=1))) if np.ndim(like) else 0.0)
        return max(scores), int(np.argmax(scores))

    def _tried(self, how: str, x: np.ndarray) -> np.ndarray:
        """Return the channels that are tried after a mistake; without integer counts, only for an absolute value."""
        first = self.distinct[:8]
        applies = how == ABSOLUTE or np.array_equal(x[:, first], np.rint(x[:, first]))
        return self.distinct[:256] if applies else np.zeros(0, int)

    def _by_sequence(self, width: int = 9) -> np.ndarray | None:
        """Return the sample index of each row under a drifting delay, or None.

        Nine consecutive rows that match nine consecutive samples give a line, and the line gives all other rows.
        """
        for i in range(5, len(self.y) - width, max(1, len(self.y) // 16)):
            low, high = max(0, self.newest[i] - 600), min(self.newest[i] + 1, len(self.x) - width)
            if high - low < 2:
                continue
            for k in self.open[:4]:
                y = self.y[i : i + width, k] - self.y[i : i + width, k].mean()
                if not y.any():
                    continue
                for c in self.distinct[:64]:
                    windows = np.lib.stride_tricks.sliding_window_view(self.x[low : high + width, c], width)
                    centred = windows - windows.mean(axis=1, keepdims=True)
                    like = centred @ y / np.maximum(np.linalg.norm(centred, axis=1) * np.linalg.norm(y), 1e-12)
                    at = int(np.argmax(np.abs(like)))
                    if abs(like[at]) > 0.9999:
                        gain, offset, tolerance, share = line(windows[at], self.y[i : i + width, k], self.random)
                        if share > 0.8:
                            return self._followed(k, int(c), gain, offset, tolerance)
        return None

    def _followed(self, k: int, c: int, gain: float, offset: float, tolerance: float) -> np.ndarray:
        """Return the sample index of each row by one column: of those that fit, the nearest to the next one."""
        index, last = np.full(len(self.y), -1), None
        for i, newest in enumerate(self.newest):
            low = max(0, newest - 2000)
            fits = low + np.flatnonzero(np.abs(gain * self.x[low : newest + 1, c] + offset - self.y[i, k]) <= tolerance)
            if len(fits):
                index[i] = fits[np.abs(fits - (newest if last is None else last + 1)).argmin()]
                last = index[i]
        return index

    def _matched(self, columns: Columns, index: np.ndarray) -> np.ndarray:
        """Return for each row the index of the recent sample with which most of its columns agree."""
        expected, slack = columns.expected(self.x), columns.slack(self.x)
        names = {name: k for k, name in enumerate(self.names)}
        y = self.y[:, [names[name] for name in columns.names]]
        found = index.copy()
        for i, newest in enumerate(self.newest):
            low = max(0, newest - 600)
            near = (np.abs(expected[low : newest + 1] - y[i]) <= slack[low : newest + 1]).sum(axis=1)
            if len(near) and near.max() > 0.5 * y.shape[1]:
                best = np.flatnonzero(near == near.max()) + low
                found[i] = best[np.abs(best - index[i]).argmin()]
        return found

    # -- content -------------------------------------------------------------------------------------------------------

    def _fit(self, k: int, index: np.ndarray, least: float) -> Column:
        ok = index >= 0
        x, y = self.x[index[ok]], self.y[ok, k]
        best = Column(self.names[k])
        own, residual = ranks(y[:, None])[:, 0], np.inf
        like = np.abs(own @ self.ranked[index[ok]]) / max(1, len(y))
        for how, transform in TRANSFORMS.items():
            if how == "line":
                first = np.argsort(-like.round(9), kind="stable")[:3]
                likely = self.distinct[first[like[first] > ALIKE * like[first[0]]]]
            else:
                tried = self._tried(how, x)
                turned = self._turned(how, x, tried) if len(tried) else np.zeros((len(y), 0))
                same = np.abs(own @ turned) / max(1, len(y))
                likely = np.array(tried)[np.argsort(-same)[:2]] if len(tried) else []
            zeros = {c: self._zero(x[:, c], y) if how == ABSOLUTE else 0.0 for c in likely}
            likely = [c for c in likely if how == "line" or not is_line(x[:, c], transform(x[:, c] - zeros[c]))]
            fits = [(c, line(transform(x[:, c] - zeros[c]), y, self.random, steps=self.steps)) for c in likely]
            for c, (gain, offset, tolerance, share) in fits:
                found = Column(self.names[k], "value", int(c), how, gain, offset, tolerance, zero=zeros[c], share=share)
                off = max(float(np.abs(found.of(x) - y).mean()), 1e-6 * float(np.ptp(y)))
                closer = min(share, best.share) > self.min_share and off < _CLOSER * residual
                if share > best.share + 0.02 or closer:
                    best, residual = found, off
                    self._add_equal(best, [fit for fit in fits if min(share, fit[1][3]) > self.min_share])
            if how == "line" and best.share > self.min_share:
                break
        if best.share < self.min_share:
            best = self._clipped(k, x, y, like) or best
        if best.share < self.min_share:
            best = self._curve(k, x, y, int(self.distinct[np.argmax(like)])) or best
        if best.how in TABLES:
            self._add_equal(best)
        return best if best.share >= least else Column(self.names[k])

    def _add_equal(self, best: Column, fits: Sequence[tuple[int, Line]] = ()) -> None:
        """Add the channels that a column could hold just as well, or give it the one of them that its name states.

        Args:
            best: the column, with one of its channels.
            fits: lines of other channels that fit as well.
        """
        lines = {best.channel: (best.gain, best.offset, best.tolerance, best.share)} | {int(c): fit for c, fit in fits}
        alike = {int(k): fit for c, fit in lines.items() for k in self.equal[c]}
        if len(alike) < 2:
            return
        named = [k for k in alike if k < len(self.channels) and is_named(best.name, self.channels[k])]
        if len(named) == 1:
            best.channel, (best.gain, best.offset, best.tolerance, best.share) = named[0], alike[named[0]]
        else:
            best.also = list(alike)

    def _turned(self, how: str, x: np.ndarray, channels: np.ndarray) -> np.ndarray:
        """Return the ranks of the channels after a mistake; cached, since every column needs them."""
        key = (how, len(x), float(x.sum()))
        if key not in self._kept:
            self._kept[key] = ranks(_transformed(how, x[:, channels]))
        return self._kept[key]

    def _zero(self, x: np.ndarray, y: np.ndarray) -> float:
        """Return the count at which two lines of opposite gains meet, or 0 if the rows lie on no such lines."""
        gain, offset, tolerance, share = line(x, y, self.random, steps=self.steps)
        left = np.abs(gain * x + offset - y) > tolerance
        other, its_offset, _, its_share = line(x[left], y[left], self.random, steps=self.steps)
        if (
            not other
            or not np.isclose(other, -gain, rtol=_GAIN_TOLERANCE)
            or share + its_share * left.mean() < self.min_share
        ):
            return 0.0
        zero = (its_offset - offset) / (gain - other)
        is_integer = np.array_equal(x, np.rint(x)) and abs(zero - round(zero)) < _INTEGER_TOLERANCE
        return float(round(zero)) if is_integer else float(zero)

    def _clipped(self, k: int, x: np.ndarray, y: np.ndarray, like: np.ndarray) -> Column | None:
        """Return a column that is a line of a channel, clipped at one or two limits, or None."""
        low, high = float(y.min()), float(y.max())
        ends = [end for end in (low, high) if (y == end).sum() >= max(5, _MIN_LIMIT_SHARE * len(y))]
        inner = ~np.isin(y, ends)
        if not ends or inner.sum() < _MIN_INNER_ROWS:
            return None
        first = np.argsort(-like)[:3]
        for c in self.distinct[first[like[first] > ALIKE * like[first[0]]]]:
            counts = x[:, c]
            gain, offset, tolerance, share = line(counts[inner], y[inner], self.random, steps=self.steps)
            if share < self.min_share:
                continue
            unclipped = gain * counts + offset
            limits = (low if low in ends else -np.inf, high if high in ends else np.inf)
            beyond = np.abs(np.clip(unclipped, *limits) - unclipped) > 3 * tolerance + 2 * abs(gain)
            share = float((np.abs(np.clip(unclipped, *limits) - y) <= tolerance).mean())
            if share < self.min_share or beyond.mean() < _MIN_LIMIT_SHARE:
                continue
            at = sorted({float(counts.min()), float(counts.max()), *((end - offset) / gain for end in ends)})
            table = [[float(a), float(np.clip(gain * a + offset, *limits))] for a in at]
            return Column(self.names[k], "value", int(c), "clipped", gain, offset, tolerance, table=table, share=share)
        return None

    def _curve(self, k: int, x: np.ndarray, y: np.ndarray, c: int) -> Column | None:
        """Return a column that is a table of a channel with which it rises or falls, or None."""
        counts, values = x[:, c], y
        order = np.argsort(counts, kind="stable")
        steps = np.diff(values[order])
        rising = (steps >= 0).mean()
        if max(rising, (steps <= 0).mean()) < self.min_share or np.ptp(counts) == 0:
            return None
        known, first = np.unique(counts[order], return_inverse=True)
        table = np.array([np.median(values[order][first == n]) for n in range(len(known))])
        if len(known) > 256:
            chosen = np.linspace(0, len(known) - 1, 256).round().astype(int)
            known, table = known[chosen], table[chosen]
        how = "curve" if is_monotone(values[order]) else "fold"
        off = np.abs(np.interp(counts, known, table) - values)
        tolerance = max(3 * float(np.quantile(off, 0.99)), 0.01 * float(np.ptp(values)))
        share = float((off <= tolerance).mean())
        return Column(
            self.names[k], "value", c, how, tolerance=tolerance, share=share,
            table=[[float(a), float(b)] for a, b in zip(known, table)],
        )  # fmt: skip

    def _mixes(self, index: np.ndarray) -> None:
        """Explain the remaining columns as weighted sums of few channels, by least squares."""
        ok = index >= 0
        if len(self.live) * 2 + MIN_ROWS > ok.sum():
            return
        x = np.column_stack([self.x[index[ok]][:, self.live], np.ones(ok.sum())])
        for k in self.open:
            if self.columns_[k].role == "value":
                continue
            y = self.y[ok, k]
            weights = np.linalg.lstsq(x, y, rcond=None)[0]
            off = np.abs(x @ weights - y)
            tolerance = max(3 * float(np.quantile(off, 0.99)), 1e-6 * float(np.ptp(y)))
            spread = float(np.ptp(y))
            heavy = np.flatnonzero(np.abs(weights[:-1]) * np.ptp(x[:, :-1], axis=0) > 1e-3 * spread)
            if tolerance > 0.02 * spread or not 0 < len(heavy) <= _MAX_MIX:
                continue
            self.columns_[k] = Column(
                self.names[k], "value", int(self.live[heavy[np.argmax(np.abs(weights[heavy]))]]), "mix",
                offset=float(weights[-1]), tolerance=tolerance, share=1.0,
                weights={str(int(self.live[c])): float(weights[c]) for c in heavy},
            )  # fmt: skip


def _transformed(how: str, x: np.ndarray) -> np.ndarray:
    """Return counts after a mistake; an absolute value is taken about the median, until its zero is known."""
    return TRANSFORMS[how](x - (np.median(x, axis=0) if how == ABSOLUTE else 0.0))


def _role(name: str, y: np.ndarray) -> Column:
    """Return a column with its role by its own values: a flag is constant, a counter or a clock rises."""
    if not np.isfinite(y).all():
        return Column(name, "other")
    if np.ptp(y) == 0:
        return Column(name, "flag", constant=float(y[0]))
    steps = np.diff(y)
    rising, climbs = (steps >= 0).mean() > 0.97, (steps > 0).mean() > 0.3
    if rising and climbs:
        counts = bool(np.array_equal(y, np.rint(y))) and float(np.median(steps[steps > 0])) < 1000
        return Column(name, "counter" if counts else "time")
    return Column(name, "other")
