"""The skill with which the laws of real sensors predict recordings that were not fitted: docs/realism.md.

    tactemu bench realism DATA --page docs/realism.md --parameters tactemu/fit/parameters.json
    tactemu bench realism --held OTHER

The first command judges each set's laws (:mod:`tactemu.fit.sets`) on recordings that are left out; the second judges
the parameters of the package on other recordings of the same sensors.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from tactemu.base.errors import TactemuError
from tactemu.base.files import check_writable
from tactemu.fit import sets
from tactemu.fit.sets.aims import Aim, Recordings, folds
from tactemu.fit.skill import Points, Skill, guesses, skill_of

PARAMETERS = Path(__file__).with_name("parameters.json")
"""The parameters of the package, fitted on all recordings."""


@dataclass(frozen=True)
class LawLine:
    """One line of the table of laws."""

    set: str
    aim: Aim
    skill: Skill


@dataclass(frozen=True)
class ConstantLine:
    """One line of the table of constants."""

    set: str
    name: str
    unit: str
    values: list[float]
    """The value of each recording."""


def left_out(name: str, recordings: Recordings) -> list[LawLine]:
    """Return the laws of a set with their skill on recordings that are left out: half of them, or each in turn."""
    module = sets.set_module(name)
    lines = []
    for aim in module.AIMS:
        points = _points(module, aim, recordings)
        judged: list[_Judged] = []
        for given, out in folds(list(points), _unit(module, aim), one_by_one=bool(aim.each)):
            parameters = module.fit({each: recordings[each] for each in given})
            judged += [
                _judge(module, aim, parameters, recordings, each, [points[one] for one in given]) for each in out
            ]
        lines += _line(name, module, aim, judged)
    return lines


def predicted(name: str, parameters: dict[str, Any], held: Recordings, given: Recordings) -> list[LawLine]:
    """Return the laws of a set with their skill on recordings of which nothing was fitted.

    The guesses know the given recordings; if there are none, the other ones that are held.
    """
    module = sets.set_module(name)
    lines = []
    for aim in module.AIMS:
        points, known = _points(module, aim, held), list(_points(module, aim, given).values())
        judged = []
        for each in points:
            seen = known or [one for other, one in points.items() if other != each]
            if seen:
                judged.append(_judge(module, aim, parameters, held, each, seen))
        lines += _line(name, module, aim, judged)
    return lines


_Judged = tuple[str, np.ndarray, dict[str, np.ndarray]]
"""The name of a recording, the errors of the law on it, and those of each guess."""


def _points(module: ModuleType, aim: Aim, recordings: Recordings) -> dict[str, Points]:
    found = {name: module.points(aim.key, each) for name, each in recordings.items()}
    return {name: each for name, each in found.items() if each is not None}


def _judge(
    module: ModuleType, aim: Aim, parameters: Any, recordings: Recordings, name: str, given: Sequence[Points]
) -> _Judged:
    own = module.points(aim.key, recordings[name])
    guessed = {guess: value - own.y for guess, value in guesses(given, own).items()}
    return name, module.predict(parameters, aim.key, recordings[name]) - own.y, guessed


def _unit(module: ModuleType, aim: Aim) -> Callable[[str], str]:
    """Return the function of a recording's name that gives what counts as one recording of an aim."""
    return partial(module.value_of, aim.each) if aim.each else getattr(module, "unit", str)


def _line(name: str, module: ModuleType, aim: Aim, judged: Sequence[_Judged]) -> list[LawLine]:
    """Return the line of a law, whose repeats of one condition count as one recording; none without predictions."""
    unit = _unit(module, aim)
    together: dict[str, list[_Judged]] = {}
    for each in judged:
        together.setdefault(unit(each[0]), []).append(each)
    if not together:
        return []
    errors = [np.concatenate([own for _, own, _ in group]) for group in together.values()]
    guessed = [
        {guess: np.concatenate([each[guess] for _, _, each in group]) for guess in group[0][2]}
        for group in together.values()
    ]
    return [LawLine(name, aim, skill_of(errors, guessed))]


def constants(name: str, recordings: Recordings) -> list[ConstantLine]:
    """Return the constants of a set with their values in each recording."""
    module = sets.set_module(name)
    found = module.constants(recordings) if module.CONSTANTS else {}
    return [
        ConstantLine(name, each.name, each.unit, found[each.key]) for each in module.CONSTANTS if found.get(each.key)
    ]


