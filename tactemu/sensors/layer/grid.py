"""The grid of cells on which a layer is solved: taxels in rows and columns, each split into finer cells."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactemu.base.errors import SceneError
from tactemu.sensors.probe_layout import Probes

_TOLERANCE = 1e-3
"""Largest deviation of a taxel from its place, in pitches, and of normals from one another."""
_BENT_TOLERANCE_PITCHES = 0.2
"""Largest deviation of a taxel from its place on a grid bent both ways, on which no net of squares fits, in pitches."""
_BENT_NORMAL_TOLERANCE = 0.05
"""Largest deviation of a normal on such a grid, and of its axes from a right angle, as a cosine."""
_MIN_TILT_COSINE = np.cos(np.radians(40.0))
"""Cosine of the largest tilt of such a grid."""
_MAX_TOUCHING_PITCHES = 1.6
"""Distance below which two pads touch, in pitches; a diagonal step is 1.41."""
_MIN_BENT_COSINE = np.cos(np.radians(44.0))
"""Cosine of the angle from which on touching pads are two faces of a body instead of one bent skin."""
_NEIGHBOUR_PITCHES = (2.05, 1.45, 1.05)
"""Largest distances of neighbours in one pad, in pitches, tried in order; pads that lie close together need the smaller
ones."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LayerGrid:
    """A lattice of taxels. Rows step along ``v``, columns along ``u``; a taxel has ``split * split`` cells.

    The surface is an arc along u that is moved along an arc along v: flat, around a cylinder, or bent both ways.
    Lengths are measured along the arcs and exact everywhere; where both are tilted, their angle deviates slightly from
    a right angle.
    """

    rows: int
    columns: int
    pitch: tuple[float, float]
    """Distance of neighbouring taxels along v and u [m]."""
    split: int
    base: np.ndarray
    """A point of the surface, link frame [m]."""
    u: np.ndarray
    """Unit vector along a row, link frame; on a bent grid that at the base, like ``v`` and ``normal``."""
    v: np.ndarray
    """Unit vector along a column."""
    normal: np.ndarray
    """Unit vector out of the skin."""
    place: np.ndarray
    """Place of each probe, ``row * columns + column``, shape ``(n,)``; -1 for fillers, which have no cell."""
    base_at: tuple[float, float] = (0.0, 0.0)
    """Distance of the base down (along v) and along u from the centre of the taxel in row 0, column 0 [m]."""
    curvature: tuple[float, float] = (0.0, 0.0)
    """Curvature along v and u [1/m]; positive: convex."""
    off: np.ndarray | None = None
    """Displacement of the taxels from the arcs, shape ``(rows, columns, 3)``, link frame [m]; ``None``: they lie on
    them."""

    @property
    def is_bent(self) -> bool:
        """Is the grid not flat?"""
        return any(self.curvature)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of cells along v and u."""
        return self.rows * self.split, self.columns * self.split

    @property
    def cell(self) -> tuple[float, float]:
        """Size of a cell along v and u [m]."""
        return self.pitch[0] / self.split, self.pitch[1] / self.split

    @property
    def area(self) -> float:
        """Area of one taxel [m²]."""
        return self.pitch[0] * self.pitch[1]

    @property
    def edge(self) -> np.ndarray:
        """The corner of the first cell of a flat grid, link frame [m]."""
        down, along = (at + 0.5 * pitch for at, pitch in zip(self.base_at, self.pitch))
        return self.base - down * self.v - along * self.u

    def cell_centres(self) -> np.ndarray:
        """Return the centres of the cells, link frame [m], shape ``(*shape, 3)``."""
        arcs = self.places(*self._cells())
        if self.off is None:
            return arcs
        y, x = ((np.arange(n * self.split) + 0.5) / self.split - 0.5 for n in (self.rows, self.columns))
        return arcs + _interpolated(y, _interpolated(x, self.off.swapaxes(0, 1)).swapaxes(0, 1))

    def places(self, down: np.ndarray, along: np.ndarray) -> np.ndarray:
        """Return the points of the surface at these arc lengths down and along from the first taxel, shape ``(...,
        3)``, link frame [m]."""
        place = self.base
        for far, at, axis, bend in zip((down, along), self.base_at, (self.v, self.u), self.curvature):
            far = (far - at)[..., None]
            if bend:
                place = place + np.sin(bend * far) / bend * axis + (np.cos(bend * far) - 1.0) / bend * self.normal
            else:
                place = place + far * axis
        return place

    def axes(self, down: np.ndarray, along: np.ndarray) -> np.ndarray:
        """Return ``u``, ``v`` and the normal at these arc lengths, at right angles, shape ``(3, ..., 3)``."""
        down, along = np.broadcast_arrays(down - self.base_at[0], along - self.base_at[1])
        over, across = (down * self.curvature[0])[..., None], (along * self.curvature[1])[..., None]
        u = np.cos(across) * self.u - np.sin(across) * self.normal
        v = np.cos(over) * self.v - np.sin(over) * self.normal
        v = v - (v * u).sum(-1, keepdims=True) * u
        tilt = np.sin(across) * np.cos(over) * self.u + np.cos(across) * np.sin(over) * self.v
        normal = tilt + np.cos(across) * np.cos(over) * self.normal
        return np.stack([u, *(each / np.linalg.norm(each, axis=-1, keepdims=True) for each in (v, normal))])

    def _cells(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the arc lengths of the centres of the cells, down and along."""
        y, x = ((np.arange(n) + 0.5) * cell - 0.5 * pitch for n, cell, pitch in zip(self.shape, self.cell, self.pitch))
        return y[:, None], x[None, :]

    def cell_axes(self) -> np.ndarray:
        """Return the axes (:meth:`axes`) of all cells, ``(3, *shape, 3)``."""
        return self.axes(*self._cells())

    def taxel_axes(self) -> np.ndarray:
        """Return the axes of all probes, ``(3, n, 3)``; those of fillers have no meaning."""
        rows, columns = np.divmod(self.place, self.columns)
        return self.axes(rows * self.pitch[0], columns * self.pitch[1])

    def covered(self) -> np.ndarray:
        """Return True for each cell that belongs to a taxel, bool, of ``shape``: skin is only where taxels are."""
        taxels = np.zeros(self.rows * self.columns, bool)
        taxels[self.place[self.place >= 0]] = True
        return np.kron(taxels.reshape(self.rows, self.columns), np.ones((self.split, self.split), bool)) > 0


