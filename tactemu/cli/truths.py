"""``tactemu truth FILE``: what a truth log holds, device by device."""

from __future__ import annotations

import json as json_module
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from tactemu.errors import TactemuError
from tactemu.truth import read


def summarise(path: str | Path) -> dict[str, dict[str, Any]]:
    """Per device: samples, rate, frames both ways, drops by reason, faults by name, events, largest reading.

    Raises:
        TactemuError: the file cannot be read, or is no truth log.
    """
    found: dict[str, _Tally] = {}
    try:
        for number, entry in enumerate(read(path), 1):
            try:
                found.setdefault(str(entry["device"]), _Tally()).add(entry)
            except (KeyError, TypeError, ValueError) as error:
                raise TactemuError(f"{path}:{number}: not an entry of a truth log: {error!r}") from None
    except OSError as error:
        raise TactemuError(f"{path}: cannot read the truth log: {error.strerror}") from None
    except UnicodeDecodeError:
        raise TactemuError(f"{path}: not a truth log: it is no text") from None
    except ValueError as error:
        raise TactemuError(str(error)) from None
    return {device: tally.summary() for device, tally in found.items()}


class _Tally:
    """The entries of one device, counted."""

    def __init__(self):
        self.kinds: Counter[str] = Counter()
        self.drops: Counter[str] = Counter()
        self.injected: Counter[str] = Counter()
        self.events: Counter[str] = Counter()
        self.times: list[int] = []
        self.peak = 0.0
        self.error = 0.0

    def add(self, entry: dict[str, Any]) -> None:
        kind = entry["kind"]
        self.kinds[kind] += 1
        if kind == "sample":
            self.times.append(entry["t_ns"])
            ideal, measured = np.array(entry["ideal"], float), np.array(entry["measured"], float)
            self.peak = max(self.peak, float(np.abs(ideal).max(initial=0.0)))
            self.error = max(self.error, float(np.abs(measured - ideal).max(initial=0.0)))
        elif kind == "drop":
            self.drops[entry["why"]] += 1
        elif kind == "inject":
            self.injected[entry["what"]] += 1
        elif kind == "event":
            self.events[entry["what"]] += 1

    def summary(self) -> dict[str, Any]:
        gaps = np.diff(self.times) if len(self.times) > 1 else np.zeros(1)
        span = self.times[-1] - self.times[0] if self.times else 0
        return {
            "samples": self.kinds["sample"],
            "seconds": round(span / 1e9, 6),
            "rate_hz": round((len(self.times) - 1) * 1e9 / span, 3) if span else 0.0,
            "longest_gap_ms": round(float(gaps.max()) / 1e6, 3),
            "frames_to_driver": self.kinds["tx"],
            "frames_from_driver": self.kinds["rx"],
            "dropped": dict(self.drops),
            "injected": dict(self.injected),
            "events": dict(self.events),
            "largest_ideal": self.peak,
            "largest_error": self.error,
        }


def print_summary(path: Path, *, json: bool = False) -> None:
    """Print :func:`summarise`."""
    summary = summarise(path)
    if json:
        print(json_module.dumps(summary))
        return
    for device, entry in summary.items():
        print(device)
        for name, value in entry.items():
            if isinstance(value, dict):
                value = ", ".join(f"{what} {count}" for what, count in sorted(value.items())) or "none"
            print(f"  {name.replace('_', ' '):<20} {value}")
    if not summary:
        print(f"{path}: empty")