def run(
    report: Callable[[str], Any] = print,
    *,
    data: Path | None = None,
    held: Path | None = None,
    page: Path | None = None,
    parameters: Path | None = None,
) -> dict[str, Any]:
    """Judge the laws on recordings, and write the page and the parameters to the files given.

    Args:
        report: receives lines of text.
        data: a folder with a folder for each set: laws are fitted on a part of them and judged on the others.
        held: such a folder with other recordings, judged by the laws that are fitted on all of ``data``, else by
            :data:`PARAMETERS`.
        page: the Markdown file to write.
        parameters: the JSON file to write.

    Raises:
        TactemuError: neither folder is given, or a folder has no set, or no recordings of one.
    """
    if data is None and held is None:
        raise TactemuError("realism: name a folder of recordings, or give one with --held")
    check_writable(parameters, "the parameters", *(f'"{name}"' for name in sets.SETS))
    check_writable(page, "the page", _TITLE)
    laws: list[LawLine] = []
    fixed: list[ConstantLine] = []
    others: list[LawLine] = []
    given: dict[str, Recordings] = {name: _read(name, folder) for name, folder in _sets_in(data)}
    fitted = json.loads(PARAMETERS.read_text(encoding="utf-8")) if data is None else {}
    for name, recordings in given.items():
        fitted[name] = sets.set_module(name).fit(recordings)
        laws += (own := left_out(name, recordings))
        fixed += constants(name, recordings)
        _report_lines(report, own)
    if held is not None:
        report(f"predictions of {held}, of which nothing was fitted:")
    for name, folder in _sets_in(held):
        if name in fitted:
            others += (own := predicted(name, fitted[name], _read(name, folder), given.get(name, {})))
            _report_lines(report, own)
    if parameters is not None:
        text = json.dumps(_rounded(fitted), indent=1)
        rows = re.sub(r"\[[^\[\]]*\]", lambda found: json.dumps(json.loads(found[0])), text)  # a list on one line
        parameters.write_text(rows + "\n", encoding="utf-8")
    if page is not None:
        page.write_text(_page(laws, fixed, _rounded(fitted)), encoding="utf-8")
    return {
        "left out": [asdict(line) for line in laws],
        "held": [asdict(line) for line in others],
        "constants": [asdict(line) for line in fixed],
        "fitted": fitted,
    }


def _read(name: str, folder: Path) -> Recordings:
    recordings = sets.set_module(name).read(folder)
    if not recordings:
        raise TactemuError(
            f"{folder}: no recordings of this set; the docstring of {sets.SETS[name]} describes its files"
        )
    return recordings


def _sets_in(folder: Path | None) -> list[tuple[str, Path]]:
    """Return names and folders of the sets in a folder."""
    if folder is None:
        return []
    found = [(name, folder / name) for name in sets.SETS if (folder / name).is_dir()]
    if not found:
        raise TactemuError(f"{folder}: no folder of a set (sets: {', '.join(sets.SETS)})")
    return found


def _report_lines(report: Callable[[str], Any], lines: Sequence[LawLine]) -> None:
    for line in lines:
        own = line.skill
        report(
            f"{line.set:20} {line.aim.law}: error {own.error:.3g} {line.aim.unit}, {own.guess} {own.zero:.3g}; "
            f"skill {own}"
        )


def _rounded(value: Any) -> Any:
    """Return parameters rounded to five digits, which exceeds the accuracy of each."""
    if isinstance(value, float):
        return float(f"{value:.5g}")
    if isinstance(value, dict):
        return {key: _rounded(each) for key, each in value.items()}
    return [_rounded(each) for each in value] if isinstance(value, list) else value


_TITLE = "# How real is it?"
_HEAD = f"""{_TITLE}

Written by `tactemu bench realism DATA --page docs/realism.md --parameters tactemu/fit/parameters.json` from public
recordings of real sensors: eFlesh (MIT), Weiss DSA on an SDH-2 hand (GPL-3.0: measured, not copied), CPM-Finger
(MIT), AnySkin on a LEAP hand (MIT), iCub hand (free use), a silicone pad with a fluid
channel (CC BY 4.0).

<!-- contents -->
On this page: [Laws](#laws), [Constants](#constants),
[What the recordings do not determine](#what-the-recordings-do-not-determine),
[Predictions with these parameters](#predictions-with-these-parameters),
[Parameters, fitted on all recordings](#parameters-fitted-on-all-recordings).

## Laws

A law predicts recordings that were left out. *Zero skill* is the error of the best simple guess on the same
recordings, named in the column "its guess": such as the mean of the others, a straight line through them, or the one
of the nearest condition. `skill = 1 − error / zero skill`: 1 is perfect, 0 is no better than that guess. The interval
is of 95 %, over independent recordings. With six recordings or more, a law was chosen and fitted on one half, which
follows from their names, and judged once on the other; with fewer, each is left out in turn. Where the law
says so, all slides at one speed or under one grip are left out in turn, and count as one recording. With fewer than
four a law cannot be judged, and nothing uses it unless you ask for it.

| recordings | law | aim | error | worst | zero skill | its guess | skill | n | result |
| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |
"""

