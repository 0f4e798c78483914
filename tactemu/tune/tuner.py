"""The most accurate setting of the dials that keeps a rate on this machine: `tactemu tune`.

Every setting for what the device senses is run on the user's own scene: its readings are compared with the finest
layer solution of the same contacts, and its steps and reads are timed at the scene's own time step. Models whose
strength is a free number get one gain, fitted on the first half of the contacts and judged on the second.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from tactemu.errors import SceneError
from tactemu.scene.building import build_scene, make_devices
from tactemu.scene.file import LoadedScene, load
from tactemu.scene.schema import Skin
from tactemu.tune.settings import Setting, settings_for, truth_settings
from tactemu.tune.writing import write_skin

ERRORS = {
    "taxels": "RMS over all taxels and moments, relative to the truth's",
    "total": "of the sum over the skin, RMS over moments, relative to the truth's",
    "worst": "largest of any taxel, relative to the largest of the truth",
}
MARGIN = 0.7
"""Part of a sample's time that physics may take: the rest is the device's and the machine's."""
MOMENTS = 60
SAMPLES = 40
ALIKE = 1.05
"""Errors within this factor are alike: the cheaper setting is taken."""


@dataclass(frozen=True)
class Measured:
    """A setting, what it costs and how wrong it is."""

    setting: Setting
    cost_us: float
    """Of one sample: the steps it needs, and the read; median. On a CPU the time of the thread."""
    late_us: float
    """The slowest tenth begins here."""
    error: float
    """By the measure asked for."""
    gain: float
    errors: dict[str, float] = field(default_factory=dict)
    """By every measure of :data:`ERRORS`."""

    def __str__(self) -> str:
        gain = "" if self.gain == 1.0 else f", strength x {self.gain:.3g}"
        late = f" (one in ten over {self.late_us:.0f})" if self.late_us > 1.5 * self.cost_us else ""
        return f"{self.setting.name}: {self.cost_us:.0f} µs a sample{late}, error {100 * self.error:.2g} %{gain}"


@dataclass(frozen=True)
class Choice:
    """What was found for one skin."""

    skin: str
    truth: str
    budget_us: float
    chosen: Measured
    keeps_rate: bool
    cheaper: Measured | None
    """The next best among the faster ones."""
    finer: Measured | None
    """The fastest among the more accurate ones."""
    all: tuple[Measured, ...]


def run_tune(
    target: str,
    rate_hz: float,
    *,
    error: str = "taxels",
    report: Callable[[str], None] = print,
    seconds: float = 4.0,
    write: bool = True,
    compute: str | None = None,
    progress: Callable[[Iterable, str, int], Iterable] | None = None,
) -> list[Choice]:
    """Measure all settings of every skin of a scene, choose, and write the choice into the scene file.

    Args:
        target: a scene file, or a device's name (then nothing is written).
        rate_hz: samples per second that each skin shall keep.
        error: how errors are judged: a key of :data:`ERRORS`.
        report: gets lines of text.
        seconds: how much of the scene is looked at [s]; something must touch in it.
        write: change the scene file.
        compute: ``cpu`` or ``cuda:0``; default: the scene's.
        progress: ``progress(items, title, total)`` iterates and shows how far it is.

    Raises:
        SceneError: the scene is wrong, or nothing touches a skin.
    """
    if error not in ERRORS:
        raise SceneError(f"--error: expected one of {', '.join(ERRORS)}, got {error!r}")
    if not rate_hz > 0:
        raise SceneError(f"--rate: expected a rate in Hz, more than 0, got {rate_hz!r}")
    progress = progress or (lambda items, _title, _total: items)
    loaded = load(target)
    choices = []
    for index, skin in enumerate(loaded.tables.skin):
        tuner = Tuner(loaded, skin, rate_hz * len(loaded.tables.skin), error, seconds, compute)
        choice = tuner.choose(progress)
        _say(choice, error, rate_hz, report)
        if write and target.endswith(".toml"):
            changed = choice.chosen.setting.skin(skin, choice.chosen.gain)
            dtype = choice.chosen.setting.dtype
            other = dtype if dtype != loaded.tables.scene.dtype else None
            write_skin(Path(target), index, choice.chosen.setting.model, changed.options, other)
            report(f"written into {target}")
        choices.append(choice)
    return choices


