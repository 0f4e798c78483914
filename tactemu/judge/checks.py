"""Checks of learned columns against their names and the device's declarations; each returns sentences.

A name may state an axis (``fx``, ``force.y``, ``Bz3``), force or torque (``tz``), and a unit (``fx_mN``, ``p [kPa]``).
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from tactemu.judge.columns import ABSOLUTE, FLAT, MISTAKES, Channel, Column, Columns, flat_part

GRAVITY = 9.80665
"""Standard gravity [m/s²]."""
POUND = 4.4482216152605
"""Pound-force [N]."""
UNITS: dict[str, dict[str, float]] = {
    "N": {"N": 1.0, "mN": 1e3, "uN": 1e6, "kN": 1e-3, "cN": 1e2, "gf": 1e3 / GRAVITY, "g": 1e3 / GRAVITY,
          "kgf": 1 / GRAVITY, "kg": 1 / GRAVITY, "lbf": 1 / POUND, "lb": 1 / POUND, "ozf": 16 / POUND},
    "Nm": {"Nm": 1.0, "mNm": 1e3, "Nmm": 1e3, "Ncm": 1e2, "cNm": 1e2, "kgfcm": 1e2 / GRAVITY},
    "Pa": {"Pa": 1.0, "hPa": 1e-2, "kPa": 1e-3, "MPa": 1e-6, "mbar": 1e-2, "bar": 1e-5, "psi": 1 / 6894.757},
    "uT": {"uT": 1.0, "nT": 1e3, "mT": 1e-3, "T": 1e-6, "G": 1e-2, "mG": 10.0},
    "m": {"m": 1.0, "cm": 1e2, "mm": 1e3, "um": 1e6},
    "m/s²": {"ms2": 1.0, "g": 1 / GRAVITY, "mg": 1e3 / GRAVITY},
    "rad/s": {"rads": 1.0, "dps": 180 / np.pi, "mdps": 180e3 / np.pi},
    "degC": {"C": 1.0, "degC": 1.0, "K": 1.0, "F": 1.8, "mC": 1e3},
}  # fmt: skip
"""Conversion factors by the unit that a device declares: how many of each other unit equal one of it."""
_FACTORS = {"9.80665": GRAVITY, "4.44822": POUND, "2.20462": GRAVITY / POUND}
"""Factors that drivers forget or apply twice, with any power of ten."""
_SCALE_TOLERANCE = 0.005
"""Relative tolerance of a correct scale."""
_MISTAKE_TOLERANCE = 0.002
"""Relative tolerance of a scale that a known mistake produces."""
_HALF = 0.5
"""A driver that reads at least this share of like channels should read all of them."""
_NEARLY_ALL = 0.75
"""A driver of which at least this share of an array's columns hold channels should fill all of them."""
_AXIS = re.compile(r"(?:^|[^a-z])([abdfghmpt]|force|torque|moment|field|mag)?[_.]?([xyz])(?=[_\d.\]]*$)")
_SIDES = {"f": "N", "force": "N", "t": "Nm", "m": "Nm", "torque": "Nm", "moment": "Nm"}
_ABSOLUTE = {"abs", "absolute", "magnitude"}
"""Words in the name of a column that holds an absolute value."""
_TOTAL = re.compile(r"(?:^|[^a-z])(?:(?:f|force|forces|ft|wrench)\.\d|(?:resultant|net_force)(?:\.\d)?)$")


def axis_in(name: str) -> str:
    """Return the axis that a column's name states; "" for none."""
    match = _AXIS.search(_stem(name).lower())
    return match[2] if match else ""


def side_in(name: str) -> str:
    """Return N if a column's name states a force, Nm if it states a torque; "" for neither."""
    match = _AXIS.search(_stem(name).lower())
    return _SIDES.get(match[1] or "", "") if match else ""


def unit_in(name: str, unit: str) -> str:
    """Return the unit that a column's name states, of those that a channel of ``unit`` may be given in; "" for none."""
    words = [word for word in re.split(r"[^A-Za-z]+", name.replace("µ", "u").replace("m/s", "ms")) if word]
    for word in words[1:]:
        for known in UNITS.get(_declared(unit), ()):
            if word == known or (len(known) > 1 and word.lower() == known.lower()):
                return known
    return ""


def _declared(unit: str) -> str:
    return {"m/s^2": "m/s²", "T": "uT"}.get(unit, unit)