_CONSTANTS = """
The equations are in the docstrings of [`tactemu/fit/sets`](../tactemu/fit/sets), one file for each set, and in
[`laws.py`](../tactemu/transducers/laws.py). Errors are root mean squares over all predictions; sums, noise and peaks
are compared as logarithms of ratios.

- **eFlesh**: both recordings are of one mounting, seven minutes apart, so repeating the other at the same height is
  hard to beat; the law is for another mounting, whose height the first press gives.
- **Weiss**: half of the weights, of which one series is warm and the other cold, determines five parameters to 16 %;
  all of them, each left out in turn, to 10 %.
- **CPM-Finger on its board**: amplitudes are shares of the grip at every speed, as in a skin that answers in
  equilibrium; a straight line through grip and speed is nearly as good. Judged once on half of the conditions instead,
  the line has a skill of 0.03 (-0.03 to 0.17) and the second harmonic 0.18 (-3.3 to 0.46): none shown.
- **CPM-Finger on cotton**: an oscillation sets in around a grip of 190 counts. Its peak stays at 2.0 to 2.4 Hz from 10
  to 150 mm/s and most of it is common to all taxels, so that it is not the fabric's texture: rather the gripper. The
  numbers were fitted without the grip that is left out; the form was chosen with all five in view. On half of the
  conditions it has a skill of 0.05 (-0.70 to 0.38), none shown: repeats of a slide agree to 8 %, as well as the law.

## Constants

A constant predicts no more than its mean, so it has a spread and no skill.

| recordings | constant | mean | spread | smallest | largest | n |
| --- | --- | --- | --- | --- | --- | --- |
"""

_TAIL = """
The spread is the standard deviation over the recordings.

## What the recordings do not determine

- **Objects never grasped before**: how hard a hand holds a thing is not a property of its sensor.
- **Fingers that move** carry magnets past one another: the noise of an untouched skin differs by 40 % between two runs
  of the same motion, and the recordings do not show why.
- **Another material**: the noise of sliding on a fabric that was not recorded; and with it the texture of a fabric,
  which 16 taxels at 36 Hz do not resolve beside the gripper's oscillation.
- **The third and fourth harmonic of a board**: a share of the grip predicts them 15 % and 18 % better than the best
  guess, with intervals over four speeds of -0.37 to 0.57 and -0.59 to 0.26: no skill shown, so there are no laws.
- **The order in which cells let go** on the Weiss slips: 28 and 62 releases of an object by hand. That cells with the
  least pressure go first correlates with their order by -0.15 and 0.05, that outer ones do by -0.12 and 0.06; the ranks
  are predicted no better than by their mean, and two recordings could not show it. So there is no law.
- **The jumps of tugs** (23 of eFlesh, without times): their quantiles are those of the other tugs, 42 µT at the median,
  54 µT at 95 % and 61 µT at 99 %, to 3, 9 and 13 %. The median is that of the sensor's noise, 30 µT over 30 channels,
  in a difference of two rows. Scaling by the tug's own first fifth leaves 3, 9 and 13 % as well: a distribution, and no
  law.
- **Presses along eFlesh's surface**, and how the gap of its field closes from press to press: laws of both predicted
  recordings of other days no better than their mean, so there are none.
- **Relaxation of a pad over its load**: one constant predicts other media as well.
- The scale of eFlesh has an unknown delay: only the loading branch is evaluated, not the loop of force over depth.

## Predictions with these parameters

<!-- not run: it needs gigabytes of recordings -->
```sh
tactemu bench realism --held OTHER        # other recordings of the same sensors, with the parameters below
```

```python
import json
from tactemu.fit import sets
from tactemu.fit.realism import PARAMETERS

parameters = json.loads(PARAMETERS.read_text())["weiss_sdh2"]
sets.set_module("weiss_sdh2").predicted_sum(parameters, mass_g=450, temperature_c=35)
```

## Parameters, fitted on all recordings

"""


def _page(laws: Sequence[LawLine], fixed: Sequence[ConstantLine], fitted: dict[str, Any]) -> str:
    rows = []
    for line in laws:
        own, unit = line.skill, line.aim.unit
        result = own.verdict if own.error <= line.aim.most else f"{own.verdict}; aim **not reached**"
        rows.append(
            f"| {line.set} | {line.aim.law} | {line.aim.most:g} {unit} | {own.error:.3g} | {own.worst:.3g} "
            f"| {own.zero:.3g} | {own.guess} | {own.interval} | {own.count} | {result} |"
        )
    means = []
    for each in fixed:
        values = np.array(each.values)
        spread = f"{values.std(ddof=1):.2g}" if len(values) > 1 else "–"
        ends = f"{values.min():.3g} | {values.max():.3g} | {len(values)}"
        means.append(f"| {each.set} | {each.name} | {values.mean():.4g} {each.unit} | {spread} | {ends} |")
    found = [f"**{name}**\n\n```json\n{json.dumps(values, indent=1)}\n```\n" for name, values in _short(fitted).items()]
    return _HEAD + "\n".join(rows) + "\n" + _CONSTANTS + "\n".join(means) + "\n" + _TAIL + "\n".join(found)


def _short(fitted: dict[str, Any]) -> dict[str, Any]:
    """Return the parameters without the baseline of sixty taxels."""
    return {name: {key: each for key, each in values.items() if key != "rest"} for name, values in fitted.items()}
