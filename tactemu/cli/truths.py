"""``tactemu truth FILE``: the summary of a truth log, device by device."""

from __future__ import annotations

import json as json_module
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from tactemu.base.statistics import counter_words
from tactemu.cli.fitting import print_fitted
from tactemu.truth import COMMAND, BodyPose, Entry, Injection, Passage, PortEvent, Sample
from tactemu.truth.entries import End, Header
from tactemu.truth.log_reader import records

COUNTED = ("missed", "stretched", "silent", "wire", "device")
"""The counters of a run that cannot be found from the entries of its log."""


def summarise(path: str | Path) -> dict[str, dict[str, Any]]:
    """Return the summary of a log by device; under "" are the live commands, if any.

    It has samples, rate, frames both ways, drops by reason, faults by name, events and largest reading, and the
    counters of the run itself: missed samples, and those of the wire and the firmware.

    Raises:
        TactemuError: the file cannot be read, or is no truth log.
    """
    found: dict[str, _Tally] = {}
    commands: Counter[str] = Counter()
    end = End()
    for entry in records(path):
        if isinstance(entry, Header):
            continue
        if isinstance(entry, End):
            end = entry
        elif isinstance(entry, PortEvent) and entry.is_command:
            commands[verb_of(entry)] += 1
        elif not isinstance(entry, BodyPose):
            found.setdefault(entry.device, _Tally()).add(entry)
    summary: dict[str, dict[str, Any]] = {device: tally.summary() for device, tally in found.items()}
    for told in end.summary:
        counted = {name: told[name] for name in COUNTED if name in told}
        summary[told["skin"]] = summary.get(told["skin"], {}) | counted
    of_all: dict[str, Any] = {"commands": dict(commands)} if commands else {}
    of_all |= {"cut": True} if end.is_cut else {}
    return summary | ({"": of_all} if of_all else {})


def verb_of(command: PortEvent) -> str:
    """Return the name of a command in a log."""
    try:
        return str(json_module.loads(command.what.removeprefix(COMMAND))["verb"])
    except (ValueError, TypeError, KeyError, RecursionError):
        return "unreadable"


class _Tally:
    """The counts of one device's entries."""

    def __init__(self):
        self.sense: str | None = None
        self.passages: Counter[str] = Counter()
        self.drops: Counter[str] = Counter()
        self.injected: Counter[str] = Counter()
        self.events: Counter[str] = Counter()
        self.times: list[int] = []
        self.peak = 0.0
        self.error = 0.0

    def add(self, entry: Entry) -> None:
        if isinstance(entry, Sample):
            self._add_sample(entry)
        elif isinstance(entry, Passage):
            self.passages[entry.kind] += 1
            if entry.kind == "drop":
                self.drops[entry.why] += 1
        elif isinstance(entry, Injection):
            self.injected[entry.what] += 1
        elif isinstance(entry, PortEvent):
            self.events[entry.what] += 1

    def _add_sample(self, sample: Sample) -> None:
        self.sense = sample.sense if self.sense is None else self.sense
        if sample.sense != self.sense:  # other senses have different rates and units
            return
        self.times.append(sample.t_ns)
        ideal, measured = np.asarray(sample.ideal, float), np.asarray(sample.measured, float)
        self.peak = max(self.peak, float(np.abs(ideal).max(initial=0.0)))
        self.error = max(self.error, float(np.abs(measured - ideal).max(initial=0.0)))

    def summary(self) -> dict[str, Any]:
        gaps = np.diff(self.times) if len(self.times) > 1 else np.zeros(1)
        span = self.times[-1] - self.times[0] if self.times else 0
        return {
            "samples": len(self.times),
            "seconds": round(span / 1e9, 6),
            "rate_hz": round((len(self.times) - 1) * 1e9 / span, 3) if span else 0.0,
            "longest_gap_ms": round(float(gaps.max()) / 1e6, 3),
            "frames_to_driver": self.passages["tx"],
            "frames_from_driver": self.passages["rx"],
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
        print(_printable(device) or "all devices")
        for name, value in entry.items():
            if isinstance(value, dict):
                counts = sorted(value.items())
                value = ", ".join(f"{counter_words(_printable(what))} {count}" for what, count in counts) or "none"
            elif isinstance(value, float):
                value = f"{value:.7g}"  # what a float32 holds
            print_fitted(f"  {name.replace('_', ' '):<20} {value}")
    if not summary:
        print(f"{path}: empty")


def _printable(text: str) -> str:
    """Return a text of the file without control characters."""
    return text if text.isprintable() else ascii(text)
