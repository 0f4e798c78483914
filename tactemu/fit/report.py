"""The report of a fit: one HTML file that contains its pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from tactemu.fit.estimates import Findings
from tactemu.fit.recording import Recorded
from tactemu.fit.skill import Skill, skill_of

MAX_POINTS = 1500
"""Maximum number of points of a curve in a picture."""
STYLE = """body{font:16px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;
color:#1b1b1b;background:#fff}
table{border-collapse:collapse}td,th{text-align:left;padding:.2rem 1rem .2rem 0;border-bottom:1px solid #ddd}
svg{width:100%;height:auto}code{overflow-wrap:anywhere}"""


@dataclass(frozen=True)
class Score:
    """The predictions [N] of laws and simple guesses for a recording, or a part of one, that was not fitted."""

    name: str
    load: np.ndarray
    measured: np.ndarray
    fitted: np.ndarray
    guesses: Mapping[str, np.ndarray]
    """A straight line, and the other recording's reading at the same load, at first loading."""

    @property
    def skill(self) -> Skill:
        """The error of the laws beside that of the best guess."""
        return overall([self])


def overall(scores: Sequence[Score]) -> Skill:
    """Return the skill of the laws on all recordings that were predicted."""
    return skill_of(
        [each.measured - each.fitted for each in scores],
        [{name: each.measured - guess for name, guess in each.guesses.items()} for each in scores],
    )


def page(device: str, recorded: Sequence[Recorded], found: Findings, scores: Sequence[Score]) -> str:
    """Return the complete page."""
    rows = "".join(
        f"<tr><td>{escape(e.name)}</td><td>{e.value:.5g} {escape(e.unit)}</td>"
        f"<td>{'exact' if not e.error else f'{e.interval[0]:.4g} … {e.interval[1]:.4g}'}</td>"
        f"<td>{escape(e.about)}</td></tr>"
        for e in found.estimates.values()
    )
    files = "".join(
        f"<li>{escape(r.path.name)}: {len(r.readings)} rows of {len(r.names)} channels, "
        f"SHA-256 <code>{r.sha256}</code></li>"
        for r in recorded
    )
    parts = [
        f"<!doctype html><html lang=en><meta charset=utf-8><meta name=viewport content='width=device-width'>"
        f"<title>{escape(device)}, fitted</title><style>{STYLE}</style>",
        f"<h1>{escape(device)}, fitted</h1><ul>{files}</ul>",
        f"<h2>Found</h2><table><tr><th>parameter<th>value<th>95 % interval<th></tr>{rows}</table>",
        _listed("Noticed", found.notes),
        _listed("Not determined by these recordings, and what to record", found.unknown),
        f"<p>Skill of these laws on what was not used for them: {overall(scores)}.</p>" if scores else "",
        *(_scored(score) for score in scores),
    ]
    return "\n".join(part for part in parts if part) + "</html>\n"


def _listed(title: str, lines: Sequence[str]) -> str:
    return f"<h2>{title}</h2><ul>{''.join(f'<li>{escape(line)}</li>' for line in lines)}</ul>" if lines else ""


def _scored(score: Score) -> str:
    apart = score.measured - score.fitted
    errors = {"these laws": apart} | {name: score.measured - guess for name, guess in score.guesses.items()}
    rows = "".join(
        f"<tr><td>{escape(name)}</td><td>{np.sqrt(np.mean(each**2)):.4g} N</td></tr>" for name, each in errors.items()
    )
    curves = _picture([("measured", score.measured, "#888"), ("fitted", score.fitted, "#c33")])
    return (
        f"<h2>{escape(score.name)}, which was not used</h2><table><tr><th>predicted by<th>rms error</tr>{rows}</table>"
        f"<h3>Measured and fitted [N], row by row</h3>{curves}<h3>Residuals [N]</h3>{_picture([('', apart, '#36c')])}"
    )


def _picture(curves: Sequence[tuple[str, np.ndarray, str]]) -> str:
    low = min(float(np.min(values)) for _, values, _ in curves)
    high = max(float(np.max(values)) for _, values, _ in curves)
    span = (high - low) or 1.0
    drawn = []
    for k, (name, values, colour) in enumerate(curves):
        at = np.unique(np.linspace(0, len(values) - 1, MAX_POINTS).astype(int))
        x, y = 60 + 830 * at / max(len(values) - 1, 1), 250 - 230 * (values[at] - low) / span
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y))
        drawn.append(f"<polyline fill=none stroke='{colour}' stroke-width=1.2 points='{points}'/>")
        drawn.append(f"<text x={70 + 110 * k} y=16 fill='{colour}' font-size=14>{escape(name)}</text>")
    marks = "".join(
        f"<text x=55 y={250 - 230 * share:.0f} text-anchor=end font-size=13>{low + share * span:.3g}</text>"
        for share in (0.0, 0.5, 1.0)
    )
    return f"<svg viewBox='0 0 900 270' role=img aria-label='curves'>{marks}{''.join(drawn)}</svg>"
