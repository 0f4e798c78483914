"""The search for the most accurate setting that keeps a rate on this machine: `tactemu tune`.

Every setting for what the device senses is run on the user's own scene: its readings are compared with the finest
layer solution of the same contacts (:mod:`tactemu.tune.errors`), and its steps and samples are timed
(:mod:`tactemu.tune.cost`). Models with a free strength get one gain, fitted on the first half of the contacts and
evaluated on the second.

The transducers of a skin are the same in all settings: readings are compared before them, and timed behind them.
"""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import cast

import numpy as np

from firmware_protocols import Device
from firmware_protocols.senses import Quantity
from tactemu.base.errors import SceneError, nearest
from tactemu.scene.building import build_scene, build_simulation, make_devices, model_name, transducers_of
from tactemu.scene.file import LoadedScene, load
from tactemu.scene.schema import SkinTable
from tactemu.sensors.models import model_class
from tactemu.sensors.sensor_model import Setting
from tactemu.sensors.signs import require_on_skin
from tactemu.transducers.chain import Chain
from tactemu.tune.choice import Choice, Measured, Pace, pick, report_choice
from tactemu.tune.cost import measure_cost, measure_loop
from tactemu.tune.errors import ERRORS, Comparison, Criterion
from tactemu.tune.settings import scene_with, settings_for, skin_with, truth_settings
from tactemu.tune.writing import write_skin

MOMENTS = 60
"""Number of readings of the scene that are compared."""


def run_tune(
    target: str,
    rate_hz: float,
    *,
    error: str | None = None,
    report: Callable[[str], None] = print,
    seconds: float = 4.0,
    write: bool = True,
    device: str | None = None,
    progress: Callable[[Iterable, str, int], Iterable] | None = None,
) -> list[Choice]:
    """Measure all settings of every skin of a scene, choose one each, and write the choices into the scene file.

    Args:
        target: a scene file, or a device's name (then nothing is written).
        rate_hz: samples per second that each skin must keep.
        error: the measure of errors: a key of :data:`ERRORS`; default: the largest of those that the scene shows.
        report: receives lines of text.
        seconds: how much of the scene is simulated [s]; a body must touch each skin in it.
        write: change the scene file.
        device: the device that runs the kernels, ``cpu`` or ``cuda:0``; default: the scene's.
        progress: ``progress(items, title, total)`` iterates over the items and shows progress.

    Raises:
        SceneError: the scene is invalid, nothing touches a skin, or it does not show the error that is asked for.
    """
    if error is not None and error not in ERRORS:
        raise SceneError(f"--error: expected one of {', '.join(ERRORS)}, got {error!r}{nearest(error, ERRORS)}")
    if not rate_hz > 0:
        raise SceneError(f"--rate: expected a rate in Hz, more than 0, got {rate_hz!r}")
    progress = progress or (lambda items, _title, _total: items)
    loaded = load(target)
    choices = []
    for index, skin in enumerate(loaded.tables.skin):
        tuner = Tuner(loaded, skin, rate_hz, error, seconds, device)
        choice = tuner.choose(progress)
        report_choice(choice, report)
        if write and target.endswith(".toml"):
            changed = skin_with(choice.chosen.setting, skin, choice.chosen.gain)
            dtype = choice.chosen.setting.dtype
            other = dtype if dtype != loaded.tables.scene.dtype else None
            write_skin(Path(target), index, choice.chosen.setting.model, changed.options, other)
            report(f"written into {target}")
        choices.append(choice)
    return choices


