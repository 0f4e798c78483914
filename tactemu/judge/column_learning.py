"""Learning the columns of a driver's rows from a run without faults.

First when: each row is set beside the sample that the last frame before it carried, then beside those before that,
and the delay is where ranks agree most; where it wanders, a stretch is looked for in which rows follow one another as
samples do. Then what, by attempts from simple to strange: a line of one channel; a line after a known mistake (bytes
swapped, sign lost); a curve that rises or falls; a mix of channels; nothing. Nothing is guessed: a column that fits
several channels, or none, is said to.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactemu.judge.checks import is_named
from tactemu.judge.columns import ABSOLUTE, TRANSFORMS, Channel, Column, Columns
from tactemu.judge.line_fits import is_line, is_monotone, line, ranks
from tactemu.judge.trial_record import DriverRow, ReceivedFrame, Sample

LEAST_ROWS = 20
_LAGS = 300
_SURE = 0.97
"""A relation holds for so many of the rows, or another is tried."""
_SURE_OF_STEPS = 0.85
"""Likewise of the few rows that there are when samples are held."""
ALIKE = 0.97
"""Channels that are nearly as like a column as the likest are tried, too."""
_FEW = 0.25
"""At first, when half of the rows may still be beside the wrong samples."""
_SOME = 0.6
"""A column of which less is explained holds something else."""
_STILL = 4
"""Samples in a row that are equal when one was held."""
_CLIPPED, _INNER = 0.02, 12
"""A limit is one that so many rows stand at; and the rows between the limits that a line needs."""
_CLOSER = 0.1
"""Of two mistakes that explain a column the later is taken if it leaves less than this share of the other's rest."""
_OPPOSITE, _WHOLE = 0.01, 0.2
"""How far two gains of opposite signs may differ, and how far from a whole count their lines may meet."""
_MIX = 24
"""Channels that a mix may consist of."""


class UnlearnableError(Exception):
    """There is nothing to learn from; says why."""


def learn(
    rows: Sequence[DriverRow],
    samples: Sequence[Sample],
    frames: Sequence[ReceivedFrame],
    channels: Sequence[Channel],
    seed: int = 0,
    steps: bool = False,
) -> Columns:
    """Return the columns.

    Args:
        rows: what the driver handed out.
        samples: what was sent.
        frames: what carried it.
        channels: of a sample, in its order.
        seed: of what is tried.
        steps: samples were held, for a driver that filters: it is learned from what it says at the end of each.

    Raises:
        UnlearnableError: there are too few rows.
    """
    names = _usual_names(rows)
    good = [printed for printed in rows if tuple(printed.row) == names]
    if len(good) < LEAST_ROWS:
        raise UnlearnableError(f"{len(good)} rows of numbers: at least {LEAST_ROWS} are needed")
    return _ColumnFitter(good, names, samples, frames, channels, seed, steps).columns()


def _usual_names(rows: Sequence[DriverRow]) -> tuple[str, ...]:
    counts: dict[tuple[str, ...], int] = {}
    for printed in rows:
        counts[tuple(printed.row)] = counts.get(tuple(printed.row), 0) + 1
    return max(counts, key=lambda names: counts[names], default=())


