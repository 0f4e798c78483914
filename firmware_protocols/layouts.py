"""Layouts of transducers: points with a frame each, in patches on links; and functions that build such a skin."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from html import escape

import numpy as np
from numpy.typing import ArrayLike

PATCH_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
"""The colours of patches in drawings, in turn: of Okabe and Ito's palette those that show on white and on black."""
MAX_LENGTH_ERROR = 1.1e-5
"""The largest difference of a normal's length from 1."""


@dataclass(frozen=True, kw_only=True)
class Patch:
    """A run of taxels that forms an image: ``rows * cols`` taxels from index ``start``, row-major.

    ``rows = 0`` marks a free layout of ``cols`` taxels that is drawn by position.
    """

    name: str
    start: int
    rows: int
    cols: int
    pitch: float = 0.002
    """The distance between neighbours [m], used for default probe radii and drawings."""
    area: float = 0.0
    """The area of one taxel [m²]; default ``pitch**2``."""
    link: str = ""
    """The link that carries the patch; "" for the device's own."""

    def __post_init__(self):
        if not self.area:
            object.__setattr__(self, "area", self.pitch**2)

    def __len__(self) -> int:
        return max(self.rows, 1) * self.cols

    @property
    def taxels(self) -> slice:
        """The indices of this patch in every ``(n_taxels, ...)`` array."""
        return slice(self.start, self.start + len(self))


