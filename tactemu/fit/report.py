"""The report of a fit: one HTML file that contains its pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from tactemu.base.charts import Curve, curves
from tactemu.base.style import figure
from tactemu.base.style import page as styled_page
from tactemu.fit.estimates import Findings
from tactemu.fit.recording import Recorded
from tactemu.fit.skill import Skill, skill_of


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


def page(device: str, recorded: Sequence[Recorded], found: Findings, scores: Sequence[Score], command: str = "") -> str:
    """Return the complete page; ``command`` is the command line that made it."""
    rows = "".join(
        f"<tr><td>{escape(e.name)}</td><td class=n>{e.value:.5g} {escape(e.unit)}</td>"
        f"<td class=n>{'exact' if not e.error else f'{e.interval[0]:.4g} … {e.interval[1]:.4g}'}</td>"
        f"<td>{escape(e.about)}</td></tr>"
        for e in found.estimates.values()
    )
    files = "".join(
        f"<li>{escape(r.path.name)}: {len(r.readings)} rows of {len(r.names)} channels, "
        f"SHA-256 <code>{r.sha256}</code></li>"
        for r in recorded
    )
    parts = [
        f"<h1>{escape(device)}, fitted</h1><ul>{files}</ul>",
        f"<h2>Found</h2><div class=wide><table><tr><th>parameter<th class=n>value<th class=n>95 % interval<th>meaning"
        f"</tr>{rows}</table></div>",
        _listed("Noticed", found.notes),
        _listed("Not determined by these recordings, and what to record", found.unknown),
        f"<p>Skill of these laws on what was not used for them: {overall(scores)}.</p>" if scores else "",
        *(_scored(score, command) for score in scores),
    ]
    return styled_page(f"{device}, fitted", parts, command=command)


def _listed(title: str, lines: Sequence[str]) -> str:
    return f"<h2>{title}</h2><ul>{''.join(f'<li>{escape(line)}</li>' for line in lines)}</ul>" if lines else ""


def _scored(score: Score, command: str) -> str:
    apart = score.measured - score.fitted
    errors = {"these laws": apart} | {name: score.measured - guess for name, guess in score.guesses.items()}
    rows = "".join(
        f"<tr><td>{escape(name)}</td><td class=n>{np.sqrt(np.mean(each**2)):.4g} N</td></tr>"
        for name, each in errors.items()
    )
    both = curves(
        [Curve("fitted", score.fitted), Curve("measured", score.measured)], ("row", "load [N]"), "measured and fitted"
    )
    left = curves([Curve("", apart)], ("row", "residual [N]"), "residuals")
    return (
        f"<h2>{escape(score.name)}, which was not used</h2>"
        f"<table class=narrow><tr><th>predicted by<th class=n>rms error</tr>{rows}</table>"
        f'<div class="figures">{figure(both, "Measured and fitted load, row by row.", command=command)}'
        f"{figure(left, 'Measured minus fitted.', command=command)}</div>"
    )
