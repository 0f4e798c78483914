"""Columns of a driver's rows: each holds a channel of the device with a scale, a flag, a counter or a clock.

They are learned from a run without faults (:mod:`tactemu.judge.column_learning`), shown, and kept in a file that you
may edit.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from firmware_protocols import Device
from tactemu.base.errors import TactemuError, reason_of
from tactemu.base.toml_text import lines_of
from tactemu.judge.excitation import columns_of

ROLES = ("value", "flag", "counter", "time", "other")

Transform = Callable[[np.ndarray], np.ndarray]


def _as_integers(x: np.ndarray) -> np.ndarray:
    return np.rint(x).astype(np.int64)


def _swapped(kind: str, unit: str = "u1") -> Transform:
    """Return a transform that reverses the order of the units (bytes, or words) of integers of a NumPy type."""

    def swap(x: np.ndarray) -> np.ndarray:
        values = _as_integers(x).astype(kind)
        parts = np.ascontiguousarray(values).view(unit).reshape(*values.shape, -1)
        return np.ascontiguousarray(parts[..., ::-1]).view(kind)[..., 0].astype(float)

    return swap


def _unsigned(bits: int) -> Transform:
    return lambda x: (_as_integers(x) & (1 << bits) - 1).astype(float)


def _signed(bits: int) -> Transform:
    half = 1 << bits - 1
    return lambda x: (((_as_integers(x) + half) & (1 << bits) - 1) - half).astype(float)


ABSOLUTE = "absolute value"
TRANSFORMS: dict[str, Transform] = {
    "line": lambda x: x,
    **{f"{sign}int16 with its bytes swapped": _swapped(f"<{sign or 'i'}2") for sign in ("", "u")},
    **{f"int{bits} read as unsigned": _unsigned(bits) for bits in (16, 8, 24, 32)},
    **{f"uint{bits} read as signed": _signed(bits) for bits in (16, 8, 24, 32)},
    **{f"its lowest {bits} bits alone": _unsigned(bits) for bits in (15, 14, 13, 12, 11, 10, 9, 7)},
    **{f"{sign}int32 with its bytes swapped": _swapped(f"<{sign or 'i'}4") for sign in ("", "u")},
    "int32 with its words swapped": _swapped("<i4", "<u2"),
    ABSOLUTE: np.abs,
}  # fmt: skip
"""Transforms of counts, applied before the line of a column. All but the first are possible mistakes."""
TABLES = ("curve", "fold", "clipped")
"""Values of :attr:`Column.how` that are stored as a table of counts and values."""
MISTAKES = {name for name in TRANSFORMS if name != "line"} | {"fold"}
FLAT = 0.2
"""Share of a channel's counts over which a correct column may read one value, as a coarse scale does."""


@dataclass(frozen=True)
class Channel:
    """One number of a sample, as a perfect driver decodes it."""

    name: str
    """The name ``skin.taxel.column``, without the parts of which there is only one."""
    axis: str = ""
    unit: str = ""
    counts_per_unit: float | None = None
    skin: str = ""
    """The name of the skin; "" if there is only one."""