@dataclass(frozen=True, kw_only=True, eq=False)
class Layout:
    """The positions and frames of the taxels, each in the frame of the link that carries it (one link by default).

    Raises:
        ValueError: shapes disagree, a normal is not a unit vector, ``wire_order`` is not a permutation, or the patches
            do not cover every taxel once.
    """

    positions: np.ndarray
    """The taxel centres [m], shape ``(n_taxels, 3)``."""
    normals: np.ndarray
    """The unit normals out of the skin, shape ``(n_taxels, 3)``."""
    x_axes: np.ndarray = field(default=None)  # type: ignore[assignment]
    """The unit x axes of the taxels' own frames (z: normal), shape ``(n_taxels, 3)``; default: link x projected."""
    wire_order: np.ndarray = field(default=None)  # type: ignore[assignment]
    """``wire_order[k]`` is the taxel sent at place k, shape ``(n_taxels,)``; default: as listed."""
    patches: tuple[Patch, ...] = ()

    def __post_init__(self):
        positions = np.atleast_2d(np.asarray(self.positions, float)).reshape(-1, 3)
        n = len(positions)
        normals = _per_taxel(np.asarray(self.normals, float), n)
        if not (abs(np.linalg.norm(normals, axis=1) - 1.0) <= MAX_LENGTH_ERROR).all():
            raise ValueError("Layout.normals: every normal must have length 1")
        order = np.arange(n) if self.wire_order is None else np.asarray(self.wire_order, int)
        if order.shape != (n,) or not (np.sort(order) == np.arange(n)).all():
            raise ValueError(f"Layout.wire_order: expected a permutation of 0..{n - 1}, got {order}")
        x_axes = _default_x_axes(normals) if self.x_axes is None else np.asarray(self.x_axes, float)
        patches = self.patches or ((Patch(name="all", start=0, rows=0, cols=n),) if n else ())
        covered = sorted((patch.start, patch.start + len(patch)) for patch in patches)
        if [0, *(stop for _, stop in covered)] != [*(start for start, _ in covered), n]:
            raise ValueError(f"Layout.patches: expected every taxel of 0..{n - 1} in one patch, got runs {covered}")
        store = object.__setattr__
        store(self, "positions", positions)
        store(self, "normals", normals)
        store(self, "x_axes", _per_taxel(x_axes, n))
        store(self, "wire_order", order)
        store(self, "patches", patches)

    def __len__(self) -> int:
        return len(self.positions)

    @cached_property
    def links(self) -> tuple[str, ...]:
        """The names of the links that carry patches."""
        return tuple(dict.fromkeys(patch.link for patch in self.patches))

    @property
    def pitches(self) -> np.ndarray:
        """The pitch of each taxel [m], shape ``(n_taxels,)``."""
        return self._by_taxel("pitch")

    @property
    def areas(self) -> np.ndarray:
        """The area of each taxel [m²], shape ``(n_taxels,)``."""
        return self._by_taxel("area")

    @cached_property
    def y_axes(self) -> np.ndarray:
        """The unit y axes of the taxels' own frames, shape ``(n_taxels, 3)``."""
        return np.cross(self.normals, self.x_axes)

    @cached_property
    def axes(self) -> np.ndarray:
        """The unit axes of the taxels' own frames, shape ``(n_taxels, 3, 3)``: x, y and normal of each."""
        return np.stack([self.x_axes, self.y_axes, self.normals], axis=1)

    def _by_taxel(self, name: str, dtype: type = float) -> np.ndarray:
        values = np.empty(len(self), dtype)
        for patch in self.patches:
            values[patch.taxels] = getattr(patch, name)
        return values

    def on_links(self, links: Collection[str]) -> tuple[Layout, np.ndarray]:
        """Return the patches on some of the links as a layout of its own, and the indices of its taxels in this one."""
        patches = [patch for patch in self.patches if patch.link in links]
        taxels = np.concatenate([np.arange(len(self))[patch.taxels] for patch in patches])
        starts = np.cumsum([0, *map(len, patches)]).tolist()
        part = Layout(
            positions=self.positions[taxels],
            normals=self.normals[taxels],
            x_axes=self.x_axes[taxels],
            patches=tuple(replace(patch, start=start) for patch, start in zip(patches, starts)),
        )
        return part, taxels

    def on_wire(self, values: np.ndarray) -> np.ndarray:
        """Return per-taxel values in the order in which they are sent."""
        return values[self.wire_order]

    def to_taxel_frame(self, vectors: np.ndarray) -> np.ndarray:
        """Return vectors of the link frame, shape ``(n_taxels, 3)``, in each taxel's own frame (x, y, z = normal)."""
        return (self.axes * np.asarray(vectors)[:, None]).sum(-1)

    def push(self, forces: np.ndarray) -> np.ndarray:
        """Return the normal force that pushes each taxel inwards [N], shape ``(n_taxels,)``, of forces ``(n, 3)``."""
        return -(np.asarray(forces) * self.normals).sum(-1)

    def wrenches(self, forces: np.ndarray, about: Layout) -> np.ndarray:
        """Return force and torque [N, Nm] about points, shape ``(n_points, 6)``, of forces on the taxels ``(n, 3)``.

        A point on a link counts the taxels on that link, and one on no named link all taxels.
        """
        forces = np.broadcast_to(forces, (len(about), len(self), 3))
        if about.links != ("",):
            links = self._by_taxel("link", object)
            counted = [links == link if link else np.ones(len(self), bool) for link in about._by_taxel("link", object)]
            forces = np.where(np.array(counted)[:, :, None], forces, 0.0)
        arms = self.positions[None] - about.positions[:, None]
        return np.concatenate([forces.sum(axis=1), np.cross(arms, forces).sum(axis=1)], axis=-1)

    def _repr_html_(self) -> str:
        """Return the drawing that a notebook displays."""
        return self.picture()

    def picture(self, width_px: int = 480) -> str:
        """Return a drawing of the taxels as SVG, along the axis of least extent, with number, patch and place."""
        if not len(self):
            return "<p>no taxels</p>"
        across = np.sort(np.argsort(-np.ptp(self.positions, axis=0), kind="stable")[:2])
        places = self.positions[:, across] * 1e3  # mm
        radius = min(self.pitches) * 1e3 * 0.38
        low, high = places.min(0) - 2 * radius, places.max(0) + 2 * radius
        size = high - low
        dots = []
        for k, patch in enumerate(self.patches):
            colour = PATCH_COLOURS[k % len(PATCH_COLOURS)]
            for taxel in range(patch.start, patch.start + len(patch)):
                x, y = places[taxel, 0] - low[0], high[1] - places[taxel, 1]
                where = " ".join(f"{value * 1e3:.1f}" for value in self.positions[taxel])
                title = f"<title>taxel {taxel}, {escape(patch.name)}: {where} mm</title>"
                dots.append(f'<circle cx="{x:.2f}" cy="{y:.2f}" r="{radius:.2f}" fill="{colour}">{title}</circle>')
        height = min(width_px * size[1] / size[0], 2 * width_px)
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size[0]:.2f} {size[1]:.2f}" role="img" '
            f'style="width:100%;max-width:{width_px}px;max-height:{height:.0f}px">{"".join(dots)}</svg>'
        )


def _per_taxel(vectors: np.ndarray, n: int) -> np.ndarray:
    """Return ``np.broadcast_to(vectors, (n, 3))``, which takes 20 µs even where nothing is to be done."""
    if vectors.shape != (n, 3):
        return np.broadcast_to(vectors, (n, 3))
    view = vectors.view()
    view.flags.writeable = False
    return view


