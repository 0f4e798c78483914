"""A recording of a real sensor as columns: from CSV, NPZ, Parquet, or a truth log.

You give columns their roles: ``t=t_sensor_s,z=z_mm,field=b0x:b4z``. A role is ``t``, ``z`` (position of a probe along
the push), ``depth``, ``force`` (that presses), ``mass`` (that presses), ``temperature``, ``untouched`` (not 0: nothing
touches the sensor), or the sensor's reading: ``field``, ``counts``, ``pressure``, ``resistance``, ``capacitance`` or
``reading``. ``a:b`` means all columns from a to b; ``+`` joins several. An array of an NPZ file with several columns is
one range, named like the array.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from tactemu.base.errors import TactemuError, nearest, no_such, reason_of

READINGS = ("field", "counts", "pressure", "resistance", "capacitance", "reading")
TRUTHS = ("t", "x", "y", "z", "depth", "force", "mass", "temperature", "untouched")
UNITS = {
    "s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "m": 1.0, "mm": 1e-3, "um": 1e-6, "N": 1.0, "mN": 1e-3, "kg": 1.0,
    "g": 1e-3, "degC": 1.0, "T": 1.0, "mT": 1e-3, "uT": 1e-6, "G": 1e-4, "mG": 1e-7, "Pa": 1.0, "kPa": 1e3, "F": 1.0,
    "pF": 1e-12, "fF": 1e-15, "Ohm": 1.0, "kOhm": 1e3, "counts": 1.0, "1": 1.0,
}  # fmt: skip
"""The value of each unit in SI."""
KIND_OF = {
    "t": ("s", "ms", "us", "ns"), **dict.fromkeys(("x", "y", "z", "depth"), ("m", "mm", "um")), "force": ("N", "mN"),
    "mass": ("kg", "g"), "temperature": ("degC",), "untouched": ("1",), "field": ("T", "mT", "uT", "G", "mG"),
    "pressure": ("Pa", "kPa"), "capacitance": ("F", "pF", "fF"), "resistance": ("Ohm", "kOhm"),
    "counts": ("counts", "1"),
    "reading": tuple(UNITS),
}  # fmt: skip
MAX_FILE_BYTES = 1 << 31
"""Maximum size of a recording, which is read into memory completely."""
G = 9.80665
"""Standard gravity [m/s²]."""


@dataclass(frozen=True)
class Recorded:
    """One recording, in SI."""

    path: Path
    sha256: str
    t: np.ndarray | None
    """The times of the rows [s], rising; None without a clock and a rate."""
    readings: np.ndarray
    """The readings ``(n, m)`` in T, Pa, F, Ohm or counts."""
    names: tuple[str, ...]
    """The names of the channels."""
    kind: str
    """The quantity of the readings, one of :data:`READINGS`."""
    unit: str
    """The unit of the readings in the file."""
    truth: Mapping[str, np.ndarray] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    """Irregularities of the recording, and what was done about them."""

    @property
    def load(self) -> np.ndarray | None:
        """The force that presses [N], or None if unknown."""
        if "force" in self.truth:
            return np.abs(self.truth["force"])
        return self.truth["mass"] * G if "mass" in self.truth else None


def read(
    path: Path,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    rate_hz: float | None = None,
) -> Recorded:
    """Return a recording with its columns in their roles.

    Raises:
        TactemuError: the file cannot be read, or a role, column or unit does not exist; the message lists the others.
    """
    try:
        size = path.stat().st_size
        digest = hashlib.sha256(path.read_bytes()).hexdigest() if size <= MAX_FILE_BYTES else ""
    except OSError as error:
        raise TactemuError(f"{path}: cannot read the recording: {reason_of(error)}") from None
    if not digest:
        raise TactemuError(
            f"{path}: {size / 1e9:.1f} GB; a recording may have {MAX_FILE_BYTES / 1e9:.1f} GB: cut it into parts"
        )
    table = _columns_of(path)
    roles = {role: _chosen(table, words, role, path) for role, words in (columns or _guessed(table, path)).items()}
    return _made(path, digest, table, roles, units or {}, rate_hz)


def _made(
    path: Path, digest: str, table: dict[str, np.ndarray], roles: dict[str, list[str]], units: Mapping[str, str],
    rate_hz: float | None,
) -> Recorded:  # fmt: skip
    for role in (*roles, *units):
        if role not in (*READINGS, *TRUTHS):
            raise TactemuError(f"{path}: no role {role!r}{nearest(role, (*READINGS, *TRUTHS)) or ''}")
    kinds = [role for role in roles if role in READINGS]
    if len(kinds) != 1:
        raise TactemuError(f"{path}: name what the sensor reads as one of {', '.join(READINGS)}, got {kinds or 'none'}")
    kind = kinds[0]
    factors = {role: _factor(role, units.get(role, KIND_OF[role][0]), path) for role in roles}
    names = roles[kind]
    readings = np.column_stack([table[name] for name in names]).astype(float) * factors[kind]
    truth = {role: table[roles[role][0]].astype(float) * factors[role] for role in roles if role in TRUTHS}
    if "mass" in truth:
        truth["mass"] = _held(np.where(truth["mass"] < 0, np.nan, truth["mass"]))
    t = truth.pop("t", None)
    if t is None and rate_hz is not None:
        t = np.arange(len(readings)) / rate_hz
    unit = units.get(kind, KIND_OF[kind][0])
    made = Recorded(path, digest, t, readings, tuple(names), kind, unit, truth)
    return _cleaned(made)


def _cleaned(made: Recorded) -> Recorded:
    """Return a recording without rows that are not finite or go back in time, with notes of them."""
    notes: list[str] = []
    keep = np.isfinite(made.readings).all(axis=1)
    for values in made.truth.values():
        keep &= np.isfinite(values)
    if made.t is not None:
        keep &= np.isfinite(made.t)
        back = np.concatenate([[False], made.t[1:] <= np.maximum.accumulate(made.t)[:-1]])
        if back.any():
            notes.append(f"{int(back.sum())} rows go back in time or repeat one: left out")
        keep &= ~back
    if (lost := int((~keep).sum())) and not notes:
        notes.append(f"{lost} rows have a value that is not a finite number: left out")
    if keep.sum() < 20:
        raise TactemuError(f"{made.path}: {int(keep.sum())} rows with numbers in all columns; a fit needs at least 20")
    t = None if made.t is None else made.t[keep] - made.t[keep][0]
    if t is not None:
        step = float(np.median(np.diff(t)))
        if not 1e-5 <= step <= 100:
            raise TactemuError(
                f"{made.path}: rows are {step:g} s apart, which no sensor does: is the unit of t right? (--unit t=ms)"
            )
        gaps = int((np.diff(t) > 5 * step).sum())
        if gaps:
            notes.append(f"{gaps} gaps longer than five periods")
    return replace(
        made, t=t, readings=made.readings[keep], truth={k: v[keep] for k, v in made.truth.items()}, notes=tuple(notes)
    )


def _held(values: np.ndarray) -> np.ndarray:
    """Return values with each NaN replaced by the last value before it, as a slower instrument holds its reading."""
    known = np.flatnonzero(np.isfinite(values))
    if not len(known):
        return values
    at = known[np.maximum(np.searchsorted(known, np.arange(len(values)), "right") - 1, 0)]
    return values[at]


def _factor(role: str, unit: str, path: Path) -> float:
    if unit not in KIND_OF[role]:
        hint = nearest(unit, KIND_OF[role]) or ""
        raise TactemuError(f"{path}: {role} cannot be in {unit!r}{hint} (units: {', '.join(KIND_OF[role])})")
    return UNITS[unit]


def _chosen(table: dict[str, np.ndarray], words: str, role: str, path: Path) -> list[str]:
    known, found = list(table), []
    for part in words.split("+"):
        first, mark, last = part.partition(":")
        ends = [first, last] if mark else [first]
        ranges = [[name for name in known if name.rpartition(".")[0] == end] or [end] for end in ends]
        for end in (ranges[0][0], ranges[-1][-1]):
            if end not in table:
                raise TactemuError(f"{path}: {role}: {no_such('column', end, known[:40])}")
        a, b = known.index(ranges[0][0]), known.index(ranges[-1][-1])
        if b < a:
            raise TactemuError(f"{path}: {role}={part}: the column {last!r} is before {first!r}; swap them")
        found += known[a : b + 1]
    if role in TRUTHS and len(found) != 1:
        raise TactemuError(f"{path}: {role} must be one column, got {len(found)}")
    return found


def _guessed(table: dict[str, np.ndarray], path: Path) -> dict[str, str]:
    """Return the roles of a table whose columns have the roles' names."""
    named = {role: role for role in (*READINGS, *TRUTHS) if any(name.split(".")[0] == role for name in table)}
    if not any(role in READINGS for role in named):
        raise TactemuError(
            f"{path}: name the columns that are the sensor's readings: --columns field=b0x:b4z "
            f"(columns: {', '.join(list(table)[:40])})"
        )
    return named