def _stem(name: str) -> str:
    """Return a column's name without the unit at its end."""
    found = re.fullmatch(r"(.*[^A-Za-z])([A-Za-zµ]+)([^A-Za-z]*)", name)
    if found and any(unit_in(name, unit).lower() == found[2].replace("µ", "u").lower() for unit in UNITS):
        return found[1].rstrip(" _.[(") + found[3].lstrip(" _])")
    return name


def words_in(name: str) -> set[str]:
    """Return the words of three letters and more in a name, such as ``normal``."""
    return set(re.findall(r"[a-z]{3,}", name.lower()))


def is_named(name: str, channel: Channel) -> bool:
    """Return True if a column's name states the channel's axis, and does not contradict it on force or torque."""
    axis, side = axis_in(name), side_in(name)
    return bool(axis) and axis == channel.axis and (not side or channel.unit not in ("N", "Nm") or side == channel.unit)


def misread(columns: Columns) -> list[str]:
    """Return a sentence for each column that decodes its channel by a known mistake.

    An absolute value is no mistake if the column's name states it.
    """
    return [
        f"column {column.name!r} holds {_channel(columns, column).name} as {column.how}"
        for column in columns.values
        if column.how in MISTAKES and not (column.how == ABSOLUTE and words_in(column.name) & _ABSOLUTE)
    ]


def misnamed(columns: Columns) -> list[str]:
    """Return a sentence for each column that is named after one channel or axis and holds another."""
    sentences = []
    wrench = {channel.unit for channel in columns.channels} >= {"N", "Nm"}
    words = {word for channel in columns.channels for word in words_in(channel.name.rpartition(".")[2])}
    for column in columns.values:
        channel = _channel(columns, column)
        named, side = axis_in(column.name), side_in(column.name)
        stated = words_in(column.name) & words
        if column.how != "mix" and stated and not stated & words_in(channel.name):
            sentences.append(f"column {column.name!r} holds {channel.name}")
        if column.how == "mix" or not channel.axis or not named:
            continue
        if wrench and side and channel.unit in ("N", "Nm") and side != channel.unit:
            sentences.append(f"column {column.name!r} holds {channel.name}")
        elif channel.axis != named:
            sentences.append(f"column {column.name!r} holds the {channel.axis} axis")
    return sentences


def mirrored(columns: Columns) -> list[str]:
    """Return a sentence for each wrench with a component whose sign contradicts the other five.

    Turned axes and reactions change forces and torques alike: the products of their three signs stay equal.
    """
    sentences = []
    for skin in dict.fromkeys(channel.skin for channel in columns.channels):
        halves: dict[str, list[Column]] = {"N": [], "Nm": []}
        for column in columns.values:
            channel = _channel(columns, column)
            if channel.skin == skin and channel.unit in halves and is_named(column.name, channel):
                halves[channel.unit].append(column)
        if [len({column.channel for column in half}) for half in halves.values()] != [3, 3]:
            continue
        if len(halves["N"]) + len(halves["Nm"]) == 6 and all(
            _product(halves["N"], sign) != _product(halves["Nm"], sign) for sign in _signs(columns)
        ):
            sentences.append(f"the sign of {_odd(halves)} goes with no frame of the other columns")
    return sentences


def _signs(columns: Columns) -> Iterable[Callable[[Column], float]]:
    """Return two measures of a column's sign: against the counts, and against the unit that the device declares."""
    return (
        lambda column: np.sign(column.gain),
        lambda column: np.sign(column.gain * (_channel(columns, column).counts_per_unit or 1.0)),
    )


def _product(half: Sequence[Column], sign: Callable[[Column], float]) -> float:
    return float(np.prod([sign(column) for column in half]))


def _odd(halves: dict[str, list[Column]]) -> str:
    """Return the names of the columns with the rarer sign, such as the one that differs from the other five."""
    six = [column for half in halves.values() for column in half]
    fewer = min(([c for c in six if (c.gain < 0) == negative] for negative in (True, False)), key=len)
    return ", ".join(repr(column.name) for column in fewer)


def clipped(columns: Columns) -> list[str]:
    """Return a sentence for each column that reads one value over a large part of its channel's counts."""
    return [
        f"column {column.name!r} reads one value over {flat_part(column):.0%} of the counts that were sent"
        for column in columns.values
        if column.how == "clipped" or flat_part(column) > FLAT
    ]