@dataclass
class Column:
    """One number of the driver's rows."""

    name: str
    role: str = "other"
    channel: int = -1
    """The index in :attr:`Columns.channels`; of a mix, the channel with the largest weight."""
    how: str = "line"
    """A key of :data:`TRANSFORMS`, an entry of :data:`TABLES`, ``mix`` or ``filter``."""
    gain: float = 1.0
    offset: float = 0.0
    tolerance: float = 0.0
    """The largest deviation of a right value, in units of the column."""
    constant: float = 0.0
    """The value of a flag."""
    zero: float = 0.0
    """The count at which an absolute value is 0."""
    weights: dict[str, float] = field(default_factory=dict)
    """The weights of a mix, by channel number."""
    table: list[list[float]] = field(default_factory=list)
    """Counts and values of a column whose :attr:`how` is in :data:`TABLES`."""
    share: float = 0.0
    """The share of the clean rows that the column's rule explains."""
    also: list[int] = field(default_factory=list)
    """Channels that the column could hold just as well."""

    def of(self, counts: np.ndarray) -> np.ndarray:
        """Return the values that the column should read for counts of shape ``(n_samples, n_channels)``."""
        if self.how == "mix":
            at = np.array([int(k) for k in self.weights])
            return counts[:, at] @ np.array(list(self.weights.values())) + self.offset
        x = counts[:, self.channel]
        if self.how in TABLES:
            known, values = np.array(self.table).T
            return np.interp(x, known, values)
        transform = TRANSFORMS.get(self.how, TRANSFORMS["line"])
        return self.gain * transform(x - self.zero) + self.offset

    def slack(self, counts: np.ndarray) -> np.ndarray:
        """Return the largest deviation of a right value from :meth:`of`, shape ``(n_samples,)``.

        On a curve it is the distance to the neighbours in the table; beyond the table's ends it grows with three times
        the last slope.
        """
        if self.how not in ("curve", "fold") or len(self.table) < 2:
            return np.full(len(counts), self.tolerance)
        x = counts[:, self.channel]
        known, values = np.array(self.table).T
        high = np.clip(np.searchsorted(known, x), 1, len(known) - 1)
        step = np.abs(values[high] - values[high - 1])
        if self.how == "fold":  # the value falls back somewhere between two entries
            step = np.maximum(step, self.tolerance)
        beyond = np.maximum(0.0, np.maximum(known[0] - x, x - known[-1])) / (known[high] - known[high - 1])
        between = np.where(np.isin(x, known), 0.0, step)
        return self.tolerance + between + 3 * step * beyond


