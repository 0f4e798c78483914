"""The truth for the settings: the layer on a grid sixteen times as fine, and the checks that verify it.

None of the eight objects has a closed form on a layer of finite thickness. The fine solution is therefore compared with
known solutions of simpler cases: Hertz' half-space, and finite elements of the same layer.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tactemu.geometry.shapes.mesh import Mesh
from tactemu.geometry.shapes.sphere import Sphere
from tactemu.scene.scene import Scene
from tactemu.sensors.layer.elastic_layer_taxel import ElasticLayerTaxel
from tactemu.tune.trade.cases import OFFSET_STEPS, OFFSETS, TOP, Case, TestSkin, build
from tactemu.tune.trade.errors import Observation

TOLERANCE = 1e-5
_VERSION = 3
"""The version of the content of stored truths."""
FINITE_ELEMENTS = {(0.3, 4e-4): 0.119728, (0.45, 4e-4): 0.148791, (0.49, 4e-4): 0.162828, (0.49, 8e-4): 0.592370}
"""(Poisson ratio, depth [m]): force [N] on a paraboloid of 5 mm, E = 0.1 MPa, 4 mm thick; quadratic axisymmetric
elements, 27,000 unknowns."""
NEO_HOOKEAN = {4e-4: 0.1578244, 8e-4: 0.5577619, 1.6e-3: 2.092396}
"""Depth [m]: force [N] on a ball of 5 mm at finite strain (compressible neo-Hookean), nu = 0.49, otherwise as above."""


@dataclass(frozen=True)
class Check:
    """A comparison of the fine solution with an independent one."""

    what: str
    error: float
    """The relative error."""


def fine_skin(skin: TestSkin, factor: int) -> TestSkin:
    """Return the same skin with taxels ``factor`` times as fine."""
    return replace(skin, side=skin.side * factor, pitch=skin.pitch / factor)


class Truths:
    """The truth of each case, solved once and kept in a folder.

    Args:
        skin: the skin of the settings.
        factor: number of cells along a taxel, a multiple of :data:`~tactemu.tune.trade.cases.OFFSET_STEPS`.
        folder: the folder that keeps truths between runs; None: they are not kept.
    """

    def __init__(self, skin: TestSkin, factor: int, folder: Path | None):
        self.skin, self.factor, self.folder = skin, factor, folder
        self._known: dict[Case, list[Observation]] = {}

    @property
    def name(self) -> str:
        """The description of the truth for the report."""
        cells = self.skin.side * self.factor
        return f"layer solution on {cells} x {cells} cells, residual {TOLERANCE:g}, averaged over taxels"

    def of(self, case: Case) -> list[Observation]:
        """Return the truth of a case at each of its offsets: its last reading."""
        if case not in self._known:
            file = self._file(case)
            if file is not None and file.exists():
                with np.load(file) as data:
                    stacked = {key: data[key] for key in data.files}
            else:
                found = self._solve(case)
                stacked: dict[str, Any] = {key: np.stack([vars(each)[key] for each in found]) for key in vars(found[0])}
                if file is not None:
                    file.parent.mkdir(parents=True, exist_ok=True)
                    np.savez_compressed(file, **stacked)
            self._known[case] = [
                Observation(**{key: values[k] for key, values in stacked.items()}) for k in range(len(OFFSETS))
            ]
        return self._known[case]

    def _file(self, case: Case) -> Path | None:
        if self.folder is None:
            return None
        key = hashlib.blake2b(
            repr((_VERSION, self.skin, self.factor, TOLERANCE, OFFSETS, list(_plain(case)))).encode(), digest_size=8
        )
        return self.folder / f"{case.name.replace(',', '').replace(' ', '_')}-{key.hexdigest()}.npz"

    def _solve(self, case: Case) -> list[Observation]:
        fine = fine_skin(self.skin, self.factor)
        model = ElasticLayerTaxel(positions=fine.positions(), **fine.layer, iterations=400, tolerance=TOLERANCE)
        sim, body, sensor = build(fine, case, model)
        for pose in case.poses():
            sim.set_pose(body, **pose)
            sim.step()
        reading = sensor.read()
        return [self._average(reading, offset) for offset in OFFSETS]

    def _average(self, reading, offset: tuple[int, int]) -> Observation:
        """Return the averages over taxels of an object that lies elsewhere: its solution is moved by whole cells.

        The motion of taxels whose cells come from beyond the skin is unknown, NaN; no object touches there.
        """
        side, factor = self.skin.side, self.factor
        finer, cells = factor // OFFSET_STEPS, np.arange(side * factor)
        columns, rows = cells - offset[0] * finer, cells + offset[1] * finer  # y falls from row to row
        unknown = ~np.isin(rows, cells)[:, None] | ~np.isin(columns, cells)

        def blocks(values: np.ndarray, beyond: float = 0.0) -> np.ndarray:
            tail = values.shape[2:]
            moved = values[np.ix_(rows % len(cells), columns % len(cells))].astype(float)
            moved[unknown] = beyond
            return moved.reshape(side, factor, side, factor, *tail).mean((1, 3)).reshape(-1, *tail)

        moved = blocks(reading.displacement, np.nan)
        pressure = blocks(reading.pressure)
        return Observation(
            pressure=pressure,
            drag=reading.force.reshape(-1, 3)[:, :2].astype(float).sum(0),
            touch=pressure > 0,  # a setting, too, counts a taxel of which any part is in contact
            sink=-moved[:, 2],
            shift=moved[:, :2],
        )


def _plain(case: Case):
    for pose in case.poses():
        yield from (np.round(np.asarray(value, float), 12).tolist() for value in pose.values())


def checks(cells: int = 256) -> list[Check]:
    """Return the errors of the truths' solver relative to closed forms and finite elements."""
    found = []
    radius, depth = 5e-3, 1e-4
    contact = np.sqrt(radius * depth)
    skin = TestSkin(side=cells, pitch=3 * contact / cells, poisson_ratio=0.3, thickness=np.inf, friction=0.0)
    hertz = 4 / 3 * skin.young_modulus / (1 - 0.3**2) * np.sqrt(radius) * depth**1.5
    got = _force(skin, _paraboloid(skin, radius), 0.0, depth)
    found.append(Check("Hertz: paraboloid of 5 mm, 0.1 mm deep, half-space", got / hertz - 1))
    for (nu, deep), force in FINITE_ELEMENTS.items():
        extent = 2.6 * 1.5 * np.sqrt(radius * deep)
        skin = TestSkin(side=cells, pitch=extent / cells, poisson_ratio=nu, friction=0.0)
        got = _force(skin, _paraboloid(skin, radius), 0.0, deep)
        found.append(
            Check(f"finite elements: paraboloid of 5 mm, {deep * 1e3:.1f} mm deep, nu {nu:g}", got / force - 1)
        )
    for deep, force in NEO_HOOKEAN.items():
        skin = TestSkin(side=cells, pitch=4 * np.sqrt(radius * deep) / cells, friction=0.0)
        got = _force(skin, Sphere(radius=radius), radius, deep)
        found.append(Check(f"finite strain: ball of 5 mm, {deep * 1e3:.1f} mm deep, nu 0.49", got / force - 1))
    return found


