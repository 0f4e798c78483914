"""Reports of complete runs, for JSON, for the comparison with an earlier run, and for HTML and JUnit."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tactemu.base.errors import TactemuError, reason_of
from tactemu.judge.budget import EVERY_POSITION_BUDGET
from tactemu.judge.outcome import FAILING, Outcome
from tactemu.version import __version__

VERSION = 1


@dataclass
class Report:
    """The report of a run: the driver, the device and the outcomes of the trials."""

    device: str
    command: list[str]
    seed: int = 0
    fail_on: Sequence[str] = FAILING
    columns: list[tuple[str, str]] = field(default_factory=list)
    """Name and content of each column of the driver's rows, as text."""
    asks: bool = False
    outcomes: list[Outcome] = field(default_factory=list)
    left_behind: int = 0
    """Number of processes that had left the driver's session and were ended."""
    seconds: float = 0.0
    known: set[tuple[str, str]] = field(default_factory=set)
    """Findings of the baseline, as trial and kind; they do not fail the run."""
    interrupted: bool = False
    """True if Ctrl-C ended the run before its last trial."""

    def failures(self, outcome: Outcome) -> list[str]:
        """Return the kinds of a trial's findings that fail the run."""
        if outcome.confirmed is False:
            return []
        kinds = [finding.kind for finding in outcome.findings if finding.kind in self.fail_on]
        return [kind for kind in dict.fromkeys(kinds) if (outcome.name, kind) not in self.known]

    @property
    def failed(self) -> list[Outcome]:
        """The outcomes that fail the run."""
        return [outcome for outcome in self.outcomes if self.failures(outcome)]

    @property
    def tried(self) -> list[Outcome]:
        """The outcomes of the trials that were run."""
        return [outcome for outcome in self.outcomes if not outcome.skipped]

    @property
    def is_only_clean(self) -> bool:
        """True if every trial after the one without faults was left out."""
        return len(self.outcomes) > 1 and all(outcome.skipped for outcome in self.outcomes[1:])

    @property
    def verdict(self) -> str:
        """The verdict on the driver, in words."""
        if self.failed:
            return f"{len(self.failed)} of {len(self.tried)} trials fail"
        if self.interrupted:
            return "nothing fails so far: the run was interrupted" if self.tried else "interrupted: nothing was tried"
        if self.is_only_clean:
            about = "raise --budget, or name other trials in --only"
            return f"nothing fails, but only the run without faults was tried: {about}"
        return "nothing fails"

    @property
    def counts(self) -> str:
        """The numbers of trials that were run and that were left out, in words."""
        left_out = len(self.outcomes) - len(self.tried)
        return f"{len(self.tried)} trials in {self.seconds:.1f} s, {left_out} not tried"

    @property
    def left_for_time(self) -> str:
        """The number of trials for which no time was left, in words, with the remedy; empty if there are none."""
        count = sum(outcome.lacks_time for outcome in self.outcomes)
        return f"{count} not tried for lack of time: --budget {EVERY_POSITION_BUDGET} tries all" if count else ""

    @property
    def is_judged(self) -> bool:
        """True if the clean run gave rows that can be judged."""
        return bool(self.outcomes) and not self.outcomes[0].has("silent", "unlearned", "floods", "died")

    @property
    def cases(self) -> list[dict[str, Any]]:
        """The smallest cases."""
        return [outcome.case for outcome in self.outcomes if outcome.case]

    def findings(self) -> list[tuple[str, str]]:
        """Return trial and kind of all findings, without those that a second run did not confirm."""
        return [(o.name, f.kind) for o in self.outcomes if o.confirmed is not False for f in o.findings]

    def as_dict(self) -> dict[str, Any]:
        """Return the report as JSON data."""
        return {
            "version": VERSION, "tactemu": __version__, "device": self.device, "command": self.command,
            "seed": self.seed, "seconds": round(self.seconds, 3), "asks": self.asks,
            "columns": [{"name": name, "holds": holds} for name, holds in self.columns],
            "left_behind": self.left_behind, "failed": [outcome.name for outcome in self.failed],
            "trials": [
                {**outcome.as_dict(), "waits_ms": [round(wait, 4) for wait in outcome.waits_ms[:20_000]],
                 "fails": self.failures(outcome)}
                for outcome in self.outcomes
            ],
        }  # fmt: skip

    def write_json(self, path: Path) -> None:
        """Write the report as JSON, which later runs take as a baseline.

        Raises:
            TactemuError: the file cannot be written.
        """
        written(path, json.dumps(self.as_dict(), indent=1, default=float) + "\n")

    def compare(self, path: Path) -> None:
        """Mark the findings of an earlier report as known, so that they do not fail this run.

        Raises:
            TactemuError: the file cannot be read or is no report.
        """
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
            trials = data["trials"]
            self.known = {(t["name"], f["kind"]) for t in trials if t["confirmed"] is not False for f in t["findings"]}
        except OSError as error:
            raise TactemuError(f"{path}: cannot read the baseline: {reason_of(error)}") from None
        except (ValueError, KeyError, TypeError):
            about = "not a report as JSON: --baseline takes the file that --json of an earlier run has written"
            raise TactemuError(f"{path}: {about}") from None


def written(path: Path, text: str) -> None:
    """Write a text file.

    Raises:
        TactemuError: the file cannot be written.
    """
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise TactemuError(f"{path}: cannot be written: {reason_of(error, path)}") from None
