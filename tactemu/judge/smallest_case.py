"""The smallest case: the one edit out of many that causes a finding, confirmed alone.

First the edit before the first wrong row is tried alone, then halves of all edits. There is no random search, since
each run takes a second.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from tactemu.base.errors import TactemuError, reason_of
from tactemu.base.files import check_overwriting
from tactemu.judge.outcome import FAILING, Outcome
from tactemu.judge.plan import Trial
from tactemu.judge.trial_record import TrialRecord
from tactemu.wire.faults import Fault, parse
from tactemu.wire.faults.fault import FrameFault
from tactemu.wire.faults.options import Ranges

MAX_RUNS = 8
"""Maximum number of runs of a search; bounds its time."""
MAX_WHOLE_DIGITS = 64
"""Maximum number of hexadecimal digits of a frame that is shown whole, so that the line fits a terminal."""
MAX_CUT_DIGITS = 36
"""Number of digits that are shown of a longer one."""
NEXT_PIECE = "\n" + 11 * " "
"""The line break and indent before another piece of a frame."""
VERSION = 1
SIGN = '"finding":'
"""A text in the head of every case."""
_CAN_HEAD = re.compile(r"([0-9A-Fa-f]+#(#[0-9A-Fa-f])?)?")
"""A pattern of the identifier and flags of a CAN frame; it matches "" at the begin of other frames."""

Run = Callable[[Trial], tuple[TrialRecord, Outcome]]


def may_be(trial: Trial) -> bool:
    """Return True if a trial consists of edits of single frames, so that it can have a smallest case."""
    return bool(trial.faults) and not trial.action and len(trial.edits) == len(trial.faults)


def find(
    trial: Trial,
    record: TrialRecord,
    outcome: Outcome,
    run: Run,
    target: str,
    command: Sequence[str],
    kinds: Sequence[str] = FAILING,
) -> dict[str, Any] | None:
    """Return the smallest case of the worst finding of these kinds, as JSON data.

    It is None if there is no such finding, or if no edits that were tried alone cause it.
    """
    kind = next((finding.kind for finding in outcome.findings if finding.kind in kinds), None)
    if kind is None:
        return None
    groups = _by_frame(trial)
    suspects = _suspects(groups, record, outcome)
    runs = 0

    def fails(some: Sequence[Sequence[FrameFault]]) -> tuple[TrialRecord, Outcome] | None:
        nonlocal runs
        runs += 1
        alone = Trial(trial.name, trial.why, _numbered_anew(some), remark=trial.remark, takes_s=1.0)
        seen = run(alone)
        return seen if seen[1].has(kind) else None

    found = None
    for group in suspects[:2]:
        if seen := fails([group]):
            found, groups = seen, [group]
            break
    while found is None and len(groups) > 1 and runs < MAX_RUNS:
        half = len(groups) // 2
        for part in (groups[:half], groups[half:]):
            if seen := fails(part):
                groups = part
                if len(part) == 1:
                    found = seen
                break
        else:
            found = fails(groups)
            break
    if found is None and len(groups) == 1:
        found = fails(groups)
    if found is None:
        return None
    return _case(trial, groups, kind, *found, runs, target, command)


def _by_frame(trial: Trial) -> list[list[FrameFault]]:
    """Return the faults in groups, one for each frame."""
    groups: dict[Ranges, list[FrameFault]] = {}
    for fault in trial.edits:
        groups.setdefault(fault.frames, []).append(fault)
    return list(groups.values())


def _suspects(groups: list[list[FrameFault]], record: TrialRecord, outcome: Outcome) -> list[list[FrameFault]]:
    """Return the groups of edits that were made last before the first wrong row."""
    wrong = [bad["t"] for bad in outcome.bad if bad["t"] > record.on]
    until = min(wrong) if wrong else record.rows[-1].t_ns if record.rows else record.end
    made = [change for change in record.injected_faults if record.on <= change.t_ns <= until + 1_000_000]
    found = []
    for change in reversed(made[-6:]):
        found += [group for group in groups if change.fault in map(str, group) and group not in found]
    return found


def _numbered_anew(groups: Sequence[Sequence[FrameFault]]) -> list[Fault]:
    """Return the same edits with lower frame numbers, so that the first one hits an early frame."""
    shift = max(0, min(group[0].frames[0][0] for group in groups) - 8)
    return [
        replace(fault, frames=tuple((first - shift, last - shift) for first, last in fault.frames), text="")
        for group in groups
        for fault in group
    ]


def _case(
    trial: Trial, groups: Sequence[Sequence[FrameFault]], kind: str, record: TrialRecord, outcome: Outcome, runs: int,
    target: str,
    command: Sequence[str],
) -> dict[str, Any]:  # fmt: skip
    changes = [change for change in record.injected_faults if change.t_ns >= record.on]
    bad = next((bad for bad in outcome.bad), None)
    return {
        "version": VERSION, "device": target, "command": list(command), "trial": trial.name, "finding": kind,
        "verdict": outcome.verdict, "remark": outcome.remark, "faults": list(map(str, _numbered_anew(groups))),
        "runs": runs,
        "bytes": [{"fault": c.fault, "before": c.before, "after": list(c.after)} for c in changes[:4]],
        "row": None if bad is None else bad["row"], "truth": None if bad is None else bad["truth"],
        "odd": [] if bad is None else bad["odd"],
    }  # fmt: skip


# -- as files ----------------------------------------------------------------------------------------------------------


def file_name(trial: str) -> str:
    """Return the name of the file of a trial's case."""
    return f"{trial.replace(' ', '-')}.json"