def _paraboloid(skin: TestSkin, radius: float) -> Mesh:
    """Return a finely sampled paraboloid over the whole skin, its vertex at the origin."""
    x = np.linspace(-0.55, 0.55, 257) * skin.side * skin.pitch
    xx, yy = np.meshgrid(x, x)
    z = (xx**2 + yy**2) / (2 * radius)
    return Mesh(source=_height_field(xx, yy, z, float(z.max()) + radius))


def _force(skin: TestSkin, shape, lowest: float, depth: float) -> float:
    """Return the normal force on a shape whose lowest point is ``lowest`` below its origin, without friction [N]."""
    scene = Scene()
    pad = scene.add_body(None, name="pad", fixed=True)
    body = scene.add_body(shape, name="object", position=(0, 0, 1))
    options = {"iterations": 400, "tolerance": 1e-6, "displacement": False, "look_depth": 4 * depth}
    model = ElasticLayerTaxel(positions=skin.positions(), **skin.layer, **options)
    sensor = scene.add_sensor(model, link=pad)
    sim = scene.build()
    sim.set_pose(body, position=(0, 0, TOP + lowest - depth))
    sim.step()
    return float(-sensor.read().force[..., 2].sum())


def _height_field(x: np.ndarray, y: np.ndarray, z: np.ndarray, top: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a closed mesh between a height field and the plane ``z = top``."""
    rows, columns = z.shape
    low = np.stack([x, y, z], -1).reshape(-1, 3)
    high = np.stack([x, y, np.full_like(z, top)], -1).reshape(-1, 3)
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    bottom = np.concatenate([np.stack([a, c, b], 1), np.stack([a, d, c], 1)])
    rim = np.concatenate([index[0, :-1], index[:-1, -1], index[-1, :0:-1], index[:0:-1, 0]])
    after = np.roll(rim, -1)
    shift = rows * columns
    sides = np.concatenate([
        np.stack([rim, after, after + shift], 1),
        np.stack([rim, after + shift, rim + shift], 1),
    ])  # fmt: skip
    return np.concatenate([low, high]), np.concatenate([bottom, bottom[:, ::-1] + shift, sides])
