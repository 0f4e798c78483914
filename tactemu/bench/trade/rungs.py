"""The rungs of the ladder that `tactemu bench trade` compares: sensor models with their dials."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import tactemu as tt
from tactemu.bench.trade.cases import TestSkin

GRAZE = 1e-6
"""Radius of probes that shall feel no farther than the surface [m]."""


@dataclass(frozen=True, kw_only=True)
class Rung:
    """A sensor model and its dials."""

    name: str
    level: int
    model: str
    """Class in :mod:`tactemu`."""
    options: dict[str, Any] = field(default_factory=dict)
    dtype: str = "float32"
    calibrated: tuple[str, ...] = ()
    """Quantities that get a gain on the calibration cases."""

    def make(self, skin: TestSkin) -> Any:
        """The sensor model on a skin."""
        layer = skin.layer if self.model == "ElasticLayerTaxel" else {}
        return getattr(tt, self.model)(probe_local_pos=skin.positions(), **{**layer, **self.options})


_GRAZING = {"probe_radius": GRAZE}
_FORCE, _MOTION = ("pressure", "drag"), ("sink", "shift")


def _layer(name: str, **options: Any) -> Rung:
    dtype = options.pop("dtype", "float32")
    return Rung(name=f"L4 {name}", level=4, model="ElasticLayerTaxel", options=options, dtype=dtype)


def ladder() -> list[Rung]:
    """All rungs, cheapest level first."""
    forced = {"tolerance": 1e-6}
    springs = {**_GRAZING, "normal_damping": 0.0, "forces_on_skin": True, "twist_scalar": 0.0}
    fitted = {"lambda_d": 3e4, "lambda_s": 3e4, "normal_exponent": 1.0, "n_sample_points": 2000}
    layered = {"compressibility": 0.0, "elastomer_thickness": 4e-3, "n_sample_points": 2000}
    proximity = {"probe_radius": 1e-3, "forces_on_skin": True, "twist_scalar": 0.0, "shear_coupling": 1.0}
    voxel = {"contact_depth_query": "voxel", "voxel_size": 2.5e-4}
    return [
        Rung(name="L0 touch", level=0, model="ContactProbe", options=_GRAZING),
        _depth("L1 depth", {}),
        _depth("L1 depth, voxel 0.25 mm", voxel),
        _depth("L1 depth, ray", {"contact_depth_query": "ray"}),
        Rung(name="L2 springs", level=2, model="KinematicTaxel", options=springs, calibrated=_FORCE),
        Rung(
            name="L2 springs, ray",
            level=2,
            model="KinematicTaxel",
            options={**springs, "contact_depth_query": "ray"},
            calibrated=_FORCE,
        ),
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


def _depth(name: str, query: dict[str, Any]) -> Rung:
    return Rung(name=name, level=1, model="ContactDepthProbe", options={**_GRAZING, **query}, calibrated=("sink",))


def _points(options: dict[str, Any], count: int) -> Rung:
    return Rung(
        name=f"L2 proximity, {count} points",
        level=2,
        model="ProximityTaxel",
        options={**options, "n_sample_points": count},
        calibrated=_FORCE,
    )


def _markers(name: str, options: dict[str, Any]) -> Rung:
    return Rung(name=name, level=3, model="ElastomerTaxel", options=options, calibrated=_MOTION)