def _columns_of(path: Path) -> dict[str, np.ndarray]:
    suffixes = path.suffixes
    try:
        if path.suffix in (".mcap", ".jsonl"):
            return _of_log(path)
        if path.suffix == ".npz":
            return _of_arrays(path)
        if path.suffix in (".parquet", ".pq"):
            return _of_parquet(path)
        if ".csv" in suffixes or ".tsv" in suffixes or path.suffix == ".txt":
            return _of_csv(path)
    except (OSError, ValueError) as error:
        raise TactemuError(f"{path}: cannot be read as {path.suffix}: {error}") from None
    raise TactemuError(f"{path}: a recording is .csv, .csv.gz, .npz, .parquet, .mcap or .jsonl")


def _of_csv(path: Path) -> dict[str, np.ndarray]:
    import gzip

    opened: Any = gzip.open(path, "rt") if path.suffix == ".gz" else path.open(encoding="utf-8")
    with opened as file:
        head = file.readline().strip()
        mark = "\t" if "\t" in head else ";" if ";" in head else ","
        names = [name.strip().strip('"') for name in head.split(mark)]
        if all(_is_number(name) for name in names):
            raise TactemuError(f"{path}: the first line must name the columns, got {head[:60]!r}")
        rows = np.genfromtxt(file, delimiter=mark, ndmin=2, invalid_raise=False)
    if rows.shape[1] != len(names):
        raise TactemuError(f"{path}: {len(names)} names for {rows.shape[1]} columns")
    return dict(zip(names, rows.T))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _of_arrays(path: Path) -> dict[str, np.ndarray]:
    table: dict[str, np.ndarray] = {}
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files if archive[name].dtype.kind in "iufb"}
    longest = max((len(each) for each in arrays.values() if each.ndim), default=0)
    for name, values in arrays.items():
        if values.ndim and len(values) == longest:
            flat = values.reshape(longest, -1)
            table |= {name: flat[:, 0]} if flat.shape[1] == 1 else {f"{name}.{k}": c for k, c in enumerate(flat.T)}
    return table


def _of_parquet(path: Path) -> dict[str, np.ndarray]:
    try:
        from pyarrow import parquet
    except ImportError:
        raise TactemuError(f"{path}: Parquet needs pyarrow: pip install 'tactemu[convert]'") from None
    read_table = parquet.read_table(path)
    return {name: read_table[name].to_numpy() for name in read_table.column_names}


def _of_log(path: Path) -> dict[str, np.ndarray]:
    from tactemu.truth import read_log

    log = read_log(path)
    if len(log.skins) != 1:
        raise TactemuError(
            f"{path}: a log of {len(log.skins)} skins ({', '.join(log.skins)}); write one of them with "
            "`tactemu truth LOG --skin NAME --to one.mcap`, and fit that file"
        )
    skin = next(iter(log.skins.values()))
    flat = skin.counts.reshape(len(skin.t_ns), -1)
    ideal = np.asarray(skin.ideal, float)
    force = np.linalg.norm(ideal.sum(axis=1), axis=-1) if ideal.ndim == 3 else ideal.sum(axis=1)
    return {"t": skin.t_ns * 1e-9, "force": force} | {f"counts.{k}": each for k, each in enumerate(flat.T)}
