"""Reports as one HTML file.

Jinja2 would save fifty lines here and in :mod:`tactemu.fit.report`, for two more packages in every installation and
templates that no type checker reads.
"""

from __future__ import annotations

from html import escape
from typing import Any

from tactemu.base.charts import histogram
from tactemu.base.style import figure, page
from tactemu.judge import smallest_case
from tactemu.judge.outcome import Outcome, titles
from tactemu.judge.report import Report


def html_report(report: Report, command: str = "") -> str:
    """Return a report as an HTML page; ``command`` is the command line that made it."""
    mark = "bad" if report.failed else "odd" if report.interrupted else "good"
    verdict = f'<span class="{mark}">{escape(report.verdict)}</span>'
    parts = [
        f"<h1>{escape(report.device)}: {verdict}</h1>",
        f"<p>Driver: <code>{escape(' '.join(report.command))}</code>. {report.counts}, "
        f"seed {report.seed}. Findings marked <span class=bad></span>fail the run "
        f"({escape(titles(report.fail_on))}); those marked <span class=odd></span>are for "
        "you to weigh.</p>",
        "<h2>Trials</h2>",
        _table(report),
        _columns(report),
        *(_case(outcome) for outcome in report.outcomes if outcome.case or outcome.bad),
        _latency(report, command),
        _skipped(report),
    ]
    return page(f"tactemu judge {report.device}", parts, command=command)


def _columns(report: Report) -> str:
    rows = "".join(
        f"<tr><td><code>{escape(name)}</code></td><td>{escape(holds)}</td></tr>" for name, holds in report.columns
    )
    return f"<h2>Columns of the driver's rows</h2><table class=narrow>{rows}</table>" if rows else ""


def _table(report: Report) -> str:
    numbers = ("faults", "rows", "right", "wrong", "lost", "p50", "p99", "recovery")
    head = f"<tr><th>trial</th><th>verdict</th>{''.join(f'<th class=n>{name}</th>' for name in numbers)}</tr>"
    rows = []
    for outcome in report.outcomes:
        if outcome.skipped:
            continue
        numbers = [outcome.injected, outcome.rows, outcome.right, outcome.wrong, outcome.lost]
        cells = "".join(f'<td class="n">{number or ""}</td>' for number in numbers)
        cells += "".join(
            f'<td class="n">{"" if value is None else f"{value:.1f} ms"}</td>'
            for value in (outcome.p50_ms, outcome.p99_ms)
        )
        recovery = "" if outcome.recovered_s is None else f"{outcome.recovered_s:.2f} s"
        rows.append(
            f'<tr id="{_anchor(outcome)}"><td>{escape(outcome.name)}<br><span class="soft">{escape(outcome.why)}</span>'
            f"</td><td>{_verdict(report, outcome)}</td>{cells}<td class=n>{recovery}</td></tr>"
        )
    return f'<div class="wide"><table>{head}{"".join(rows)}</table></div>'


def _verdict(report: Report, outcome: Outcome) -> str:
    failing = report.failures(outcome)
    if not outcome.findings:
        messages = f'<br><span class="soft">{escape(" | ".join(outcome.said[:2]))}</span>' if outcome.said else ""
        return f'<span class="good">{escape(outcome.verdict)}</span>{messages}'
    words = []
    for finding in outcome.findings:
        known = " (as in the baseline)" if (outcome.name, finding.kind) in report.known else ""
        mark = "bad" if finding.kind in failing else "odd"
        words.append(f'<span class="{mark}">{escape(str(finding))}{known}{escape(outcome.doubt)}</span>')
    words += [f'<span class="soft">{escape(outcome.remark)}</span>'] if outcome.remark else []
    return "<br>".join(words)


def _anchor(outcome: Outcome) -> str:
    return escape(outcome.name.replace(" ", "-"))


def _case(outcome: Outcome) -> str:
    """Return the section of a case: a wrong row beside the truth, and the bytes with the fault marked."""
    parts = [f"<h2>{escape(outcome.name)}</h2>"]
    case = outcome.case
    if case:
        parts.append(f"<p>Smallest case: <code>{escape('; '.join(case['faults'][:8]))}</code></p>")
        for each in case["bytes"][:3]:
            sent, *arrived = (
                escape(frame).replace("[", "<mark>").replace("]", "</mark>")
                for frame in smallest_case.marked(each["before"], each["after"])
            )
            parts.append(f"<pre>sent     {sent}\narrived  {' + '.join(arrived) or 'nothing'}</pre>")
    if outcome.bad:
        parts.append(_beside(outcome.bad[0]))
    if case:
        parts.append(f"<p>For the driver's maintainers:</p><pre>{escape(smallest_case.in_words(case))}</pre>")
    return "".join(parts)


def _beside(bad: dict[str, Any]) -> str:
    names = bad["odd"] or list(bad["row"])
    rows = "".join(
        f"<tr><td><code>{escape(name)}</code></td><td class=n>{bad['row'].get(name, float('nan')):g}</td>"
        f"<td class=n>{bad['truth'].get(name, float('nan')):g}</td></tr>"
        for name in names[:12]
    )
    what = "An old reading, reported again" if bad["old"] else "A wrong reading"
    head = "<tr><th>column</th><th class=n>reported</th><th class=n>true value</th></tr>"
    return f"<p>{what}, beside its nearest sample:</p><table class=narrow>{head}{rows}</table>"


def _latency(report: Report, command: str) -> str:
    """Return the histogram of the latencies in the run without faults."""
    waits = report.outcomes[0].waits_ms if report.outcomes else []
    if len(waits) < 10:
        return ""
    after = "the answer's" if report.asks else "the frame's"
    picture = histogram(waits, ("latency [ms]", "readings"), "histogram of latencies")
    caption = f"From {after} last byte to the driver's row, without faults."
    return f"<h2>Latency of readings</h2>{figure(picture, caption, command=command)}"


def _skipped(report: Report) -> str:
    rows = "".join(
        f"<tr><td>{escape(o.name)}</td><td>{escape(o.skipped)}</td></tr>" for o in report.outcomes if o.skipped
    )
    hint = f"<p>{escape(report.left_for_time)}</p>" if report.left_for_time else ""
    return f"<h2>Trials that were not tried</h2>{hint}<table>{rows}</table>" if rows else ""