def _default_x_axes(normals: np.ndarray) -> np.ndarray:
    """Return link x projected on each tangent plane; link y where the normal is (nearly) along x."""
    seed = np.where(np.abs(normals[:, :1]) > 0.9, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
    tangent = seed - normals * (seed * normals).sum(-1, keepdims=True)
    return tangent / np.linalg.norm(tangent, axis=-1, keepdims=True)


def grid_layout(
    rows: int, cols: int, pitch: float, *, name: str = "pad", origin: ArrayLike = (0.0, 0.0, 0.0), link: str = ""
) -> Layout:
    """Return a flat grid centred on ``origin`` [m], normal +z; row 0 at the largest y, column 0 at the smallest x."""
    x = (np.arange(cols) - (cols - 1) / 2) * pitch
    y = ((rows - 1) / 2 - np.arange(rows)) * pitch
    xx, yy = np.meshgrid(x, y)
    positions = np.stack([xx, yy, np.zeros_like(xx)], -1).reshape(-1, 3) + np.asarray(origin, float)
    patch = Patch(name=name, start=0, rows=rows, cols=cols, pitch=pitch, link=link)
    return Layout(positions=positions, normals=np.array([0.0, 0.0, 1.0]), patches=(patch,))


def points(places: Mapping[str, Sequence[float]], *, pitch: float = 0.02, link: str = "") -> Layout:
    """Return a layout of single named points [m], each a patch of its own with the link's axes.

    Examples are chips, frames of force sensors, and domes.
    """
    patches = tuple(Patch(name=name, start=k, rows=0, cols=1, pitch=pitch, link=link) for k, name in enumerate(places))
    positions = np.array(list(places.values()), float).reshape(-1, 3)
    return Layout(positions=positions, normals=np.array([0.0, 0.0, 1.0]), patches=patches)


def place(
    layout: Layout, origin: ArrayLike, *, x_axis: ArrayLike = (1.0, 0.0, 0.0), normal: ArrayLike = (0.0, 0.0, 1.0)
) -> Layout:
    """Return ``layout`` moved rigidly: origin to ``origin`` [m], x and z axes to ``x_axis`` and ``normal`` (unit)."""
    x, z = np.asarray(x_axis, float), np.asarray(normal, float)
    turn = np.stack([x, np.cross(z, x), z], axis=-1)
    return replace(
        layout,
        positions=layout.positions @ turn.T + np.asarray(origin, float),
        normals=layout.normals @ turn.T,
        x_axes=layout.x_axes @ turn.T,
    )


FINGERTIPS_M = {
    "thumb": (0.06, 0.03, 0.0), "index": (0.033, 0.09, 0.0), "middle": (0.011, 0.1, 0.0),
    "ring": (-0.011, 0.095, 0.0), "little": (-0.033, 0.08, 0.0), "pinky": (-0.033, 0.08, 0.0),
}  # fmt: skip
"""The centre of each fingertip of a right hand, in the palm's frame [m]; an assumption."""


def on_fingers(pad: Layout, *fingers: str) -> Layout:
    """Return a pad on each of these fingertips, on a link of its name; by default on five, thumb first.

    Use it for a hand whose measures no source gives.
    """
    names = fingers or ("thumb", "index", "middle", "ring", "little")
    (patch,) = pad.patches
    tips = {name: replace(pad, patches=(replace(patch, name=name, link=name),)) for name in names}
    return stack(*(place(tip, FINGERTIPS_M[name]) for name, tip in tips.items()))


def stack(*layouts: Layout) -> Layout:
    """Return one layout of all the taxels, in this order also on the wire; patches keep pitch, area and link."""
    starts = [int(start) for start in np.cumsum([0, *map(len, layouts)])]
    pairs = list(zip(layouts, starts))
    return Layout(
        positions=np.concatenate([layout.positions for layout in layouts]),
        normals=np.concatenate([layout.normals for layout in layouts]),
        x_axes=np.concatenate([layout.x_axes for layout in layouts]),
        wire_order=np.concatenate([layout.wire_order + start for layout, start in pairs]),
        patches=tuple(replace(patch, start=patch.start + start) for layout, start in pairs for patch in layout.patches),
    )


def filled(n_taxels: int, width: float, height: float, *, name: str, link: str = "") -> Layout:
    """Return ``n_taxels`` spread evenly over a pad of ``width`` x ``height`` [m] (x, y), normal +z, in centred rows.

    Use it for a sensor whose taxel positions no source gives: the number of taxels is right, their places are assumed.
    """
    rows = max(1, round(math.sqrt(n_taxels * height / width)))
    per_row = [n_taxels // rows + (row < n_taxels % rows) for row in range(rows)]
    step_x, step_y = width / max(per_row), height / rows
    positions = [
        ((col - (cols - 1) / 2) * step_x, ((rows - 1) / 2 - row) * step_y, 0.0)
        for row, cols in enumerate(per_row)
        for col in range(cols)
    ]
    patch = Patch(name=name, start=0, rows=0, cols=n_taxels, pitch=min(step_x, step_y), area=step_x * step_y, link=link)
    return Layout(positions=np.array(positions), normals=np.array([0.0, 0.0, 1.0]), patches=(patch,))
