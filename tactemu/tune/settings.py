"""The settings that `tactemu tune` chooses from: the trials that the models offer for the quantity of a device."""

from __future__ import annotations

import dataclasses

from tactemu.base.option_groups import defaults
from tactemu.scene.file import LoadedScene
from tactemu.scene.schema import SkinTable
from tactemu.sensors.models import model_class, models_for
from tactemu.sensors.sensor_model import SensorModel, Setting


def skin_with(setting: Setting, skin: SkinTable, gain: float = 1.0) -> SkinTable:
    """Return the skin with the model of a setting: common options are kept, those of the setting are set, and the
    options that scale the model's reading take the gain."""
    model = model_class(setting.model)
    known = defaults(model)
    shared = set(defaults(SensorModel)) - {"depth_query", "voxel_size"}
    kept = set(known) - _decided_options(model) if skin.model_ == setting.model else shared
    options = {name: value for name, value in skin.options.items() if name in kept} | dict(setting.options)
    if gain != 1.0:
        for name in model.strengths:
            options[name] = float(f"{gain * options.get(name, known[name]):.4g}")
    return skin.model_copy(update={"model_": setting.model, "options": options})


def scene_with(setting: Setting, loaded: LoadedScene, title: str) -> LoadedScene:
    """Return the scene with a setting in the skin called ``title``."""
    tables = loaded.tables
    skins = tuple(skin_with(setting, skin) if skin.title == title else skin for skin in tables.skin)
    world = tables.scene.model_copy(update={"dtype": setting.dtype})
    return dataclasses.replace(loaded, tables=tables.model_copy(update={"skin": skins, "scene": world}))


def _decided_options(model: type[SensorModel]) -> set[str]:
    """Return the options that a setting decides; the user's values of them are replaced."""
    tried = {option for quantity in model.layouts for trial in model.trials(quantity) for option in trial.options}
    return tried | {"depth_query", "voxel_size"}


def settings_for(senses: str) -> list[Setting]:
    """Return all settings for a device that senses this quantity, the cheapest model first."""
    return [
        dataclasses.replace(trial, name=f"{name}, {trial.name}", model=name)
        for name, model in models_for(senses).items()
        for trial in model.trials(senses)
    ]


def truth_settings(senses: str, side: int) -> list[Setting]:
    """Return the candidates for the truth on a skin of ``side`` taxels along its longer side, the best first: models
    that are a reference, then every setting in float64."""
    finest = [(name, model.finest(side)) for name, model in models_for(senses).items()]
    references = [dataclasses.replace(setting, model=name) for name, setting in finest if setting is not None]
    in_double = [dataclasses.replace(setting, dtype="float64") for setting in settings_for(senses)]
    return [*reversed(references), *reversed(in_double)]