def misscaled(columns: Columns) -> list[str]:
    """Return a sentence for each column in another unit than its name states or the device declares."""
    sentences = []
    for column in columns.values:
        channel = _channel(columns, column)
        if not channel.counts_per_unit or not channel.unit or column.how not in ("line", "clipped", *MISTAKES):
            continue
        ratio = abs(column.gain * channel.counts_per_unit)
        stated = unit_in(column.name, channel.unit)
        known = UNITS.get(_declared(channel.unit), {})
        right = known.get(stated, 1.0)
        off = ratio / right
        if abs(off - 1) <= _SCALE_TOLERANCE or (not stated and abs(abs(column.gain) - 1) < 1e-6):  # 1: counts
            continue
        unit, like = stated or channel.unit, _known_by(ratio, right, known, stated or channel.unit)
        if stated or like or 0.5 < off < 2:
            one = f"1 {channel.unit}" if right == 1.0 else f"{right:.4g} {unit}"
            sentences.append(f"column {column.name!r} reads {ratio:.4g} {unit} for {one}{like}")
    return sentences


def _known_by(ratio: float, right: float, known: dict[str, float], unit: str) -> str:
    """Return a description of the mistake that produces this scale; "" if none is known."""
    for name, per in known.items():
        if name != unit and abs(ratio / per - 1) < _MISTAKE_TOLERANCE:
            return f", looks like {name} read as {unit}"
    for name, per in known.items():
        if name != unit and abs(ratio * per / right - 1) < _MISTAKE_TOLERANCE:
            return f", looks like {unit} taken for {name}"
    if _is_power(ratio / right):
        return ", a power of ten off"
    for text, factor in _FACTORS.items():
        if _is_power(ratio / right / factor) or _is_power(ratio / right * factor):
            return f", off by {text} and a power of ten"
    return ""


def _is_power(ratio: float) -> bool:
    """Return True if a ratio is a power of ten."""
    power = float(np.log10(ratio))
    return abs(power - round(power)) < np.log10(1 + _MISTAKE_TOLERANCE) and abs(power) < 9.5


def unread_channels(columns: Columns) -> list[Channel]:
    """Return the channels that no column holds although half of the like channels are held.

    Like channels are those of one kind over the taxels of a patch, and those of one unit at a single point. A driver
    that reads less than half of a hand leaves parts out on purpose.
    """
    missing = columns.unread()
    arrays = {_pattern(column.name) for column in columns.values}
    unknown = sum(column.role == "other" and _pattern(column.name) in arrays for column in columns.columns)
    if len(missing) <= unknown:
        return []  # the columns of which nothing is known may hold them

    def is_half_read(alike: Callable[[Channel], Any]) -> Callable[[Channel], bool]:
        total, left = (Counter(map(alike, channels)) for channels in (columns.channels, missing))
        return lambda channel: left[alike(channel)] <= _HALF * total[alike(channel)]

    of_patch = is_half_read(_like)
    of_device = is_half_read(lambda channel: (_like(channel)[0].rpartition(".")[2], channel.skin))
    return [channel for channel in missing if of_patch(channel) and of_device(channel)]


def _like(channel: Channel) -> tuple[str, str]:
    """Return the key that a channel shares with the like channels: kind or unit, and skin."""
    kind = re.sub(r"\[[\d,]*\]|(?:^|(?<=\.))\d+(?=\.|$)", "", channel.name)
    return (kind, channel.skin) if kind != channel.name else (channel.unit, channel.skin)


def frozen(columns: Columns) -> list[str]:
    """Return a sentence for each column that never changed although the quantity it is named after did."""
    sentences = []
    alike, lists = (Counter(pattern(column.name) for column in columns.columns) for pattern in (_pattern, _list))
    holding = Counter(_pattern(column.name) for column in columns.values)
    lost = bool(unread_channels(columns))
    sides = {(channel.axis, channel.unit == "Nm") for channel in columns.channels if channel.axis}
    for column in columns.flags:
        pattern, side = _pattern(column.name), side_in(column.name)
        among = lost and holding[pattern] >= _NEARLY_ALL * alike[pattern]
        total = _TOTAL.search(column.name.lower()) and lists[_list(column.name)] in (1, 3, 6)
        if among or total or (side and (axis_in(column.name), side == "Nm") in sides):
            sentences.append(f"column {column.name!r} always reads {column.constant:g}")
    return sentences


def _pattern(name: str) -> str:
    """Return a name with its numbers replaced, which the columns of one array share."""
    return re.sub(r"\d+", "#", name)


def _list(name: str) -> str:
    """Return a name with its last number replaced, which the columns of one list share."""
    return re.sub(r"\d+(?=\D*$)", "#", name)


def _channel(columns: Columns, column: Column) -> Channel:
    return columns.channels[column.channel] if column.channel < len(columns.channels) else Channel("")
