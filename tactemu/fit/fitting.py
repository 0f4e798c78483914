"""`tactemu fit`: recordings of a real sensor in, a scene file and a report out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from firmware_protocols import Device
from tactemu.base.errors import TactemuError, reason_of
from tactemu.base.files import check_writable
from tactemu.base.style import PAGE_SIGN
from tactemu.fit.estimates import Findings, linear
from tactemu.fit.magnets import find_magnets
from tactemu.fit.places import find_places
from tactemu.fit.press import PRESSED, bases_of, drive_of, find_presses, presses_of
from tactemu.fit.recording import Recorded
from tactemu.fit.report import Score, overall, page
from tactemu.fit.untouched import find_untouched, untouched_rows


def find(recorded: Recorded, device: Device | None = None) -> Findings:
    """Return the findings of one recording; with a device, the places of its taxels and magnets are estimated, too.

    Raises:
        TactemuError: the recording cannot be used.
    """
    found = Findings(notes=list(recorded.notes))
    check_units(recorded)
    gains = find_presses(recorded, found)
    if device is not None and (recorded.load is not None or "depth" in recorded.truth):
        find_places(recorded, device, found)
        find_magnets(recorded, device, found)
    own = np.isfinite(gains)
    if own.any():  # channels that do not follow the load are left out of the noise, too
        recorded = replace(
            recorded, readings=recorded.readings[:, own], names=tuple(np.array(recorded.names)[own].tolist())
        )
    find_untouched(recorded, untouched_rows(recorded), found)
    return found


def check_units(recorded: Recorded) -> None:
    """Check that the numbers are possible in their units.

    Raises:
        TactemuError: the unit of a column must be wrong.
    """
    limits = {
        "field": (1e-9, 0.5, "--unit field=uT"),
        "pressure": (1e-3, 1e8, "--unit pressure=kPa"),
        "capacitance": (1e-18, 1e-6, "--unit capacitance=pF"),
        "resistance": (1e-3, 1e12, "--unit resistance=kOhm"),
    }
    size = float(np.percentile(np.abs(recorded.readings), 99))
    if recorded.kind in limits:
        low, high, hint = limits[recorded.kind]
        if not low <= size <= high:
            raise TactemuError(
                f"{recorded.path}: {recorded.kind} of {size:.3g} SI in {recorded.unit}: no sensor reads that; is the "
                f"unit right? ({hint})"
            )
    load = recorded.load
    if load is not None and load.max() > 2000:
        raise TactemuError(
            f"{recorded.path}: presses of {load.max():.4g} N; is the unit right? (--unit mass=g, force=mN)"
        )
    depth = recorded.truth.get("depth")
    if depth is not None and np.ptp(depth) > 0.1:
        raise TactemuError(
            f"{recorded.path}: presses of {np.ptp(depth):.3g} m depth; is the unit right? (--unit depth=mm)"
        )


def fit(
    recordings: Sequence[Recorded], progress: Callable | None = None, device: Device | None = None
) -> tuple[Findings, list[Score]]:
    """Return the combined findings of recordings of one sensor, and the scores of predicting each by another.

    Of a single recording the first two thirds predict the last one.
    """
    progress = progress or (lambda items, _title, _total: items)
    each = [find(one, device) for one in progress(recordings, "fit", len(recordings))]
    together = each[0] if len(each) == 1 else combined(each)
    return together, scores(recordings)


def combined(each: Sequence[Findings]) -> Findings:
    """Combine findings into weighted means; intervals are at least as wide as the recordings differ."""
    merged = Findings()
    for name in dict.fromkeys(name for one in each for name in one.estimates):
        own = [one.estimates[name] for one in each if name in one.estimates]
        values, errors = np.array([e.value for e in own]), np.array([e.error for e in own])
        weights = np.ones(len(own)) if (errors == 0).any() else errors**-2
        mean = float(values @ weights / weights.sum())
        own_error = 0.0 if (errors == 0).any() else float(weights.sum() ** -0.5)
        apart = float(values.std(ddof=1) / np.sqrt(len(own))) if len(own) > 1 else 0.0
        merged.add(name, mean, max(own_error, apart), own[0].unit, own[0].about)
    merged.unknown = list(dict.fromkeys(text for one in each for text in one.unknown))
    merged.unknown = [text for text in merged.unknown if text.split(":")[0] not in merged.estimates]
    merged.notes = list(dict.fromkeys(text for one in each for text in one.notes))
    return merged


def scores(recordings: Sequence[Recorded]) -> list[Score]:
    """Return the score of each recording of presses predicted by another; of a single one, of its last third by the
    other two."""
    timed = [one for one in recordings if one.load is not None and one.t is not None]
    if len(timed) > 1:
        return [score for k, one in enumerate(timed) if (score := _score(timed[k - 1], one, one.path.name))]
    if not timed:
        return []
    n = len(timed[0].readings)
    early, late = (_part(timed[0], part) for part in (slice(None, 2 * n // 3), slice(2 * n // 3, None)))
    score = _score(early, late, f"{timed[0].path.name}, its last third", before=True)
    return [score] if score else []


def _part(one: Recorded, part: slice) -> Recorded:
    assert one.t is not None
    return replace(one, t=one.t[part], readings=one.readings[part], truth={k: v[part] for k, v in one.truth.items()})


def _score(known: Recorded, other: Recorded, name: str, *, before: bool = False) -> Score | None:
    load, held = known.load, other.load
    if load is None or held is None or known.t is None or other.t is None:
        return None
    if known.readings.shape[1] != other.readings.shape[1] or np.ptp(load) == 0 or np.ptp(held) == 0:
        return None
    plain = np.column_stack([np.ones(len(load)), load])
    gains = np.array([linear(plain, column)[0][1] if column.std() else 0.0 for column in known.readings.T])
    if not gains.any():
        return None
    signal, measured = (one.readings @ gains / (gains @ gains) for one in (known, other))
    (drive, degree), (of_other, _) = drive_of(known, load), drive_of(other, held)
    presses, following = presses_of(drive, known.t), presses_of(of_other, other.t)
    if before:  # the presses follow those that were fitted
        following = replace(following, count=following.count + presses.count[-1])
    fitted = bases_of(following, degree) @ linear(bases_of(presses, degree), signal)[0]
    line = linear(np.column_stack([np.ones(len(drive)), drive]), signal)[0]
    straight = line[0] + line[1] * of_other
    peak = int(np.argmax(drive > 0.9 * drive.max()))
    order = np.argsort(drive[: peak + 1])
    repeated = np.interp(of_other, drive[: peak + 1][order], signal[: peak + 1][order])
    free = of_other < PRESSED * of_other.max()
    fitted, straight, repeated = (
        each + (np.median((measured - each)[free]) if free.any() else 0.0) for each in (fitted, straight, repeated)
    )
    return Score(name, held, measured, fitted, {"a linear map": straight, "repeating": repeated})


def run_fit(
    recordings: Sequence[Recorded],
    *,
    device: str,
    out: Path,
    report: Path | None = None,
    command: str = "",
    say: Callable[[str], object] = print,
    progress: Callable | None = None,
) -> Findings:
    """Fit recordings of one sensor, write a scene file, and a report, which names the command line.

    Raises:
        TactemuError: a recording cannot be used, or a file cannot be written.
    """
    from tactemu.fit.writing import SIGN, device_for, scene_text
    from tactemu.scene.file import device_class, parse

    check_writable(out, "the scene file", SIGN)
    check_writable(report, "the report", PAGE_SIGN)
    kind = device_class(device)
    found, scored = fit(recordings, progress, device_for(kind, recordings[0]))
    text = scene_text(device, kind, recordings, found)
    parse(text, source=str(out))  # checks that the scene file is valid
    try:
        out.write_text(text, encoding="utf-8")
        if report is not None:
            report.write_text(page(device, recordings, found, scored, command), encoding="utf-8")
    except OSError as error:
        raise TactemuError(f"{error.filename}: cannot be written: {reason_of(error, error.filename)}") from None
    for estimate in found.estimates.values():
        say(f"  {estimate}")
    for title, lines in (("noticed", found.notes), ("not determined", found.unknown)):
        for line in lines:
            say(f"  {title}: {line}")
    for score in scored:
        say(f"  {score.name} predicted: rms {score.skill.error:.3g} N; {score.skill.guess} {score.skill.zero:.3g} N")
    if scored:
        say(f"  skill of these laws: {overall(scored)}")
    say(f"{out}" + (f", {report}" if report else ""))
    return found
