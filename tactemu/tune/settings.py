"""The settings that `tactemu tune` chooses from: sensor models with their dials, for what a device senses."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

import tactemu
from tactemu.physics.sensor import SensorModel
from tactemu.scene.file import LoadedScene
from tactemu.scene.schema import MODELS, Skin

LAYER = "elastic_layer_taxel"
MATERIAL = ("young_modulus", "poisson_ratio", "thickness", "friction", "look_depth", "coupled")

STRENGTHS = {
    # Options that scale a model's reading: a gain is written into them, not beside them.
    "kinematic_taxel": ("normal_stiffness", "normal_damping", "shear_scalar", "twist_scalar"),
    "proximity_taxel": ("stiffness", "shear_coupling", "twist_scalar"),
    "elastomer_taxel": ("dilate_scale", "shear_scale"),
}


DIAL_OF_STAGE = {
    # Last words of a stage's name in the plan: which dial of the skin makes it cheaper.
    "overlap": "lower `oversampling`",
    "pressure": "lower `iterations` or `oversampling`, or raise `tolerance`",
    "friction": "lower `iterations` or `oversampling`, raise `tolerance`, or set `friction = 0`",
    "surface": "set `displacement = false`, or lower `oversampling`",
    "taxels": "lower `oversampling`",
    "points": "lower `n_sample_points`",
    "near points": "lower `n_sample_points`",
    "anchors": "lower `n_sample_points`",
    "shear": "lower `n_sample_points`",
    "contact depth": 'set `contact_depth_query = "sdf"`',
    "springs": 'set `contact_depth_query = "sdf"`',
}


def dial_of(stage: str) -> str:
    """What to turn so that a stage of a plan costs less; empty where nothing but another model helps."""
    return DIAL_OF_STAGE.get(stage.rpartition(": ")[2], "")


@dataclass(frozen=True)
class Setting:
    """One choice of the dials."""

    name: str
    model: str
    """As in scene files."""
    dials: dict[str, Any] = field(default_factory=dict)
    dtype: str = "float32"

    def skin(self, skin: Skin, gain: float = 1.0) -> Skin:
        """The skin with this model: options that the model has stay, dials are set, strengths get the gain."""
        model = getattr(tactemu, MODELS[self.model])
        known = {field.name: field for field in dataclasses.fields(model) if field.init}
        shared = {field.name for field in dataclasses.fields(SensorModel)}
        same = skin.model_ == self.model
        options = {name: value for name, value in skin.options.items() if name in known and (same or name in shared)}
        options.pop("contact_depth_query", None)
        options.pop("voxel_size", None)
        options |= self.dials
        if gain != 1.0:
            for name in STRENGTHS.get(self.model, ()):
                options[name] = float(f"{gain * options.get(name, known[name].default):.4g}")
        return skin.model_copy(update={"model_": self.model, "options": options})

    def scene(self, loaded: LoadedScene, title: str) -> LoadedScene:
        """The scene with this setting in the skin called ``title``."""
        tables = loaded.tables
        skins = tuple(self.skin(skin) if skin.title == title else skin for skin in tables.skin)
        world = tables.scene.model_copy(update={"dtype": self.dtype})
        return dataclasses.replace(loaded, tables=tables.model_copy(update={"skin": skins, "scene": world}))


def truth_setting(skin: Skin, side: int) -> Setting:
    """The finest solution that a skin of ``side`` taxels along its longer side is worth: up to 256 cells."""
    split = max(1, min(8, 256 // max(side, 1)))
    dials = {"iterations": 200, "tolerance": 1e-5, "oversampling": split, **material(skin)}
    return Setting(f"layer, {split} x {split} cells per taxel, residual 1e-5", LAYER, dials)


def material(skin: Skin) -> dict[str, Any]:
    """The layer that a skin is made of: its own options, where its model is the layer."""
    return {name: skin.options[name] for name in MATERIAL if skin.model_ == LAYER and name in skin.options}


def settings_for(senses: str, skin: Skin) -> list[Setting]:
    """All settings for a device that senses this quantity."""
    queries = {"nearest surface": {}, "voxels": {"contact_depth_query": "voxel"}}
    queries["along the normal"] = {"contact_depth_query": "ray"}
    found: list[Setting] = []
    if senses in ("touch", "depth"):
        model = {"touch": "contact_probe", "depth": "contact_depth_probe"}[senses]
        found += [Setting(f"{model}, {name}", model, dials) for name, dials in queries.items()]
    if senses == "force":
        found += [Setting(f"kinematic_taxel, {name}", "kinematic_taxel", dials) for name, dials in queries.items()]
        found += _points("proximity_taxel", (500, 5000))
    if senses == "displacement":
        found += _points("elastomer_taxel", (500, 2000))
    if senses != "depth":
        found += _layers(skin, moved=senses == "displacement")
    return found


def _points(model: str, counts: tuple[int, ...]) -> list[Setting]:
    return [Setting(f"{model}, {count} points", model, {"n_sample_points": count}) for count in counts]


def _layers(skin: Skin, *, moved: bool) -> list[Setting]:
    common = {**material(skin), "displacement": moved}
    dials = [
        ("2 iterations", {"iterations": 2, "tolerance": 1e-3}),
        ("tolerance 1e-2", {"iterations": 16, "tolerance": 1e-2}),
        ("tolerance 1e-4", {"iterations": 32, "tolerance": 1e-4}),
        ("oversampling 2", {"iterations": 32, "tolerance": 1e-3, "oversampling": 2}),
        ("oversampling 4", {"iterations": 32, "tolerance": 1e-3, "oversampling": 4}),
    ]
    found = [Setting(f"{LAYER}, {name}", LAYER, {**common, **values}) for name, values in dials]
    rigid = Setting(f"{LAYER}, tolerance 1e-4, float64", LAYER, {**common, **dials[2][1]}, dtype="float64")
    return [*found, rigid]
