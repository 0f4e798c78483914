"""The trade-off on a user's own scene: every setting of `tactemu tune`, with all its errors and its cost."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from tactemu.scene.file import load
from tactemu.tune.choice import Choice, as_dict
from tactemu.tune.errors import ERRORS
from tactemu.tune.tuner import Tuner

RATE_HZ = 100.0
"""The rate of the samples whose cost is measured, simulation steps included."""


def trade_of_scene(report: Callable[[str], None], scene: str, folder: Path, device: str, progress) -> dict:
    """Measure all settings of every skin of a scene, and write ``trade.json`` and ``trade.md``."""
    loaded = load(scene)
    choices = []
    for skin in loaded.tables.skin:
        tuner = Tuner(loaded, skin, RATE_HZ, None, 4.0, device)
        choices.append(tuner.choose(progress))
    text = "\n".join(_table(choice) for choice in choices)
    report(text)
    (folder / "trade.md").write_text(text, encoding="utf-8")
    found = {"scene": scene, "rate_hz": RATE_HZ, "skins": [as_dict(choice) for choice in choices]}
    (folder / "trade.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return found


def _table(choice: Choice) -> str:
    lines = [f"Skin {choice.skin}, a sample at {RATE_HZ:g} Hz. Truth: {choice.truth}.", ""]
    lines += [f"- error of {name}: {about}" for name, about in ERRORS.items()]
    lines += ["", "| setting | µs a sample | " + " | ".join(ERRORS) + " |", "|---|---|" + "---|" * len(ERRORS)]
    for entry in choice.all:
        shown = {name: f"{100 * error:.2g} %" for name, error in entry.errors.items()}
        errors = " | ".join(shown.get(name, "") for name in ERRORS)
        lines.append(f"| {entry.setting.name} | {entry.cost_us:.0f} | {errors} |")
    return "\n".join(lines) + "\n"
