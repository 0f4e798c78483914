"""The judgement of `tactemu infer` on captures of every device, and the tables of docs/infer.md.

    python -m benchmarks infer --page docs/infer.md

Each device is judged by itself, without the catalogue (:mod:`benchmarks.infer_judge`).
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.infer_corpus import make, wire_devices
from benchmarks.infer_judge import Verdict, judge
from benchmarks.infer_misses import MISSES_INTRODUCTION, MissedField, misses_table
from benchmarks.infer_truths import NOT_COUNTED

LEAST_ASKED = 40
"""The fewest questions of a device whose pairs are judged."""


def run(
    say: Callable[[str], None], names: Iterable[str] = (), *, folder: Path, page: Path | None = None, **options: Any
) -> None:
    """Judge the devices, one after another, with and without times, and write the tables of the page."""
    chosen = list(names) or wire_devices()
    timed, untimed = [], []
    for name in chosen:
        truth = make(name, folder, **options)
        timed.append(judge(truth))
        say(line_of(timed[-1]))
        is_stream = timed[-1].way == "stream"
        untimed.append(judge(truth, with_times=False) if is_stream else timed[-1])
    for line in (*summary(timed), "without times:", *summary(untimed)):
        say(line)
    if page is not None:
        text = page.read_text(encoding="utf-8")
        before, _, rest = text.partition(BEGIN)
        after = rest.partition(END)[2]
        page.write_text(f"{before}{BEGIN}\n\n{tables(timed, untimed)}\n\n{END}{after}", encoding="utf-8")


BEGIN, END = "<!-- begin: python -m benchmarks infer -->", "<!-- end -->"


def tables(timed: list[Verdict], untimed: list[Verdict]) -> str:
    """Return the tables of the page: the summary, a line for each device, and the missed fields by kind of mistake."""
    lines = ["| captures | framing and sum | fields right | devices with 90 % | certain | certain and wrong | paired |"]
    lines.append("| --- | --- | --- | --- | --- | --- | --- |")
    for words, some in (
        ("serial, with times", [each for each in timed if each.way != "CAN"]),
        ("serial, without times", [each for each in untimed if each.way != "CAN"]),
        ("CAN", [each for each in timed if each.way == "CAN"]),
    ):
        lines.append(_summary_row(words, some))
    lines += ["", "| device | seen as | framing | without times | sum | right | certain | wrong | certain and wrong |"]
    lines.append("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    for each, other in zip(timed, untimed):
        sum_text = ("right" if each.is_sum_right else "wrong") if each.sums else "none"
        counted = f"{each.right} of {each.counted}" if each.counted else NOT_COUNTED.get(each.name, "nothing moves")
        cells = (
            f"`{each.name}`", each.way, _yes(each.is_framed), _yes(other.is_framed), sum_text, counted,
            each.right_certain, len(each.misses), len(each.false_certain),
        )  # fmt: skip
        lines.append(f"| {' | '.join(map(str, cells))} |")
    lines += [
        "",
        "## Every miss",
        "",
        MISSES_INTRODUCTION,
        "",
        *misses_table(
            MissedField(
                each.name,
                miss.group.replace("|", "/"),
                f"{miss.place[3]} at {miss.place[0]}",
                miss.what,
                ", ".join(miss.found) or "nothing",
            )
            for each in timed
            for miss in each.misses
        ),
    ]
    return "\n".join(lines)


def _yes(value: bool) -> str:
    return "yes" if value else "no"


def _summary_row(words: str, some: list[Verdict]) -> str:
    counted = [each for each in some if each.counted]
    right, certain = sum(each.right for each in some), sum(each.right_certain for each in some)
    asked = [each for each in some if each.asked > LEAST_ASKED]
    cells = (
        words,
        f"{sum(each.is_framed and each.is_sum_right for each in some)} of {len(some)}",
        f"{right} of {sum(each.counted for each in some)}",
        f"{sum(each.share >= 0.9 for each in counted)} of {len(counted)}",
        f"{certain / max(1, right):.0%}",
        sum(len(each.false_certain) for each in some),
        f"{sum(each.paired >= 0.9 * each.asked for each in asked)} of {len(asked)}",
    )
    return f"| {' | '.join(map(str, cells))} |"


def line_of(verdict: Verdict) -> str:
    """Return a verdict in one line."""
    kinds = Counter(miss.what for miss in verdict.misses)
    return (
        f"{verdict.name:24} {verdict.way:8} {'framed' if verdict.is_framed else 'NOT FRAMED'}"
        f"{'' if verdict.is_sum_right else ' WRONG SUM'} {verdict.right}/{verdict.counted} right,"
        f" {verdict.right_certain} certain, {dict(kinds)}, false and certain {len(verdict.false_certain)},"
        f" pairs {verdict.paired}/{verdict.asked}, {verdict.seconds:.1f} s | {verdict.framing[:60]}"
    )


def summary(verdicts: list[Verdict]) -> list[str]:
    """Return the figures by which infer is judged."""
    lines = []
    groups: defaultdict[str, list[Verdict]] = defaultdict(list)
    for verdict in verdicts:
        groups["CAN" if verdict.way == "CAN" else "serial"].append(verdict)
    for kind, some in groups.items():
        counted = [each for each in some if each.counted]
        good = [each for each in counted if each.share >= 0.9]
        framed = [each for each in some if each.is_framed and each.is_sum_right]
        asked = [each for each in some if each.asked > LEAST_ASKED]
        paired = [each for each in asked if each.paired >= 0.9 * each.asked]
        right, certain = sum(each.right for each in some), sum(each.right_certain for each in some)
        lines.append(
            f"{kind}: framing and sum {len(framed)}/{len(some)}; fields {right}/{sum(each.counted for each in some)};"
            f" devices with 90 % {len(good)}/{len(counted)}; certain {certain}/{right}"
            f" ({certain / max(right, 1):.0%}, mean of devices"
            f" {np.mean([each.right_certain / max(1, each.right) for each in counted]):.0%});"
            f" false and certain {sum(len(each.false_certain) for each in some)};"
            f" paired {len(paired)}/{len(asked)}; slowest {max(each.seconds for each in some):.1f} s"
        )
    return lines
