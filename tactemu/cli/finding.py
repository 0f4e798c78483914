"""The result of a check of this machine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


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
