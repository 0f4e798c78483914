"""The settings that `tactemu bench trade` compares: sensor models with their options."""

from __future__ import annotations

from typing import Any

from tactemu.base.option_groups import from_flat
from tactemu.sensors.models import MODELS, model_class
from tactemu.sensors.sensor_model import SensorModel, Setting
from tactemu.tune.trade.cases import TestSkin

GRAZE = 1e-6
"""Radius of probes that measure at the surface only [m]."""


def calibrated_fields(setting: Setting) -> tuple[str, ...]:
    """Return the fields of an observation that get a gain on the calibration cases; none for a model with material."""
    model = model_class(setting.model)
    if model.material:
        return ()
    return tuple(name for quantity in model.layouts for name in _FITTED[quantity])


def make_model(setting: Setting, skin: TestSkin) -> SensorModel:
    """Return the sensor model on a skin, with the skin's material if the model has one."""
    model = model_class(setting.model)
    material = {name: getattr(skin, name) for name in model.material}
    return from_flat(model, {"positions": skin.positions(), **material, **setting.options})


_FITTED = {"touch": (), "depth": ("sink",), "force": ("pressure", "drag"), "displacement": ("sink", "shift")}
"""The fields of an observation whose scale is free, by quantity."""
_GRAZING = {"radius": GRAZE}


def _layer(name: str, **options: Any) -> Setting:
    dtype = options.pop("dtype", "float32")
    return Setting(name=f"L4 {name}", model="elastic_layer_taxel", options=options, dtype=dtype)


def ladder() -> list[Setting]:
    """Return all settings, the cheapest level first; a model without one here is added with its defaults."""
    forced = {"tolerance": 1e-6}
    springs = {**_GRAZING, "normal_damping": 0.0, "twist_scalar": 0.0}
    fitted = {"lambda_d": 3e4, "lambda_s": 3e4, "normal_exponent": 1.0, "n_sample_points": 2000}
    layered = {"compressibility": 0.0, "elastomer_thickness": 4e-3, "n_sample_points": 2000}
    proximity = {"radius": 1e-3, "twist_scalar": 0.0, "shear_coupling": 1.0}
    voxel = {"depth_query": "voxel", "voxel_size": 2.5e-4}
    settings = [
        Setting(name="L0 touch", model="contact_probe", options=_GRAZING),
        _depth("L1 depth", {}),
        _depth("L1 depth, voxel 0.25 mm", voxel),
        _depth("L1 depth, ray", {"depth_query": "ray"}),
        Setting(name="L2 springs", model="kinematic_taxel", options=springs),
        Setting(name="L2 springs, ray", model="kinematic_taxel", options={**springs, "depth_query": "ray"}),
        _points(proximity, 500),
        _points(proximity, 5000),
        _markers("L3 markers, defaults", {"n_sample_points": 500}),
        _markers("L3 markers, fitted", fitted),
        _markers("L3 markers, thickness", layered),
        _layer("2 iterations", iterations=2, **forced),
        _layer("4 iterations", iterations=4, **forced),
        _layer("4 iterations, no friction", iterations=4, friction=0.0, **forced),
        _layer("tolerance 1e-2", iterations=50, tolerance=1e-2),
        _layer("tolerance 1e-4", iterations=50, tolerance=1e-4),
        _layer("tolerance 1e-4, float64", iterations=50, tolerance=1e-4, dtype="float64"),
        _layer("oversampling 2", iterations=50, oversampling=2, tolerance=1e-4),
        _layer("oversampling 4", iterations=50, oversampling=4, tolerance=1e-4),
    ]
    shown = {setting.model for setting in settings}
    return [
        *settings,
        *(Setting(name=f"L{model_class(name).level} {name}", model=name) for name in MODELS if name not in shown),
    ]


def _depth(name: str, query: dict[str, Any]) -> Setting:
    return Setting(name=name, model="contact_depth_probe", options={**_GRAZING, **query})


def _points(options: dict[str, Any], count: int) -> Setting:
    options = {**options, "n_sample_points": count}
    return Setting(name=f"L2 proximity, {count} points", model="proximity_taxel", options=options)


def _markers(name: str, options: dict[str, Any]) -> Setting:
    return Setting(name=name, model="elastomer_taxel", options=options)
