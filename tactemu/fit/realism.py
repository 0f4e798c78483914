"""The errors with which the laws of real sensors predict recordings that were not fitted: docs/realism.md.

    tactemu bench realism DATA --page docs/realism.md --parameters tactemu/fit/parameters.json
    tactemu bench realism --held OTHER

The first command fits each set's laws and leaves recordings out in turn (:mod:`tactemu.fit.sets`); the second predicts
other recordings of the same sensors with the parameters of the package.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactemu.base.errors import TactemuError
from tactemu.fit import sets
from tactemu.fit.sets.aims import Aim, Recordings

PARAMETERS = Path(__file__).with_name("parameters.json")
"""The parameters of the package, fitted on all recordings."""


@dataclass(frozen=True)
class Line:
    """One line of the table."""

    set: str
    law: str
    most: float
    unit: str
    error: float
    """The error of all predictions, summed as the aim states."""
    by: str
    worst: float
    count: int
    """The number of predictions."""

    @property
    def reached(self) -> bool:
        """True if the error is within the aim."""
        return self.error <= self.most


def left_out(name: str, folder: Path) -> tuple[list[Line], dict[str, Any]]:
    """Return the lines of a set, whose predictions are all of left-out recordings, and parameters fitted on all of it.

    Raises:
        TactemuError: the folder has no recordings of the set.
    """
    module = sets.set_module(name)
    recordings = module.read(folder)
    if not recordings:
        raise TactemuError(f"{folder}: no recordings of this set; {module.__name__} describes its files")
    found: dict[str, list[np.ndarray]] = {}
    for given, out in module.folds(recordings):
        known = {each: recordings[each] for each in given}
        held = {each: recordings[each] for each in out}
        _gather(found, module.errors(module.fit(known), held, known))
    return _lines(name, module.AIMS, found), module.fit(recordings)


def predicted(name: str, folder: Path, parameters: dict[str, Any]) -> list[Line]:
    """Return the lines of other recordings of a set's sensor, none of which was fitted."""
    module = sets.set_module(name)
    recordings: Recordings = module.read(folder)
    found: dict[str, list[np.ndarray]] = {}
    _gather(found, module.errors(parameters, recordings))
    return _lines(name, module.AIMS, found)


def _gather(found: dict[str, list[np.ndarray]], errors: dict[str, np.ndarray]) -> None:
    for key, values in errors.items():
        found.setdefault(key, []).append(np.ravel(values))


def _lines(name: str, aims: Sequence[Aim], found: dict[str, list[np.ndarray]]) -> list[Line]:
    lines = []
    for aim in aims:
        errors = np.concatenate(found.get(aim.key, [np.zeros(0)]))
        if len(errors):
            worst = float(np.abs(errors).max())
            lines.append(Line(name, aim.law, aim.most, aim.unit, aim.summed(errors), aim.by, worst, len(errors)))
    return lines


def run(
    report: Callable[[str], Any] = print,
    *,
    data: Path | None = None,
    held: Path | None = None,
    page: Path | None = None,
    parameters: Path | None = None,
) -> dict[str, Any]:
    """Measure the errors of laws on recordings, and write the page and the parameters to the files given.

    Args:
        report: receives lines of text.
        data: a folder with a folder for each set: laws are fitted on them, each recording left out in turn.
        held: such a folder with other recordings: predicted by the laws fitted on ``data``, else by :data:`PARAMETERS`.
        page: the Markdown file to write.
        parameters: the JSON file to write.

    Raises:
        TactemuError: neither folder is given, or a folder has no set.
    """
    if data is None and held is None:
        raise TactemuError("realism: name a folder of recordings, or give one with --held")
    lines: list[Line] = []
    fitted = json.loads(PARAMETERS.read_text(encoding="utf-8")) if data is None else {}
    for name, folder in _sets_in(data):
        own, fitted[name] = left_out(name, folder)
        lines += own
        _report_lines(report, own)
    others: list[Line] = []
    for name, folder in _sets_in(held):
        if name in fitted:
            others += predicted(name, folder, fitted[name])
    if others:
        report(f"predictions of {held}, which was not fitted:")
        _report_lines(report, others)
    if parameters is not None:
        parameters.write_text(json.dumps(_rounded(fitted), indent=1) + "\n", encoding="utf-8")
    if page is not None:
        page.write_text(_page(lines or others, _rounded(fitted)), encoding="utf-8")
    return {"left out": [asdict(line) for line in lines], "held": [asdict(line) for line in others], "fitted": fitted}