class Tuner:
    """Measures the settings of one skin. ``rate_hz`` is that of all skins together: one loop serves them in turn."""

    def __init__(
        self, loaded: LoadedScene, skin: Skin, rate_hz: float, error: str, seconds: float, compute: str | None
    ):
        self.loaded, self.skin, self.rate_hz, self.error, self.seconds = loaded, skin, rate_hz, error, seconds
        self.compute = compute or loaded.tables.scene.device
        self.device = make_devices(loaded)[skin.title]

    def choose(self, progress) -> Choice:
        """Run everything and pick."""
        layout = self.device.layout
        side = max(max(patch.rows, patch.cols if patch.rows else 1) for patch in layout.patches)
        settings = settings_for(self.device.contact[0])
        truth, name = self._truth(side)
        touched = np.flatnonzero(np.abs(truth).reshape(MOMENTS, -1).any(axis=1))
        if not len(touched):
            raise SceneError(
                f"skin {self.skin.title!r}: nothing touches it in the first {self.seconds:g} s of the scene; give a "
                "body a motion that presses it, or look longer with --seconds"
            )
        # Costs are those of a contact that changes: a still one is not solved again.
        pace = np.linalg.norm(np.diff(truth, axis=0).reshape(MOMENTS - 1, -1), axis=1)
        moment = self.seconds * (int(pace.argmax()) + 1.5) / MOMENTS
        measured = []
        for setting in progress(settings, self.skin.title, len(settings)):
            try:
                readings = self._readings(setting)
            except SceneError:
                continue  # a layer needs a flat grid
            gain, wrong = self._judge(setting, readings, truth, touched)
            cost, late = self._cost(setting, moment)
            measured.append(Measured(setting, cost, late, wrong[self.error], gain, wrong))
        return _pick(self.skin.title, name, 1e6 * MARGIN / self.rate_hz, measured)

    def _truth(self, side: int) -> tuple[np.ndarray, str]:
        """The finest layer; where the skin is no flat grid, or senses depth, the best of the settings in float64."""
        reasons = []
        for setting in truth_settings(self.device.contact[0], side):
            try:
                return self._readings(setting), setting.name
            except SceneError as error:
                reasons.append(error)
        raise reasons[-1]

    def _build(self, setting: Setting):
        loaded = setting.scene(self.loaded, self.skin.title)
        scene, skins = build_scene(loaded, {self.skin.title: self.device} | make_devices(loaded))
        world = loaded.tables.scene
        sim = scene.build(device=self.compute, seed=world.seed, dtype=world.dtype)
        return sim, skins[self.skin.title]

    def _readings(self, setting: Setting) -> np.ndarray:
        """What the device would sense, without imperfections, at moments spread over the scene."""
        sim, sensor = self._build(setting)
        frames = []
        for _ in range(MOMENTS):
            sim.step(self.seconds / MOMENTS)
            frames.append(np.asarray(sensor.quantity(self.device.contact[0], ground_truth=True), float))
        return np.stack(frames)

    def _judge(self, setting: Setting, got: np.ndarray, truth: np.ndarray, touched: np.ndarray) -> tuple[float, dict]:
        """Gain and errors."""
        half = touched[: max(len(touched) // 2, 1)]
        judged = touched[len(half) :] if len(touched) > 1 else touched
        gain = 1.0
        if setting.strengths and np.any(got[half]):
            gain = float(np.vdot(got[half], truth[half]) / np.vdot(got[half], got[half]))
            gain = gain if np.isfinite(gain) and gain > 0 else 1.0
        return gain, {kind: _error(kind, gain * got[judged], truth[judged]) for kind in ERRORS}

    def _cost(self, setting: Setting, moment: float) -> tuple[float, float]:
        """Time of a sample in contact [µs]: the steps up to it, and the reading of both branches."""
        sim, sensor = self._build(setting)
        period = round(1e9 / self.rate_hz * len(self.loaded.tables.skin))
        sim.step(max(moment - 0.5 * SAMPLES * period * 1e-9, 0.0))
        # On a CPU the thread's own time: what else the machine does at the moment is no property of a setting.
        clock = time.thread_time if sim.device.is_cpu else time.perf_counter
        times = []
        due = sim.time_ns
        for _ in range(SAMPLES):
            due += period
            start = clock()
            sim.advance_to(due)
            sensor.quantity(self.device.contact[0], ground_truth=True)
            sensor.quantity(self.device.contact[0])
            times.append(1e6 * (clock() - start))
        return median(times), float(np.percentile(times, 90))


def _error(kind: str, got: np.ndarray, truth: np.ndarray) -> float:
    if kind == "worst":
        return float(np.abs(got - truth).max() / np.abs(truth).max())
    if kind == "total":
        got, truth = got.sum(axis=1), truth.sum(axis=1)
    size = float(np.linalg.norm(truth))
    return float(np.linalg.norm(got - truth)) / size if size > 0 else 0.0


def _pick(skin: str, truth: str, budget_us: float, measured: list[Measured]) -> Choice:
    fitting = [entry for entry in measured if entry.late_us <= budget_us]
    if fitting:
        least = min(entry.error for entry in fitting)
        chosen = min((e for e in fitting if e.error <= ALIKE * least), key=lambda e: e.cost_us)
    else:
        chosen = min(measured, key=lambda e: e.cost_us)
    faster = [e for e in measured if e.cost_us < chosen.cost_us and e is not chosen]
    better = [e for e in measured if e.error * ALIKE < chosen.error]
    return Choice(
        skin=skin,
        truth=truth,
        budget_us=budget_us,
        chosen=chosen,
        keeps_rate=bool(fitting),
        cheaper=min(faster, key=lambda e: e.error, default=None),
        finer=min(better, key=lambda e: e.cost_us, default=None),
        all=tuple(sorted(measured, key=lambda e: e.cost_us)),
    )


def _say(choice: Choice, error: str, rate_hz: float, report: Callable[[str], None]) -> None:
    report(f"skin {choice.skin}: {choice.budget_us:.0f} µs for a sample at {rate_hz:g} Hz ({MARGIN:.0%} of its time)")
    report(f"  error: {ERRORS[error]}; truth: {choice.truth}")
    for entry in choice.all:
        report(f"  {'>' if entry is choice.chosen else ' '} {entry}")
    if choice.keeps_rate:
        report(f"chosen: {choice.chosen}")
    else:
        report(f"no setting keeps {rate_hz:g} Hz here; the fastest is {choice.chosen}. Lower the rate, or raise dt")
    if choice.cheaper is not None:
        report(f"if that is too slow: {choice.cheaper}")
    if choice.finer is not None:
        report(f"more accurate, too slow at this rate: {choice.finer}")


def as_dict(choice: Choice) -> dict[str, Any]:
    """For JSON."""

    def entry(measured: Measured | None) -> dict[str, Any] | None:
        if measured is None:
            return None
        setting = measured.setting
        return {
            "name": setting.name, "model": setting.model, "dials": setting.dials, "dtype": setting.dtype,
            "cost_us": measured.cost_us, "late_us": measured.late_us, "gain": measured.gain,
            "error": measured.error, "errors": measured.errors,
        }  # fmt: skip

    return {
        "skin": choice.skin, "truth": choice.truth, "budget_us": choice.budget_us, "keeps_rate": choice.keeps_rate,
        "chosen": entry(choice.chosen), "cheaper": entry(choice.cheaper), "finer": entry(choice.finer),
        "all": [entry(measured) for measured in choice.all],
    }  # fmt: skip
