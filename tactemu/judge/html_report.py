"""Reports as one HTML file without scripts and external resources.

Jinja2 would save fifty lines here and in :mod:`tactemu.fit.report`, for two more packages in every installation and
templates that no type checker reads.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np

from tactemu.judge import smallest_case
from tactemu.judge.outcome import ABOUT, Outcome
from tactemu.judge.report import Report

STYLE = """
:root { color-scheme: light dark; --line: #8886; --bad: #c0392b; --odd: #b9770e; --good: #1e8449; --soft: #8882; }
body { font: 15px/1.5 system-ui, sans-serif; max-width: 72rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin-top: 2rem; }
table { border-collapse: collapse; width: 100%; } .wide { overflow-x: auto; }
th, td { text-align: left; padding: .25rem .6rem; border-bottom: 1px solid var(--line); vertical-align: top; }
td.n { text-align: right; font-variant-numeric: tabular-nums; }
.bad { color: var(--bad); font-weight: 600; } .odd { color: var(--odd); } .good { color: var(--good); }
.soft { opacity: .7; } code, pre { font: 13px/1.4 ui-monospace, monospace; }
pre { background: var(--soft); padding: .7rem; overflow-x: auto; white-space: pre-wrap; overflow-wrap: anywhere; }
mark { background: #f5b7b1; color: #641e16; } svg { max-width: 100%; height: auto; } svg text { fill: currentColor; }
@media (prefers-color-scheme: dark) { :root { --bad: #f1948a; --odd: #f8c471; --good: #82e0aa; } }
"""
_BINS = 48


def html_report(report: Report) -> str:
    """Return a report as an HTML page."""
    failed = report.failed
    verdict = (
        f'<span class="bad">{len(failed)} trials fail</span>' if failed else '<span class="good">nothing fails</span>'
    )
    parts = [
        f"<h1>{escape(report.device)}: {verdict}</h1>",
        f"<p>Driver: <code>{escape(' '.join(report.command))}</code>. {len(report.outcomes)} trials in "
        f"{report.seconds:.1f} s, seed {report.seed}. Findings in <span class=bad>red</span> fail the run "
        f"({escape(', '.join(ABOUT[kind] for kind in report.fail_on))}); the others are for you to weigh.</p>",
        _columns(report),
        "<h2>Trials</h2>",
        _table(report),
        *(_case(outcome) for outcome in report.outcomes if outcome.case or outcome.bad),
        _latency(report),
        _skipped(report),
    ]
    return html_page(f"tactemu judge {report.device}", parts)


def html_page(title: str, parts: Sequence[str]) -> str:
    """Return a page with the look of all reports."""
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="icon" href="data:,">'
        f"<title>{escape(title)}</title><style>{STYLE}</style></head><body>\n" + "\n".join(parts) + "\n</body></html>\n"
    )


def _columns(report: Report) -> str:
    rows = "".join(
        f"<tr><td><code>{escape(name)}</code></td><td>{escape(holds)}</td></tr>" for name, holds in report.columns
    )
    return f"<h2>Columns of the driver's rows</h2><table>{rows}</table>" if rows else ""


def _table(report: Report) -> str:
    head = "<tr><th>trial</th><th>verdict</th><th>faults</th><th>rows</th><th>right</th><th>wrong</th><th>lost</th>"
    head += "<th>p50</th><th>p99</th><th>recovery</th></tr>"
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
            became = " + ".join(each["after"]) or "nothing"
            sent, arrived = _marked(each["before"], became)
            parts.append(f"<pre>sent     {sent}\narrived  {arrived}</pre>")
    if outcome.bad:
        parts.append(_beside(outcome.bad[0]))
    if case:
        parts.append(f"<p>For the driver's maintainers:</p><pre>{escape(smallest_case.in_words(case))}</pre>")
    return "".join(parts)


def _marked(before: str, after: str) -> tuple[str, str]:
    """Return the sent and the arrived frame as HTML, byte by byte, with the differing bytes marked."""
    a, b = ([text[k : k + 2] for k in range(0, len(text), 2)] for text in (before, after))
    head = next((k for k, (x, y) in enumerate(zip(a, b)) if x != y), min(len(a), len(b)))
    tail = next(
        (k for k, (x, y) in enumerate(zip(a[head:][::-1], b[head:][::-1])) if x != y), min(len(a), len(b)) - head
    )

    def shown(each: list[str]) -> str:
        end = len(each) - tail
        before, differs, behind = (escape(" ".join(part)) for part in (each[:head], each[head:end], each[end:]))
        return f"{before} <mark>{differs or '∅'}</mark> {behind}"

    return shown(a), shown(b)


def _beside(bad: dict[str, Any]) -> str:
    names = bad["odd"] or list(bad["row"])
    rows = "".join(
        f"<tr><td><code>{escape(name)}</code></td><td class=n>{bad['row'].get(name, float('nan')):g}</td>"
        f"<td class=n>{bad['truth'].get(name, float('nan')):g}</td></tr>"
        for name in names[:12]
    )
    what = "An old reading, handed out again" if bad["old"] else "A wrong reading"
    head = "<tr><th>column</th><th>handed out</th><th>true value</th></tr>"
    return f"<p>{what}, beside its nearest sample:</p><table>{head}{rows}</table>"


def _latency(report: Report) -> str:
    """Return the histogram of the latencies in the run without faults."""
    waits = report.outcomes[0].waits_ms if report.outcomes else []
    if len(waits) < 10:
        return ""
    top = float(np.quantile(waits, 0.995)) * 1.1 or 1.0
    counts, _ = np.histogram(np.minimum(waits, top), bins=_BINS, range=(0.0, top))
    width, height = 720, 160
    bars = "".join(
        f'<rect x="{40 + k * (width - 60) / _BINS:.1f}" y="{height - 30 - (height - 50) * count / counts.max():.1f}" '
        f'width="{(width - 60) / _BINS - 1:.1f}" height="{(height - 50) * count / counts.max():.1f}" fill="#2e86c1"/>'
        for k, count in enumerate(counts.tolist())
    )
    ticks = "".join(
        f'<text x="{40 + share * (width - 60):.0f}" y="{height - 10}" font-size="12" text-anchor="middle">'
        f"{share * top:.1f}</text>"
        for share in (0, 0.25, 0.5, 0.75, 1)
    )
    after = "the answer's" if report.asks else "the frame's"
    return (
        f"<h2>Latency of readings</h2><p>From {after} last byte to the driver's row, without faults [ms].</p>"
        f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="histogram of latencies">{bars}{ticks}</svg>'
    )


def _skipped(report: Report) -> str:
    rows = "".join(
        f"<tr><td>{escape(o.name)}</td><td>{escape(o.skipped)}</td></tr>" for o in report.outcomes if o.skipped
    )
    return f"<h2>Trials that were not tried</h2><table>{rows}</table>" if rows else ""