def write(case: dict[str, Any], path: Path) -> None:
    """Write a case for ``--replay``.

    Raises:
        TactemuError: the file cannot be written, or is of another program.
    """
    check_overwriting(path, SIGN)
    try:
        path.write_text(json.dumps(case, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise TactemuError(f"{path}: cannot write the case: {reason_of(error, path)}") from None


def read(path: Path) -> dict[str, Any]:
    """Return a case that :func:`write` wrote.

    Raises:
        TactemuError: the file cannot be read or is no case.
    """
    try:
        case = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise TactemuError(f"{path}: cannot read the case: {reason_of(error)}") from None
    except ValueError:
        about = "--replay takes a file of the folder that --cases of an earlier run has written"
        raise TactemuError(f"{path}: not a case: {about}") from None
    needed = {"device": str, "command": list, "faults": list, "finding": str, "trial": str}
    if not isinstance(case, dict) or case.get("version") != VERSION:
        raise TactemuError(f"{path}: not a case that this tactemu reads")
    for name, kind in needed.items():
        if not isinstance(case.get(name), kind):
            raise TactemuError(f"{path}: not a case: {name} is missing or no {kind.__name__}")
    return case


def trial_of(case: dict[str, Any]) -> Trial:
    """Return the trial of a case."""
    faults = [parse(str(fault)) for fault in case["faults"]]
    return Trial(case["trial"], "the smallest case", faults, remark=case.get("remark", ""), takes_s=1.0)


def in_words(case: dict[str, Any]) -> str:
    """Return a case as about ten lines of text, for an issue with the driver's maintainers."""
    lines = [f"Sensor: {case['device']} (emulated by tactemu). Driver: {' '.join(case['command'])}"]
    lines += [f"Faults on the wire: {'; '.join(case['faults'])} (frames counted from 1, bytes from 0)"]
    for each in case["bytes"][:2]:
        sent, *arrived = marked(each["before"], each["after"])
        lines += [f"  sent:    {sent}", f"  arrived: {(' +' + NEXT_PIECE).join(arrived) or 'nothing'}"]
    lines += [f"Verdict: {case['verdict']}"]
    lines += [f"Note: {case['remark']}"] if case.get("remark") else []
    if case["row"]:
        names = case["odd"] or list(case["row"])
        shown = [name for name in names if name in case["row"]][:4]
        lines += ["  it reports    " + ", ".join(f"{name} = {case['row'][name]:g}" for name in shown)]
        if case["truth"]:
            lines += ["  it should be  " + ", ".join(f"{n} = {case['truth'].get(n, float('nan')):g}" for n in shown)]
    return "\n".join(lines)


def marked(before: str, after: Sequence[str]) -> list[str]:
    """Return the sent and the arrived frames with what differs in brackets; long ones are cut around it."""
    match = _CAN_HEAD.match(before)
    head = match[0] if match else ""
    sent, *arrived = (data.removeprefix(head) for data in (before, *after))
    same = max((_common_length(sent, each) for each in arrived if each != sent), default=0) // 2 * 2
    end = _common_length(sent[same:][::-1], arrived[0][same:][::-1]) // 2 * 2 if len(arrived) == 1 else None
    is_long = max(map(len, (sent, *arrived))) > MAX_WHOLE_DIGITS
    start = max(0, same - MAX_CUT_DIGITS // 2) // 2 * 2 if is_long else 0
    most = MAX_CUT_DIGITS if is_long else MAX_WHOLE_DIGITS
    shown = []
    for data in (sent, *arrived):
        changed = (same, same if end is None else len(data) - end)
        # A piece that continues another one has its own beginning.
        shown.append(_cut(head, data, start if data[:start] == sent[:start] else 0, most, changed))
    return shown


def _common_length(one: str, other: str) -> int:
    """Return the length of the common beginning of two texts."""
    return next((k for k, (a, b) in enumerate(zip(one, other)) if a != b), min(len(one), len(other)))


def _cut(head: str, data: str, start: int, most: int, changed: tuple[int, int]) -> str:
    """Return the digits of a frame from ``start`` on, with the changed ones in brackets."""
    left, right = "… " if start else "", " …" if start + most < len(data) else ""
    where = f" (from byte {start // 2} of {len(data) // 2})" if left or right else ""
    at, end = changed[0], min(changed[1], start + most)
    shown = data[start : start + most]
    if end > at:
        shown = f"{data[start:at]}[{data[at:end]}]{data[end : start + most]}"
    return f"{head}{left}{shown}{right}{where}"


__all__ = ["SIGN", "file_name", "find", "in_words", "marked", "may_be", "read", "trial_of", "write"]
