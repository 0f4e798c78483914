"""The truth log: true readings, measured readings, frames and injected faults of a run.

:class:`Truth` keeps the latest in memory and, if asked, writes everything to a file, in one of two formats by its
suffix: ``.mcap``, the container format of robotics, or ``.jsonl``, a JSON object per line (``docs/truth-log.md``).
Recordings have the same two formats.
"""

from tactemu.truth.entries import COMMAND, BodyPose, Entry, Injection, Passage, PortEvent, Sample
from tactemu.truth.log_reader import Log, Poses, Samples, SkinLog, entries, read, read_log
from tactemu.truth.truth import Truth

__all__ = [
    "COMMAND",
    "BodyPose",
    "Entry",
    "Injection",
    "Log",
    "Passage",
    "PortEvent",
    "Poses",
    "Sample",
    "Samples",
    "SkinLog",
    "Truth",
    "entries",
    "read",
    "read_log",
]