def _interpolated(at: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Interpolate values ``(n, ...)`` at fractional indices; linear, and constant beyond the ends."""
    at = np.clip(at, 0.0, len(values) - 1.0)
    before = np.minimum(at.astype(int), len(values) - 2)
    share = (at - before).reshape(-1, *[1] * (values.ndim - 1))
    return (1.0 - share) * values[before] + share * values[before + 1]


def layer_grids(probes: Probes, split: int, sensor: str) -> list[LayerGrid]:
    """Return the grids that the probes form, listed as ``(rows, cols, 3)`` or as ``(n, 3)``: one, or one per flat pad.

    Raises:
        SceneError: a pad's taxels do not lie on a flat rectangular lattice, or the pads are strips of a bent skin.
    """
    active = np.flatnonzero(probes.active)
    if not len(active):
        return []
    try:
        return [_grid_of(probes, active, split, sensor)]
    except SceneError as error:
        reason = error
    for bent in (_around_a_cylinder, _bent_both_ways):
        if (grid := bent(probes, active, split)) is not None:
            return [grid]
    for closeness in _NEIGHBOUR_PITCHES:
        pads = _pads(probes, active, closeness)
        try:
            grids = [
                _grid_of(probes, pad, split, f"{sensor}, pad {k + 1} of {len(pads)}") for k, pad in enumerate(pads)
            ]
        except SceneError as error:
            reason = error if len(pads) > 1 else reason
            continue
        _check_strips(probes, pads, grids, sensor)
        return grids
    raise reason


def _check_strips(probes: Probes, pads: list[np.ndarray], grids: list[LayerGrid], sensor: str) -> None:
    """Check that pads are no strips of one bent skin: pads do not interact, which is right for fingers and faces only.

    Raises:
        SceneError: two pads touch, are not in one plane, and are only slightly rotated against each other.
    """
    for k, (pad, grid) in enumerate(zip(pads, grids)):
        for other, beside in zip(pads[:k], grids[:k]):
            if grid.normal @ beside.normal < _MIN_BENT_COSINE:
                continue
            way = probes.positions[other][:, None] - probes.positions[pad][None]
            distance = np.linalg.norm(way, axis=-1)
            pitch = max(*grid.pitch, *beside.pitch)
            level = np.abs(way @ grid.normal).max() <= _TOLERANCE * pitch
            if level or distance.min() > _MAX_TOUCHING_PITCHES * pitch:
                continue
            raise _bent_error(probes, min(grid.pitch), sensor)


def _bent_error(probes: Probes, pitch: float, sensor: str) -> SceneError:
    extent = float(np.linalg.norm(np.ptp(probes.positions[probes.active], axis=0)))
    flat_from = extent / _TOLERANCE * max(0.5, extent / (8 * pitch))
    return SceneError(
        f"{sensor}: the taxels lie on a bent surface; ElasticLayerTaxel solves flat pads, rectangular grids around a "
        "cylinder with the cylinder's normals, and gently bent ones, given as (rows, cols, 3), whose rows and columns "
        "are arcs; strips of any other bent surface would not interact. From a bend "
        f"radius of {flat_from:.2g} m on these count as flat. Use ElastomerTaxel, or arrange the taxels on a plane"
    )


def _pads(probes: Probes, active: np.ndarray, closeness: float) -> list[np.ndarray]:
    """Return the pads, the indices of taxels that belong together: of one normal, in one plane, and within
    ``closeness`` pitches of another one."""
    positions, normals = probes.positions[active], probes.normals[active]
    left = np.ones(len(active), bool)
    pads = []
    while left.any():
        first = int(np.flatnonzero(left)[0])
        away = positions - positions[first]
        distance = np.linalg.norm(away, axis=1)
        level = np.abs(away @ normals[first]) < _TOLERANCE * max(float(distance.max()), 1e-12)
        alike = left & level & (np.abs(normals - normals[first]).max(axis=1) < _TOLERANCE)
        nearest = distance[alike & (distance > 0)].min(initial=np.inf)
        pad = np.zeros(len(active), bool)
        pad[first] = True
        edge = pad.copy()
        while edge.any():
            gap = np.linalg.norm(positions[alike][:, None] - positions[edge][None], axis=-1).min(axis=1)
            reached = np.zeros(len(active), bool)
            reached[np.flatnonzero(alike)[gap <= closeness * nearest]] = True
            edge = reached & ~pad
            pad |= reached
        pads.append(active[pad])
        left &= ~pad
    return pads


def _grid_of(probes: Probes, members: np.ndarray, split: int, sensor: str) -> LayerGrid:
    """Return the grid of some probes.

    Raises:
        SceneError: the probes do not lie on one flat rectangular lattice.
    """
    normal = probes.normals[members].mean(0)
    normal /= max(float(np.linalg.norm(normal)), 1e-12)
    if np.abs(probes.normals[members] - normal).max() > _TOLERANCE:
        raise SceneError(f"{sensor}: ElasticLayerTaxel needs one normal for all taxels of a pad; give one in normals")
    positions = probes.positions[members]
    centred = positions - positions[0]
    u = _row_direction(probes, centred, normal)
    v = np.cross(normal, u)
    if probes.is_grid and probes.steps()[1] @ v < 0:
        v = -v
    lone = 2 * float(probes.radii[members][0])
    along, du, columns = _ticks(centred @ u)
    down, dv, rows = _ticks(centred @ v)
    dv, du = (dv or du or lone), (du or dv or lone)
    off = np.abs(centred @ normal).max() / min(du, dv)
    uneven = max(np.abs(along - np.rint(along)).max(), np.abs(down - np.rint(down)).max())
    holes = rows * columns - len(positions)
    if off > _TOLERANCE:
        raise _bent_error(probes, min(du, dv), sensor)
    if uneven > _TOLERANCE or holes > 2 * len(positions):
        raise SceneError(
            f"{sensor}: ElasticLayerTaxel needs taxels on a flat rectangular grid; these deviate from one by "
            f"{uneven:.2g} pitches and leave {holes} of its places empty. Use ElastomerTaxel, or give "
            "positions as a regular grid"
        )
    cell = (np.rint(down - down.min()) * columns + np.rint(along - along.min())).astype(int)
    if len(np.unique(cell)) != len(cell):
        raise SceneError(f"{sensor}: two taxels are at the same place; remove one")
    place = np.full(probes.n, -1)
    place[members] = cell
    corner = positions[0] + along.min() * du * u + down.min() * dv * v
    return LayerGrid(
        rows=rows, columns=columns, pitch=(dv, du), split=split, base=corner, u=u, v=v, normal=normal, place=place
    )


def _row_direction(probes: Probes, centred: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return the unit vector along the rows: the grid's own, or towards the nearest neighbour of the first taxel."""
    step = probes.steps()[0] if probes.is_grid else np.zeros(3)
    if not np.any(step) and len(centred) > 1:
        distance = np.linalg.norm(centred[1:], axis=1)
        step = centred[1 + int(np.argmin(distance))]
        if abs(step @ np.array([0.0, 1.0, 0.0])) > abs(step @ np.array([1.0, 0.0, 0.0])):
            step = np.cross(step, normal)
    if not np.any(step):
        step = np.eye(3)[int(np.argmin(np.abs(normal)))]
    step = step - (step @ normal) * normal
    return step / np.linalg.norm(step)


def _ticks(coordinate: np.ndarray) -> tuple[np.ndarray, float, int]:
    """Return the coordinates in pitches, the pitch (0 if they are all equal), and the number of places."""
    ordered = np.unique(coordinate)
    extent = float(ordered[-1] - ordered[0])
    gaps = np.diff(ordered)
    gaps = gaps[gaps > 1e-4 * extent]
    if not len(gaps) or extent == 0.0:
        return np.zeros_like(coordinate), 0.0, 1
    count = int(round(extent / float(gaps.min()))) + 1
    pitch = extent / (count - 1)
    return coordinate / pitch, pitch, count


def _around_a_cylinder(probes: Probes, members: np.ndarray, split: int) -> LayerGrid | None:
    """Return the grid of probes in rows and columns around a cylinder with its normals; ``None`` if they do not lie
    so."""
    positions, normals = probes.positions[members], probes.normals[members]
    axis = np.linalg.svd(normals)[2][-1]
    if len(members) < 4 or np.abs(normals @ axis).max() > _TOLERANCE:
        return None
    flat = positions - (positions @ axis)[:, None] * axis  # centre + radius * normal
    bases = np.concatenate([np.tile(np.eye(3), (len(members), 1)), normals.reshape(-1, 1)], axis=1)
    *centre, radius = np.linalg.lstsq(bases, flat.ravel(), rcond=None)[0].tolist()
    first, around = normals[0], np.cross(axis, normals[0])
    steps = probes.steps() if probes.is_grid else (np.array([1.0, 0.0, 0.0]), np.zeros(3))
    along_u = abs(steps[0] @ around) >= abs(steps[0] @ axis)
    u = around if along_u else axis
    u = -u if steps[0] @ u < 0 else u
    v = np.cross(first, u)
    v = -v if steps[1] @ v < 0 else v
    way = u if along_u else v
    arc = radius * np.arctan2(normals @ way, normals @ first)
    straight = (positions - positions[0]) @ (v if along_u else u)
    along, du, columns = _ticks(arc if along_u else straight)
    down, dv, rows = _ticks(straight if along_u else arc)
    if not du or not dv:
        return None
    off = np.abs(flat - centre - radius * normals).max() / min(du, dv)
    uneven = max(np.abs(each - np.rint(each)).max() for each in (along - along.min(), down - down.min()))
    cell = (np.rint(down - down.min()) * columns + np.rint(along - along.min())).astype(int)
    if max(off, uneven) > _TOLERANCE or len(np.unique(cell)) != len(cell) or rows * columns > 3 * len(cell):
        return None
    place = np.full(probes.n, -1)
    place[members] = cell
    return LayerGrid(
        rows=rows, columns=columns, pitch=(dv, du), split=split, base=positions[0], u=u, v=v, normal=first, place=place,
        base_at=(-float(down.min()) * dv, -float(along.min()) * du),
        curvature=(0.0, 1.0 / radius) if along_u else (1.0 / radius, 0.0),
    )  # fmt: skip


def _bent_both_ways(probes: Probes, members: np.ndarray, split: int) -> LayerGrid | None:
    """Return the grid of probes given as ``(rows, cols, 3)`` on a ball, a saddle or similar; ``None`` if they do not
    lie so.

    Both curvatures are fitted to the normals, both pitches to the places.
    """
    if not probes.is_grid or min(probes.layout) < 3:
        return None
    positions, normals = probes.positions[members], probes.normals[members]
    top = int(np.argmax(normals @ normals.mean(0)))
    normal, centred = normals[top], positions - positions[top]
    u, v = (step - (step @ normal) * normal for step in probes.steps())
    u, v = u / max(float(np.linalg.norm(u)), 1e-12), v / max(float(np.linalg.norm(v)), 1e-12)
    if abs(u @ v) > _BENT_NORMAL_TOLERANCE or (normals @ normal).min() < _MIN_TILT_COSINE:
        return None
    found = []
    numbers = np.divmod(members, probes.layout[1])
    for axis, number in zip((v, u), numbers):
        far, steps = centred @ axis, number - number[top]
        if not far.any():
            return None
        slope = (normals @ axis) / (normals @ normal)
        bend = float(far @ (slope / np.hypot(1.0, slope)) / (far @ far))  # the sine of an arc's tilt is linear
        if abs(bend) * np.ptp(far) < _TOLERANCE:
            return None
        arc = np.arcsin(np.clip(bend * far, -1.0, 1.0)) / bend
        found.append((bend, float(steps @ arc / (steps @ steps))))
    (bend_v, dv), (bend_u, du) = found
    if min(dv, du) <= 0:
        return None
    place = np.full(probes.n, -1)
    place[members] = members
    made = LayerGrid(
        rows=probes.layout[0], columns=probes.layout[1], pitch=(dv, du), split=split, base=positions[top], u=u, v=v,
        normal=normal, place=place, base_at=(numbers[0][top] * dv, numbers[1][top] * du), curvature=(bend_v, bend_u),
    )  # fmt: skip
    here = numbers[0] * dv, numbers[1] * du
    off = np.zeros((probes.n, 3))
    off[members] = positions - made.places(*here)
    tilted = np.abs(made.axes(*here)[2] - normals).max()
    if np.abs(off).max() > _BENT_TOLERANCE_PITCHES * min(dv, du) or tilted > _BENT_NORMAL_TOLERANCE:
        return None
    return replace(made, off=off.reshape(*probes.layout, 3))