@dataclass
class Columns:
    """All columns of a driver's rows."""

    columns: list[Column] = field(default_factory=list)
    channels: list[Channel] = field(default_factory=list)
    steps: bool = False
    """True for a driver that filters: samples are held, and rows may lie on the way from one to the next."""

    def __post_init__(self):
        self.values = [column for column in self.columns if column.role == "value"]
        self.flags = [column for column in self.columns if column.role == "flag"]
        self.names = [column.name for column in self.values]

    def by_skin(self) -> list[np.ndarray]:
        """Return the indices of the value columns of each skin."""
        skins = [self.channels[c.channel].skin if c.channel < len(self.channels) else "" for c in self.values]
        return [np.array([k for k, skin in enumerate(skins) if skin == each]) for each in dict.fromkeys(skins)]

    def expected(self, counts: np.ndarray) -> np.ndarray:
        """Return the values that the value columns should read, shape ``(n_samples, n_values)``."""
        if not len(counts) or not self.values:
            return np.zeros((len(counts), len(self.values)))
        if any(column.channel >= counts.shape[1] for column in self.values):
            raise TactemuError(
                "the columns were learned from another device: a channel is missing; delete the file of --columns"
            )
        return np.stack([column.of(counts) for column in self.values], axis=1)

    def slack(self, counts: np.ndarray) -> np.ndarray:
        """Return the largest deviations of right values from :meth:`expected`, shape ``(n_samples, n_values)``."""
        if not len(counts) or not self.values:
            return np.zeros((len(counts), len(self.values)))
        return np.stack([column.slack(counts) for column in self.values], axis=1)

    def row(self, row: Mapping[str, float]) -> np.ndarray | None:
        """Return the values of a row, or None if it lacks some."""
        try:
            return np.array([row[name] for name in self.names])
        except KeyError:
            return None

    def marked(self, row: Mapping[str, float]) -> bool:
        """Return True if the driver marks the row as bad: a flag has changed that was constant in the clean run."""
        return any(row.get(flag.name, flag.constant) != flag.constant for flag in self.flags)

    # -- for people ----------------------------------------------------------------------------------------------------

    def describe(self) -> list[tuple[str, str]]:
        """Return name and content of each column as text; consecutive columns of consecutive channels are one entry."""
        lines: list[tuple[str, str]] = []
        for run in _runs(self.values):
            first, last = run[0], run[-1]
            if first.also and len(run) > 1:
                lines.append((_listed(column.name for column in run), self._equal(run)))
                continue
            name = first.name if len(run) == 1 else f"{first.name} … {last.name}"
            channels = self._name(first) if len(run) == 1 else f"{self._name(first)} … {self._name(last)}"
            others = [self.channels[k].name for k in first.also if k != first.channel and k < len(self.channels)]
            either = f", or {', '.join(others[:6])}, which are the same" if others else ""
            lines.append((name, f"{channels}{either}, {self._how(first)}"))
        for column in self.columns:
            if column.role == "flag":
                lines.append((column.name, f"a flag: always {column.constant:g}"))
            elif column.role != "value":
                about = {"counter": "a counter", "time": "a clock"}.get(column.role, "cannot be told")
                if column.also:
                    about = "could be any of " + ", ".join(self.channels[k].name for k in column.also[:6])
                lines.append((column.name, about))
        if left := [channel.name for channel in self.unread()]:
            more = f" and {len(left) - 6} more" if len(left) > 6 else ""
            lines.append(("-", f"in no column: {', '.join(left[:6])}{more}"))
        return lines

    def unread(self) -> list[Channel]:
        """Return the channels that no column holds, or could hold."""
        held = {k for column in self.columns for k in column.also} | {column.channel for column in self.values}
        held |= {int(k) for column in self.values for k in column.weights}
        return [channel for k, channel in enumerate(self.channels) if k not in held]

    def _name(self, column: Column) -> str:
        return (
            self.channels[column.channel].name if column.channel < len(self.channels) else f"channel {column.channel}"
        )

    def _equal(self, run: Sequence[Column]) -> str:
        """Return the content of columns that hold the same channels in an order that cannot be told."""
        names = _listed(self.channels[k].name for k in run[0].also if k < len(self.channels))
        return f"one each of {names}, which are the same, {self._how(run[0])}"

    def _how(self, column: Column) -> str:
        if column.how == "mix":
            return f"a sum of {len(column.weights)} channels"
        if column.how in TABLES:
            words = {"fold": "by a curve that rises and falls", "clipped": "clipped"}
            flat = flat_part(column)
            part = f", the same value over {flat:.0%} of the counts" if flat > FLAT or column.how == "clipped" else ""
            return words.get(column.how, "by a curve that rises or falls") + part
        words = column.how + ", " if column.how in MISTAKES else ""
        return f"{words}{self._scale(column)}{', filtered' if self.steps else ''}"

    def _scale(self, column: Column) -> str:
        channel = self.channels[column.channel] if column.channel < len(self.channels) else Channel("")
        plus = f" {column.offset:+.6g}" if abs(column.offset) > column.tolerance else ""
        if channel.unit and channel.counts_per_unit and abs(column.gain * channel.counts_per_unit - 1) < 1e-3:
            return f"in {channel.unit}{plus}"
        if abs(column.gain - 1) < 1e-6:
            return f"in counts{plus}"
        return f"{column.gain:.6g} per count{plus}"

    # -- as data -------------------------------------------------------------------------------------------------------

    def as_dict(self) -> dict[str, Any]:
        """Return the columns as JSON data."""
        columns = [{k: v for k, v in asdict(c).items() if v != _DEFAULTS[k]} for c in self.columns]
        return {"steps": self.steps, "columns": columns, "channels": [asdict(channel) for channel in self.channels]}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Columns:
        """Return the columns from the data of :meth:`as_dict`.

        Raises:
            TypeError, KeyError: the data has another form.
        """
        columns = [Column(**each) for each in data["columns"]]
        return cls(columns, [Channel(**each) for each in data.get("channels", ())], bool(data.get("steps")))

    def save(self, path: Path) -> None:
        """Write the columns as TOML, one table for each.

        Raises:
            TactemuError: the file cannot be written.
        """
        lines = [
            "# The columns of the driver's rows. `role` is value, flag, counter, time or other;",
            "# a value is  gain * counts of the channel + offset  within the tolerance.",
            *lines_of({"steps": self.steps}),
        ]
        for each in self.as_dict()["columns"]:
            lines += ["", "[[columns]]"]
            if each.get("role") == "value":
                lines.append(f"# {self.channels[each['channel']].name}")
            lines += lines_of(each)
        try:
            path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        except OSError as error:
            raise TactemuError(f"{path}: cannot write the columns: {reason_of(error, path)}") from None

    @classmethod
    def load(cls, path: Path, channels: Sequence[Channel]) -> Columns:
        """Return the columns in a file.

        Raises:
            TactemuError: the file cannot be read or is no file of columns, or a role or channel does not exist.
        """
        try:
            found = cls.from_dict({**tomllib.loads(path.read_text(encoding="utf-8")), "channels": ()})
        except OSError as error:
            raise TactemuError(f"{path}: cannot read the columns: {reason_of(error)}") from None
        except (ValueError, TypeError, KeyError) as error:
            raise TactemuError(f"{path}: not a file of columns: {error}") from None
        found.channels = list(channels)
        for column in found.columns:
            if column.role not in ROLES:
                raise TactemuError(f"{path}: column {column.name!r}: role: expected {', '.join(ROLES)}")
            if column.role == "value" and not 0 <= column.channel < len(channels):
                raise TactemuError(f"{path}: column {column.name!r}: channel: expected 0 to {len(channels) - 1}")
        return found


