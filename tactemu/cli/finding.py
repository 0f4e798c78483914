"""The results of checks of this machine, and their output."""

from __future__ import annotations

import json as json_module
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field

from tactemu.cli.fitting import print_fitted


@dataclass(frozen=True)
class Finding:
    """The result of a check."""

    name: str
    there: bool
    says: str
    """The facility found, or why it is missing."""
    helps: str = ""
    """The command that installs it, or another remedy."""
    values: Mapping[str, float] = field(default_factory=dict)
    """The measured values by name and unit: ``{"p50_ms": 0.7}``."""


def tell(findings: Iterable[Finding], *, json: bool = False) -> list[Finding]:
    """Print findings, each as soon as it is there, or all as JSON; return them."""
    found = []
    for each in findings:
        found.append(each)
        if not json:
            print_fitted(*_lines(each))
    if json:
        print(json_module.dumps({each.name: asdict(each) for each in found}))
    return found


def _lines(finding: Finding) -> list[str]:
    lines = [f"{'yes' if finding.there else 'no':3}  {finding.name:10}  {finding.says}"]
    return [*lines, f"{'':17}{finding.helps}"] if finding.helps else lines