class _ColumnFitter:
    def __init__(
        self,
        rows: Sequence[DriverRow],
        names: tuple[str, ...],
        samples: Sequence[Sample],
        frames: Sequence[ReceivedFrame],
        channels: Sequence[Channel],
        seed: int,
        steps: bool,
    ):
        width = max((len(sample.counts) for sample in samples), default=0)
        samples = [sample for sample in samples if len(sample.counts) == width]
        self.names, self.channels, self.steps = names, channels, steps
        self.sure = _SURE_OF_STEPS if steps else _SURE
        self.random = np.random.default_rng(seed)
        self._kept: dict[tuple, np.ndarray] = {}
        self.t = np.array([printed.t for printed in rows])
        self.y = np.array([[printed.row[name] for name in names] for printed in rows])
        self.x = np.array([sample.counts for sample in samples]).reshape(len(samples), width)
        self.columns_ = [_role(name, self.y[:, k]) for k, name in enumerate(names)]
        self.open = [k for k, column in enumerate(self.columns_) if column.role == "other"]
        self.live = np.flatnonzero(np.ptp(self.x, axis=0) > 0) if len(self.x) else np.zeros(0, int)
        self.newest = self._newest(samples, frames)
        if steps:
            self._keep_settled_rows()
        self.ranked = ranks(self.x[:, self.live]) if len(self.live) else np.zeros((0, 0))

    def _newest(self, samples: Sequence[Sample], frames: Sequence[ReceivedFrame]) -> np.ndarray:
        """Of each row the sample that the last frame before it carried; without frames, the last that was taken."""
        at = {sample.number: k for k, sample in enumerate(samples)}
        carried = [(f.t, at[f.sample]) for f in frames if f.way == "tx" and f.sample in at]
        carried = carried or [(sample.t, k) for k, sample in enumerate(samples)]
        if not carried:
            return np.full(len(self.t), -1)
        times, index = np.array(carried).T
        last = np.searchsorted(times, self.t, side="right") - 1
        return np.where(last >= 0, index[np.maximum(last, 0)], -1)

    def _keep_settled_rows(self) -> None:
        """Leave the rows that come when a sample has been held longest."""
        changes = np.append(np.any(np.diff(self.x, axis=0) != 0, axis=1), False)
        still = np.convolve(~changes, np.ones(_STILL))[: len(changes)] == _STILL - 1  # but for the change after it
        last = changes & still  # a device may filter, too: its samples go on changing for a while
        rests = (self.newest >= 0) & last[self.newest] if len(last) else np.zeros(len(self.t), bool)
        self.t, self.y, self.newest = self.t[rests], self.y[rests], self.newest[rests]
        if len(self.t) < LEAST_ROWS:
            raise UnlearnableError(f"{len(self.t)} rows at the end of a sample that was held: {LEAST_ROWS} are needed")

    def columns(self) -> Columns:
        """What was learned."""
        if self.open and len(self.live):
            index = self._aligned()
            for least in (_FEW, _SOME):  # once more with the rows where they belong
                for k in self.open:
                    self.columns_[k] = self._fit(k, index, least)
                found = Columns(self.columns_, list(self.channels))
                if not found.values or self.steps:
                    break
                index = self._matched(found, index)
            self._mixes(index)
        return Columns(self.columns_, list(self.channels), self.steps)

    # -- when ----------------------------------------------------------------------------------------------------------

    def _aligned(self) -> np.ndarray:
        """Of each row the number of its sample, as far as the delay is always the same; -1: before the first."""
        ry = ranks(self.y[:, self.open[:16]])
        score, lag = self._lag(ry, self.ranked)
        if score < 0.5 * ry.shape[1]:
            if (wandering := self._by_sequence()) is not None:
                return wandering
            tried = [  # perhaps every column is read wrong
                self._lag(ry, ranks(_transformed(how, self.x[:, channels])))
                for how in TRANSFORMS
                if how != "line" and len(channels := self._tried(how, self.x))
            ]
            score, lag = max([(score, lag), *((each, at) for each, at in tried if each > 0.5 * ry.shape[1])])
        return self.newest - lag

    def _lag(self, ry: np.ndarray, ranked: np.ndarray) -> tuple[float, int]:
        """Return how like the columns are to channels at the delay where they are most, and that delay."""
        scores = []
        for lag in range(min(_LAGS, max(1, len(self.x) - LEAST_ROWS))):
            index = self.newest - lag
            ok = index >= 0
            like = np.abs(ry[ok].T @ ranked[index[ok]]) / max(1, ok.sum()) if ok.sum() >= LEAST_ROWS else 0.0
            scores.append(float(np.sum(np.max(like, axis=1))) if np.ndim(like) else 0.0)
        return max(scores), int(np.argmax(scores))

    def _tried(self, how: str, x: np.ndarray) -> np.ndarray:
        """Return the channels that are tried after a mistake; only a sign is lost where counts are no whole numbers."""
        live = self.live[:8]
        whole = how == ABSOLUTE or np.array_equal(x[:, live], np.rint(x[:, live]))
        return self.live[:256] if whole else np.zeros(0, int)

    def _by_sequence(self, width: int = 9) -> np.ndarray | None:
        """Where the delay wanders: somewhere nine rows in a row are nine samples in a row; from there on by value."""
        for i in range(5, len(self.y) - width, max(1, len(self.y) // 16)):
            low, high = max(0, self.newest[i] - 600), min(self.newest[i] + 1, len(self.x) - width)
            if high - low < 2:
                continue
            for k in self.open[:4]:
                y = self.y[i : i + width, k] - self.y[i : i + width, k].mean()
                if not y.any():
                    continue
                for c in self.live[:64]:
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
        """Return the sample of each row by one column: of those that fit, the nearest to the one after the last."""
        index, last = np.full(len(self.y), -1), None
        for i, newest in enumerate(self.newest):
            low = max(0, newest - 2000)
            fits = low + np.flatnonzero(np.abs(gain * self.x[low : newest + 1, c] + offset - self.y[i, k]) <= tolerance)
            if len(fits):
                index[i] = fits[np.abs(fits - (newest if last is None else last + 1)).argmin()]
                last = index[i]
        return index

    def _matched(self, columns: Columns, index: np.ndarray) -> np.ndarray:
        """Return each row at the sample that most of its columns name, among the last of what had left by then."""
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

    # -- what ----------------------------------------------------------------------------------------------------------

    def _fit(self, k: int, index: np.ndarray, least: float) -> Column:
        ok = index >= 0
        x, y = self.x[index[ok]], self.y[ok, k]
        best = Column(self.names[k])
        own, rest = ranks(y[:, None])[:, 0], np.inf
        like = np.abs(own @ self.ranked[index[ok]]) / max(1, len(y))
        for how, transform in TRANSFORMS.items():
            if how == "line":
                first = np.argsort(-like.round(9), kind="stable")[:3]
                likely = self.live[first[like[first] > ALIKE * like[first[0]]]]
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
                closer = min(share, best.share) > self.sure and off < _CLOSER * rest
                if share > best.share + 0.02 or closer:
                    best, rest = found, off
                    same = [(int(k), fit) for k, fit in fits if min(share, fit[3]) > self.sure and k != best.channel]
                    best.also = [k for k, _ in same]
                    self._decide_by_name(best, same)
            if how == "line" and best.share > self.sure:
                break
        if best.share < self.sure:
            best = self._clipped(k, x, y, like) or best
        if best.share < self.sure:
            best = self._curve(k, x, y, int(self.live[np.argmax(like)])) or best
        if best.share < least:
            return Column(self.names[k])
        if best.also:  # two channels are the same: nobody can tell which it is
            best.also = [best.channel, *best.also]
        return best

    def _decide_by_name(self, best: Column, same: list[tuple[int, tuple[float, float, float, float]]]) -> None:
        """Give a column that could hold several channels the one that its name tells."""
        told = [
            k for k in (best.channel, *best.also) if k < len(self.channels) and is_named(best.name, self.channels[k])
        ]
        if not best.also or len(told) != 1:
            return
        best.also = []
        for k, (gain, offset, tolerance, share) in same:
            if k == told[0]:
                best.channel, best.gain, best.offset, best.tolerance, best.share = k, gain, offset, tolerance, share

    def _turned(self, how: str, x: np.ndarray, channels: np.ndarray) -> np.ndarray:
        """Return the ranks of the channels after a mistake; kept, since each column asks for the same."""
        key = (how, len(x), float(x.sum()))
        if key not in self._kept:
            self._kept[key] = ranks(_transformed(how, x[:, channels]))
        return self._kept[key]

    def _zero(self, x: np.ndarray, y: np.ndarray) -> float:
        """Return the count at which two lines of opposite gains meet; 0 where the rows are on no such lines."""
        gain, offset, tolerance, share = line(x, y, self.random, steps=self.steps)
        left = np.abs(gain * x + offset - y) > tolerance
        other, its_offset, _, its_share = line(x[left], y[left], self.random, steps=self.steps)
        if not other or not np.isclose(other, -gain, rtol=_OPPOSITE) or share + its_share * left.mean() < self.sure:
            return 0.0
        zero = (its_offset - offset) / (gain - other)
        whole = np.array_equal(x, np.rint(x)) and abs(zero - round(zero)) < _WHOLE
        return float(round(zero)) if whole else float(zero)

    def _clipped(self, k: int, x: np.ndarray, y: np.ndarray, like: np.ndarray) -> Column | None:
        """Return a line of a channel between limits beyond which the column stays where it is."""
        low, high = float(y.min()), float(y.max())
        ends = [end for end in (low, high) if (y == end).sum() >= max(5, _CLIPPED * len(y))]
        inner = ~np.isin(y, ends)
        if not ends or inner.sum() < _INNER:
            return None
        first = np.argsort(-like)[:3]
        for c in self.live[first[like[first] > ALIKE * like[first[0]]]]:
            counts = x[:, c]
            gain, offset, tolerance, share = line(counts[inner], y[inner], self.random, steps=self.steps)
            if share < self.sure:
                continue
            whole = gain * counts + offset
            limits = (low if low in ends else -np.inf, high if high in ends else np.inf)
            beyond = np.abs(np.clip(whole, *limits) - whole) > 3 * tolerance + 2 * abs(gain)
            share = float((np.abs(np.clip(whole, *limits) - y) <= tolerance).mean())
            if share < self.sure or beyond.mean() < _CLIPPED:
                continue
            at = sorted({float(counts.min()), float(counts.max()), *((end - offset) / gain for end in ends)})
            table = [[float(a), float(np.clip(gain * a + offset, *limits))] for a in at]
            return Column(self.names[k], "value", int(c), "clipped", gain, offset, tolerance, table=table, share=share)
        return None

    def _curve(self, k: int, x: np.ndarray, y: np.ndarray, c: int) -> Column | None:
        """Return a table of the channel, if the column rises or falls with it."""
        counts, values = x[:, c], y
        order = np.argsort(counts, kind="stable")
        steps = np.diff(values[order])
        rising = (steps >= 0).mean()
        if max(rising, (steps <= 0).mean()) < self.sure or np.ptp(counts) == 0:
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
        """Columns of which nothing else is known may be sums: by least squares, over few channels only."""
        ok = index >= 0
        if len(self.live) * 2 + LEAST_ROWS > ok.sum():
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
            if tolerance > 0.02 * spread or not 0 < len(heavy) <= _MIX:
                continue
            self.columns_[k] = Column(
                self.names[k], "value", int(self.live[heavy[np.argmax(np.abs(weights[heavy]))]]), "mix",
                offset=float(weights[-1]), tolerance=tolerance, share=1.0,
                weights={str(int(self.live[c])): float(weights[c]) for c in heavy},
            )  # fmt: skip


def _transformed(how: str, x: np.ndarray) -> np.ndarray:
    """Return counts after a mistake; an absolute value is taken about the middle, until its zero is known."""
    return TRANSFORMS[how](x - (np.median(x, axis=0) if how == ABSOLUTE else 0.0))


def _role(name: str, y: np.ndarray) -> Column:
    """What a column is by itself: a flag never moves, a counter and a clock rise."""
    if not np.isfinite(y).all():
        return Column(name, "other")
    if np.ptp(y) == 0:
        return Column(name, "flag", constant=float(y[0]))
    steps = np.diff(y)
    rising, climbs = (steps >= 0).mean() > 0.97, (steps > 0).mean() > 0.3
    if rising and climbs:
        whole = bool(np.array_equal(y, np.rint(y))) and float(np.median(steps[steps > 0])) < 1000
        return Column(name, "counter" if whole else "time")
    return Column(name, "other")