def _sets_in(folder: Path | None) -> list[tuple[str, Path]]:
    """Return names and folders of the sets in a folder."""
    if folder is None:
        return []
    found = [(name, folder / name) for name in sets.SETS if (folder / name).is_dir()]
    if not found:
        raise TactemuError(f"{folder}: no folder of a set (sets: {', '.join(sets.SETS)})")
    return found


def _report_lines(report: Callable[[str], Any], lines: Sequence[Line]) -> None:
    for line in lines:
        mark = "reached" if line.reached else "NOT reached"
        report(f"{line.set:20} {line.law:80} {line.error:8.3g} {line.unit} (aim {line.most:g}, {line.by}): {mark}")


def _rounded(value: Any) -> Any:
    """Return parameters rounded to five digits, which exceeds the accuracy of each."""
    if isinstance(value, float):
        return float(f"{value:.5g}")
    if isinstance(value, dict):
        return {key: _rounded(each) for key, each in value.items()}
    return [_rounded(each) for each in value] if isinstance(value, list) else value


_HEAD = """# How real is it?

Written by `tactemu bench realism DATA --page docs/realism.md --parameters tactemu/fit/parameters.json` from public
recordings of real sensors: eFlesh (MIT), Weiss DSA on an SDH-2 hand (GPL-3.0: measured, not copied), CPM-Finger
(MIT), AnySkin on a LEAP hand (MIT), iCub hand (free use), Inspire RH56DFX (Apache-2.0), a silicone pad with a fluid
channel (CC BY 4.0). Each figure is the error of predictions of left-out recordings: the law was fitted on the others.
The line of a law names the parts of a predicted recording that it uses.

<!-- contents -->
On this page: [Aims that are not reached, and why](#aims-that-are-not-reached-and-why),
[What the recordings do not determine](#what-the-recordings-do-not-determine),
[Predictions with these parameters](#predictions-with-these-parameters),
[Parameters, fitted on all recordings](#parameters-fitted-on-all-recordings).

| recordings | law | aim | error | worst | predictions | result |
| --- | --- | --- | --- | --- | --- | --- |
"""

_TAIL = """
The equations are in the docstrings of [`tactemu/fit/sets`](../tactemu/fit/sets), one file for each set, and in
[`laws.py`](../tactemu/transducers/laws.py). The error is the root mean square over the predictions, unless marked
*worst*; sums and noise are compared as logarithms of ratios.

## Aims that are not reached, and why

- **Objects never seen**: the force of a grasp is not a property of the sensor. If the object was recorded, its other
  grasps predict it.
- **Fingers that move** carry magnets past one another: the noise of an untouched skin differs by 40 % between two
  runs of the same motion, and the recordings do not show why.
- **Sums of weights, as plain shares**: predictions that are too high count more than as logarithms. Neither a fitted
  exponent of the resistance nor a loss that reduces outliers brings the error below its aim.
- **Force stop at speed 100**: at a limit of 500 g the finger goes 10 angle steps further than the law, which holds at
  all other speeds and limits.

## What the recordings do not determine

- The lag of a fluid is a property of the medium: a recording of another medium does not determine it.
- The scale of eFlesh has an unknown delay: only the loading branch is evaluated, not the loop of force over depth.
- The noise of sliding on a fabric that was not recorded: the law has two materials.

## Predictions with these parameters

```
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


def _page(lines: Sequence[Line], fitted: dict[str, Any]) -> str:
    rows = []
    for line in lines:
        by, verdict = " (worst)" if line.by == "worst" else "", "reached" if line.reached else "**not reached**"
        figures = f"{line.most:g} {line.unit} | {line.error:.3g}{by} | {line.worst:.3g} | {line.count}"
        rows.append(f"| {line.set} | {line.law} | {figures} | {verdict} |")
    found = [f"**{name}**\n\n```json\n{json.dumps(values, indent=1)}\n```\n" for name, values in _short(fitted).items()]
    return _HEAD + "\n".join(rows) + "\n" + _TAIL + "\n".join(found)


def _short(fitted: dict[str, Any]) -> dict[str, Any]:
    """Return the parameters without the baseline of sixty taxels."""
    return {name: {key: each for key, each in values.items() if key != "rest"} for name, values in fitted.items()}