_DEFAULTS = {**asdict(Column("")), "name": None}


def _listed(names: Iterable[str]) -> str:
    """Return names as a list, with an ellipsis for those after the sixth."""
    first = list(names)
    return ", ".join(first[:6] + ["…"] * (len(first) > 6))


def _runs(values: Sequence[Column]) -> list[list[Column]]:
    """Return the columns in runs: consecutive columns of consecutive channels with the same scale."""
    runs: list[list[Column]] = []
    for column in values:
        if column.also and (alike := [run for run in runs if _are_alike(run[0], column)]):
            alike[0].append(column)
            continue
        last = runs[-1][-1] if runs else None
        alone = last is None or column.also or last.also or len(values) <= 12
        follows = last is not None and column.how == last.how != "mix" and column.channel == last.channel + 1
        if last is not None and not alone and follows and np.isclose(column.gain, last.gain, rtol=1e-3):
            runs[-1].append(column)
        else:
            runs.append([column])
    return runs


def _are_alike(one: Column, other: Column) -> bool:
    """Return True if two columns could hold the same channels, with the same scale."""
    return (
        {*one.also} == {*other.also}
        and one.how == other.how
        and bool(np.isclose([one.gain, one.offset], [other.gain, other.offset], rtol=1e-3, atol=1e-6).all())
    )


def channels_of(devices: Mapping[str, Device], shapes: Sequence[tuple[str, str, tuple[int, ...]]]) -> list[Channel]:
    """Return the channels of a sample.

    Args:
        devices: by skin.
        shapes: skin, sense and shape of the counts, in the order of the sample.
    """
    found = []
    several = len({skin for skin, _, _ in shapes}) > 1
    for skin, sense, shape in shapes:
        device = devices[skin]
        columns = columns_of(device, sense, shape) if shape else [None]
        points = int(np.prod(shape)) // max(1, len(columns))
        for k in range(points):
            place = _taxel(device, k) if points > 1 and points == len(device.layout) else f"{k}" if points > 1 else ""
            for j, column in enumerate(columns):
                own = column.name if column else f"{j}" if len(columns) > 1 else ""
                if column is None and sense:
                    own = f"{sense}.{own}".rstrip(".")
                name = ".".join(part for part in (skin if several else "", place, own) if part)
                axis, unit = (column.axis, column.unit) if column else ("", "")
                per_unit = column.counts_per_unit if column else None
                found.append(Channel(name or "value", axis, unit, per_unit, skin if several else ""))
    return found


def _taxel(device: Device, k: int) -> str:
    for patch in device.layout.patches:
        if patch.start <= k < patch.start + len(patch):
            at = k - patch.start
            if patch.rows:
                return f"{patch.name}[{at // patch.cols},{at % patch.cols}]"
            return f"{patch.name}[{at}]" if len(patch) > 1 else patch.name
    return f"taxel {k}"


def flat_part(column: Column) -> float:
    """Return the largest share of a channel's counts over which a column with a table reads one value."""
    if column.how not in TABLES or len(column.table) < 2:
        return 0.0
    known, values = np.array(column.table).T
    same = np.abs(np.diff(values)) <= 1e-6 * np.ptp(values)
    longest, length = 0.0, 0.0
    for is_same, step in zip(same, np.diff(known)):
        length = length + float(step) if is_same else 0.0
        longest = max(longest, length)
    return longest / float(np.ptp(known))