class Tuner:
    """A search over the settings of one skin.

    Args:
        loaded: the scene.
        skin: the skin of the scene.
        rate_hz: samples per second of every skin.
        error: the measure of errors: a key of :data:`ERRORS`; None: the largest of those that the scene shows.
        seconds: how much of the scene is simulated [s].
        device: the device that runs the kernels, ``cpu`` or ``cuda:0``; default: the scene's.
    """

    def __init__(
        self,
        loaded: LoadedScene,
        skin: SkinTable,
        rate_hz: float,
        error: str | None,
        seconds: float,
        device: str | None,
    ):
        self.loaded, self.skin, self.error, self.seconds = loaded, skin, error, seconds
        self.pace = Pace(rate_hz, loaded.tables.scene.dt)
        self.compute = device
        self.device = make_devices(loaded)[skin.title]
        self._bare = _without_transducers(loaded, skin)
        self._compared = _device_before_transducers(self.device, skin) if skin.transducer else self.device

    def choose(self, progress) -> Choice:
        """Measure all settings and return the choice."""
        layout = self.device.layout
        side = max(max(patch.rows, patch.cols if patch.rows else 1) for patch in layout.patches)
        settings = settings_for(self._compared.contact[0])
        truth, name = self._truth(side)
        in_contact = np.flatnonzero(np.abs(truth).reshape(MOMENTS, -1).any(axis=1))
        if not len(in_contact):
            raise SceneError(
                f"skin {self.skin.title!r}: nothing touches it in the first {self.seconds:g} s of the scene; give a "
                "body a motion that presses it, or simulate longer with --seconds"
            )
        half = in_contact[: max(len(in_contact) // 2, 1)]
        judged = in_contact[len(half) :] if len(in_contact) > 1 else in_contact
        comparison = Comparison(truth[judged], self._compared)
        criterion = self._criterion(comparison)
        # Costs are measured while the contact changes, because a constant one is not solved again.
        pace = np.linalg.norm(np.diff(truth, axis=0).reshape(MOMENTS - 1, -1), axis=1)
        moment = self.seconds * (int(pace.argmax()) + 1.5) / MOMENTS
        loop = measure_loop(
            scene_with(settings[0], self.loaded, self.skin.title), self.pace.rate_hz, self.compute, moment
        )
        measured = []
        for setting in progress(settings, self.skin.title, len(settings)):
            try:
                readings = self._readings(setting)
                timed = self._build(setting, self.loaded, self.device)
            except SceneError:
                continue  # a layer model refuses a skin that is no flat grid
            gain = _gain(setting, readings[half], truth[half])
            wrong = comparison.errors(gain * readings[judged])
            cost = measure_cost(*timed, self.device.contact[0], moment, loop)
            measured.append(Measured(setting, cost, self.pace, criterion.error(wrong), gain, wrong))
        return pick(self.skin.title, name, self.pace, loop.line_hz, measured, criterion)

    def _criterion(self, comparison: Comparison) -> Criterion:
        """Return the measures that decide: the one that was asked for, else those that the scene shows."""
        if self.error is None:
            return comparison.criterion()
        if self.error not in comparison.measures:
            raise SceneError(
                f"--error {self.error}: skin {self.skin.title!r} has none in the second half of its contacts in the "
                f"first {self.seconds:g} s of the scene; it has {', '.join(comparison.measures)}"
            )
        return Criterion((self.error,))

    def _truth(self, side: int) -> tuple[np.ndarray, str]:
        """Return the readings of the first possible truth and its name: the finest layer; for a skin that is no flat
        grid, or senses depth, the best of the settings in float64."""
        reasons = []
        for setting in truth_settings(self._compared.contact[0], side):
            try:
                return self._readings(setting), setting.name
            except SceneError as error:
                reasons.append(error)
        raise reasons[-1]

    def _build(self, setting: Setting, loaded: LoadedScene, device: Device):
        loaded = scene_with(setting, loaded, self.skin.title)
        scene, skins = build_scene(loaded, make_devices(loaded) | {self.skin.title: device})
        sensors = (part.sensor for part in skins[self.skin.title].parts)
        require_on_skin(sensors, f"skin {self.skin.title!r}: devices measure")
        return build_simulation(scene, loaded, device=self.compute), skins[self.skin.title]

    def _readings(self, setting: Setting) -> np.ndarray:
        """Return what the device, or its first transducer, would sense without imperfections at :data:`MOMENTS` times
        of the scene."""
        sim, sensor = self._build(setting, self._bare, self._compared)
        frames = []
        for _ in range(MOMENTS):
            sim.step(dt=self.seconds / MOMENTS)
            frames.append(np.asarray(sensor.quantity(self._compared.contact[0], ground_truth=True), float))
        return np.stack(frames)


def _without_transducers(loaded: LoadedScene, skin: SkinTable) -> LoadedScene:
    bare = skin.model_copy(update={"transducer": ()})
    skins = tuple(bare if each is skin else each for each in loaded.tables.skin)
    return dataclasses.replace(loaded, tables=loaded.tables.model_copy(update={"skin": skins}))


def _device_before_transducers(device: Device, skin: SkinTable) -> Device:
    """Return a device that senses what the first transducer of the skin takes from its model."""
    model = model_class(model_name(skin, device))
    taken = Chain(f"skin {skin.title!r}", transducers_of(skin), model.layouts).taken.quantity
    if taken == device.contact[0]:
        return device
    bare = copy.copy(device)
    bare.senses = (cast(Quantity, taken),)
    return bare


def _gain(setting: Setting, got: np.ndarray, truth: np.ndarray) -> float:
    """Return the gain that fits readings of a model with a free strength to the truth; 1 for other models."""
    if not model_class(setting.model).strengths or not np.any(got):
        return 1.0
    gain = float(np.vdot(got, truth) / np.vdot(got, got))
    return gain if np.isfinite(gain) and gain > 0 else 1.0
