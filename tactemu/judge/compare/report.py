"""The report of a comparison: text, HTML with the look of the judge's card, JSON, and the line of evidence."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

from tactemu.base.style import page
from tactemu.judge.compare.comparison import Comparison
from tactemu.judge.compare.findings import ABOUT
from tactemu.judge.report import written
from tactemu.version import __version__

VERSION = 1
"""The version of the JSON report."""
MAX_ROWS = 400
"""Largest number of channels in the HTML report; the JSON report has all."""


@dataclass
class CompareReport:
    """A comparison with what is told of it."""

    device: str
    title: str
    source: str
    comparison: Comparison
    capture: Path | None = None
    left_out: Sequence[str] = ()
    """The commands that were not asked, because they are not declared safe."""
    interrupted: bool = False
    date: str = ""
    options: dict[str, Any] = field(default_factory=dict)
    """The options of the model."""

    @property
    def verdict(self) -> str:
        """The result in one sentence."""
        found = self.comparison.verdicts
        if found.protocol:
            return f"{len(found.protocol)} difference{'s' * (len(found.protocol) > 1)} of the protocol"
        if not found.agrees:
            return "nothing could be compared"
        return f"the sensor agrees with the model in all {len(found.agrees)} points that were compared"

    def sha256(self) -> str:
        """Return the digest of the capture; empty without one."""
        if self.capture is None or not self.capture.is_file():
            return ""
        digest = hashlib.sha256()
        with self.capture.open("rb") as file:
            while block := file.read(1 << 20):
                digest.update(block)
        return digest.hexdigest()

    def evidence(self) -> str:
        """Return the line for the device's file that says that a real sensor agreed; empty if it did not."""
        comparison = self.comparison
        if not comparison.agrees or self.interrupted:
            return ""
        parts = []
        if comparison.frames:
            parts.append(f"{comparison.frames} frames in {comparison.listened_s:.0f} s")
        if comparison.asked:
            parts.append(f"the answers to {len(comparison.asked)} requests")
        what = f"one sensor agrees with the model: {' and '.join(parts) or 'its frames'}"
        where = f"tactemu {__version__} compare, {self.date}, capture SHA-256 {self.sha256()}"
        return f"measured({'touch'!r}, {what!r}, {where!r}),"

    def as_dict(self) -> dict[str, Any]:
        """Return the report as JSON data."""
        comparison, found = self.comparison, self.comparison.verdicts
        return {
            "version": VERSION, "tactemu": __version__, "device": self.device, "options": self.options,
            "source": self.source, "date": self.date, "interrupted": self.interrupted,
            "capture": {"file": self.capture.name if self.capture else None, "sha256": self.sha256()},
            "listened_s": round(comparison.listened_s, 3), "frames": comparison.frames, "asked": comparison.asked,
            "not_asked": list(self.left_out), "agrees": comparison.agrees,
            "protocol": [{"kind": each.kind, "where": each.where, "text": each.text} for each in found.protocol],
            "agreed": found.agrees, "notes": found.notes, "unjudged": found.unjudged,
            "specimen": comparison.specimen.as_dict(), "evidence": self.evidence(),
        }  # fmt: skip

    def write_json(self, path: Path) -> None:
        """Write the report as JSON.

        Raises:
            TactemuError: the file cannot be written.
        """
        written(path, json.dumps(self.as_dict(), indent=1, default=float) + "\n")

    def write_html(self, path: Path, command: str = "") -> None:
        """Write the report as an HTML page; ``command`` is the command line that made it.

        Raises:
            TactemuError: the file cannot be written.
        """
        written(path, page(f"tactemu compare {self.device}", self._parts(), command=command))

    def _parts(self) -> list[str]:
        found = self.comparison.verdicts
        mark = "bad" if found.protocol else "good" if found.agrees else "odd"
        capture = f", capture <code>{escape(self.capture.name)}</code>" if self.capture else ""
        parts = [
            f'<h1>{escape(self.title)}: <span class="{mark}">{escape(self.verdict)}</span></h1>',
            f"<p>Model <code>{escape(self.device)}</code>, sensor at <code>{escape(self.source)}</code>, "
            f"{escape(self.date)}{capture}. Listened for {self.comparison.listened_s:.1f} s, "
            f"{sum(self.comparison.asked.values())} requests of {len(self.comparison.asked)} kinds."
            f"{' Ended early.' if self.interrupted else ''}</p>",
        ]
        if found.protocol:
            rows = "".join(
                f'<tr><td><span class="bad">{escape(ABOUT[each.kind])}</span></td><td>{escape(each.where)}</td>'
                f"<td>{escape(each.text)}</td></tr>"
                for each in found.protocol
            )
            parts.append(f"<h2>Differences of the protocol</h2><table>{rows}</table>")
        parts += [
            _list("Agrees", found.agrees),
            _list("Settings and states of this specimen", found.notes),
            _list("Not judged", found.unjudged),
            _list("Not asked, as the device file does not declare them safe", self.left_out),
            self._channels(),
        ]
        if evidence := self.evidence():
            parts.append(
                f"<h2>Evidence</h2><p>For <code>facts</code> of the device file, with <code>captured</code> in its "
                f"<code>evidence</code>:</p><pre>{escape(evidence)}</pre>"
            )
        return parts

    def _channels(self) -> str:
        specimen = self.comparison.specimen
        clock = "".join(
            f"<tr><td>clock, by {escape(name)}</td><td class=n>{ppm:+.0f} ppm</td></tr>"
            for name, ppm in specimen.clock_ppm.items()
        )
        rows = "".join(
            f"<tr><td>{escape(each.name)}</td><td class=n>{each.rest:g}</td><td class=n>{each.noise:.3g}</td>"
            f"<td class=n>{each.low:g}</td><td class=n>{each.high:g}</td><td class=n>{each.values}</td></tr>"
            for each in specimen.channels[:MAX_ROWS]
        )
        names = ("rest", "noise", "least", "greatest", "values")
        head = f"<tr><th>channel</th>{''.join(f'<th class=n>{name}</th>' for name in names)}</tr>"
        table = f'<div class="wide"><table>{head}{rows}</table></div>' if rows else ""
        clock = f"<table>{clock}</table>" if clock else ""
        return f"<h2>Numbers of this specimen [counts]</h2>{clock}{table}" if clock or table else ""


def _list(title: str, texts: Sequence[str]) -> str:
    items = "".join(f"<li>{escape(each)}</li>" for each in texts)
    return f"<h2>{escape(title)}</h2><ul>{items}</ul>" if items else ""
