"""The settings that `tactemu tune` chooses from: the trials that the models offer for the quantity of a device."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

from tactemu.scene.file import LoadedScene
from tactemu.scene.schema import SkinTable
from tactemu.sensors.models import model_class, models_for
from tactemu.sensors.sensor_model import SensorModel, Trial


@dataclass(frozen=True)
class Setting:
    """A sensor model with the options that the choice decides (dials)."""

    name: str
    model: str
    """The name of the sensor model, as in scene files."""
    dials: dict[str, Any] = field(default_factory=dict)
    dtype: str = "float32"

    @property
    def strengths(self) -> tuple[str, ...]:
        """The options that scale the model's reading; a gain is multiplied into them."""
        return model_class(self.model).strengths

    def skin(self, skin: SkinTable, gain: float = 1.0) -> SkinTable:
        """Return the skin with this model: common options are kept, dials are set, strengths take the gain."""
        model = model_class(self.model)
        known = {field.name: field for field in dataclasses.fields(model) if field.init}
        shared = {field.name for field in dataclasses.fields(SensorModel)} - {"contact_depth_query", "voxel_size"}
        kept = set(known) - _dials_of(model) if skin.model_ == self.model else shared
        options = {name: value for name, value in skin.options.items() if name in kept} | self.dials
        if gain != 1.0:
            for name in self.strengths:
                options[name] = float(f"{gain * options.get(name, known[name].default):.4g}")
        return skin.model_copy(update={"model_": self.model, "options": options})

    def scene(self, loaded: LoadedScene, title: str) -> LoadedScene:
        """Return the scene with this setting in the skin called ``title``."""
        tables = loaded.tables
        skins = tuple(self.skin(skin) if skin.title == title else skin for skin in tables.skin)
        world = tables.scene.model_copy(update={"dtype": self.dtype})
        return dataclasses.replace(loaded, tables=tables.model_copy(update={"skin": skins, "scene": world}))


def _dials_of(model: type[SensorModel]) -> set[str]:
    """Return the options that a setting decides; the user's values of them are replaced."""
    tried = {option for quantity in model.layouts for trial in model.trials(quantity) for option in trial.options}
    return tried | {"contact_depth_query", "voxel_size"}


def settings_for(senses: str) -> list[Setting]:
    """Return all settings for a device that senses this quantity, the cheapest model first."""
    return [
        _setting(f"{name}, {trial.name}", name, trial)
        for name, model in models_for(senses).items()
        for trial in model.trials(senses)
    ]


def truth_settings(senses: str, side: int) -> list[Setting]:
    """Return the candidates for the truth on a skin of ``side`` taxels along its longer side, the best first: models
    that are a reference, then every setting in float64."""
    finest = [(name, model.finest(side)) for name, model in models_for(senses).items()]
    references = [_setting(trial.name, name, trial) for name, trial in finest if trial is not None]
    in_double = [dataclasses.replace(setting, dtype="float64") for setting in settings_for(senses)]
    return [*reversed(references), *reversed(in_double)]


def _setting(name: str, model: str, trial: Trial) -> Setting:
    return Setting(name, model, dict(trial.options), trial.dtype)
