"""Estimates from presses of known depth on a magnetic skin: the height of its magnets over the chips, their moments.

The model has one dipole over each chip, as :mod:`tactemu.transducers.magnetic`. With a probe ``d`` deep at ``p``::

    x_j = c_j + h n − d exp(−|c_j − p|²/2s²) n         c_j chip, n normal; without places all magnets move by d
    B_k = µ0/4π Σ_j (3 (m_j·r) r/|r|⁵ − m_j/|r|³) + rest_k,        r = c_k − x_j

Moments and rest are linear: only ``h`` and ``s`` are searched. With a known force but no depth, the field does not
determine how far the magnets moved: ``h``, moments and compliance have an unknown common factor, and are not estimated.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from firmware_protocols import Device, Reading
from tactemu.fit.estimates import Findings, least_squares, linear
from tactemu.fit.recording import Recorded
from tactemu.transducers.laws import MU0_OVER_4PI

FIT_ROWS = 400
"""Number of evenly spaced rows of the final fit; fewer only widen intervals."""
SEARCH_ROWS = 80
"""Number of rows of the first search."""
MIN_DEPTH_M = 3e-4
"""Minimum depth of a press that moves the magnets enough."""
MIN_EXPLAINED = 0.5
"""Share of a channel's variance that dipoles must explain."""
NEAR_M, FAR_M = 1e-3, 3e-2
"""The range of height and reach that is searched."""
HEIGHTS_M, REACHES_M = np.geomspace(1.5e-3, 2e-2, 10), np.geomspace(2e-3, 1.5e-2, 5)
"""The grid of starting points; the search begins at the best."""


def find_magnets(recorded: Recorded, device: Device, found: Findings) -> None:
    """Add the height of the magnets over the chips, the reach of a press, and a moment for each chip."""
    n = len(device.layout)
    if recorded.kind != "field" or not n or "field" not in getattr(device, "sees", "field"):
        return
    if recorded.readings.shape[1] != 3 * n:
        found.unknown.append(f"magnets: {recorded.readings.shape[1]} columns, the device has 3 axes of {n} chips")
        return
    depth = np.maximum(recorded.truth.get("depth", np.zeros(len(recorded.readings))), 0.0)
    if depth.max() < MIN_DEPTH_M:
        found.unknown.append("magnets: record the probe's depth (`depth`): a force alone leaves a common factor open")
        return
    search = _Search(recorded, device, SEARCH_ROWS, depth)
    good = np.ones(3 * n, bool)
    p = search.best(good)
    apart = search.residuals(p, good)
    explained = 1.0 - np.median(apart**2, axis=1) / np.maximum(np.median(search.deviation**2, axis=1), 1e-30)
    loud = np.median(search.deviation**2, axis=1) > 4.0 * np.median(np.median(apart**2, axis=1))
    good = (explained > MIN_EXPLAINED) | ~loud
    if good.sum() < 6:
        found.unknown.append("magnets: the field does not follow dipoles that move with the probe")
        return
    if not good.all():
        for name in np.array(recorded.names)[~good]:
            found.notes.append(f"{name} does not follow the magnets: left out")
        p = search.best(good)
    search = _Search(recorded, device, FIT_ROWS, depth)
    search.add_estimates(search.best(good, p), good, found)


class _Search:
    """The residuals of a recording as a function of height and reach."""

    def __init__(self, recorded: Recorded, device: Device, n_rows: int, depth: np.ndarray):
        rows = np.unique(np.linspace(0, len(depth) - 1, n_rows).astype(int))
        layout = device.layout
        self.n, self.chips, self.normals = len(layout), np.asarray(layout.positions), np.asarray(layout.normals)
        self.depth = depth[rows]
        self.field = recorded.readings[rows].T
        self.deviation = self.field - np.median(self.field, axis=1, keepdims=True)
        self.turns = axes_of(device)
        has = "x" in recorded.truth and "y" in recorded.truth
        self.placed = has and max(np.ptp(recorded.truth["x"]), np.ptp(recorded.truth["y"])) > 1e-3
        flat = np.stack([recorded.truth.get(axis, depth * 0.0)[rows] for axis in "xy"], axis=1)
        across = self.chips - self.chips.mean(axis=0)
        self.apart2 = ((across[None, :, :2] - flat[:, None]) ** 2).sum(axis=-1)
        self.scale = float(np.median(np.abs(self.deviation))) or 1e-9

    def shape(self, p: np.ndarray) -> np.ndarray:
        """Return the field of unit moments at each channel in its own axes, ``(3 n, rows, 3 n)``."""
        height = np.exp(p[0])
        share = np.exp(-0.5 * self.apart2 / np.exp(2 * p[1])) if self.placed else np.ones((len(self.depth), self.n))
        up = height - self.depth[:, None] * share
        places = self.chips + up[..., None] * self.normals
        arm = self.chips[None, :, None] - places[:, None]  # (rows, chips, magnets, 3)
        square = np.maximum((arm**2).sum(axis=-1), 1e-8)[..., None, None]
        unit = MU0_OVER_4PI * (3 * arm[..., :, None] * arm[..., None, :] / square - np.eye(3)) * square**-1.5
        seen = np.einsum("kab,tkjbc->tkajc", self.turns, unit)
        return seen.reshape(len(self.depth), 3 * self.n, 3 * self.n).swapaxes(0, 1)

    def bases(self, p: np.ndarray, good: np.ndarray) -> np.ndarray:
        """Return the bases of moments and rest, ``(rows of all channels, unknowns)``."""
        shape = self.shape(p)[good]
        rest = np.repeat(np.eye(len(good))[good][:, good], shape.shape[1], axis=0)
        return np.column_stack([shape.reshape(-1, 3 * self.n), rest])

    def residuals(self, p: np.ndarray, good: np.ndarray) -> np.ndarray:
        """Return the residuals ``(channels, rows)`` of the best moments and rest, fitted without outliers [T]."""
        shape, field = self.shape(p)[good], self.field[good]
        keep = np.ones(field.shape)
        apart = field
        for _ in range(2):
            rows = np.maximum(keep.sum(axis=1, keepdims=True), 1.0)
            still = shape - (shape * keep[..., None]).sum(axis=1, keepdims=True) / rows[..., None]
            away = field - (field * keep).sum(axis=1, keepdims=True) / rows
            bases = (still * keep[..., None]).reshape(-1, 3 * self.n)
            size = np.linalg.norm(bases, axis=0)
            gram, right = bases.T @ bases / np.outer(size, size), bases.T @ (away * keep).ravel() / size
            apart = away - still @ (np.linalg.lstsq(gram, right, rcond=None)[0] / size)
            keep = (np.abs(apart) < 8.0 * 1.4826 * np.median(np.abs(apart))).astype(float)
        return apart

    def best(self, good: np.ndarray, begin: np.ndarray | None = None) -> np.ndarray:
        """Return the best logarithms of height and reach, from ``begin`` or the best point of the grid."""
        width = 1 + self.placed
        low, high = np.log([NEAR_M, NEAR_M][:width]), np.log([FAR_M, FAR_M][:width])
        options: dict[str, Any] = {"loss": "soft_l1", "f_scale": 0.05, "diff_step": 1e-4, "max_nfev": 40}

        def apart(p: np.ndarray) -> np.ndarray:
            return self.residuals(p, good).ravel() / self.scale

        if begin is None:
            reaches = np.log(REACHES_M) if self.placed else [0.0]
            tries = [np.array([height, reach][:width]) for height in np.log(HEIGHTS_M) for reach in reaches]
            begin = min(tries, key=lambda p: float(np.sum(np.minimum(np.abs(apart(p)), 1.0))))
        return least_squares(apart, begin, bounds=(low, high), **options).x

    def add_estimates(self, p: np.ndarray, good: np.ndarray, found: Findings) -> None:
        """Add the estimates, with standard errors from all unknowns together."""
        y, bases = self.field[good].ravel(), self.bases(p, good)
        size = np.linalg.norm(bases, axis=0)
        law = linear(bases / size, y)[0] / size
        slopes = [
            (self.bases(p + step, good) - self.bases(p - step, good)) @ law / 2e-4 for step in 1e-4 * np.eye(len(p))
        ]
        all_bases = np.column_stack([*slopes, bases])
        size = np.linalg.norm(all_bases, axis=0)
        more, covariance, _ = linear(all_bases / size, y)
        errors = np.sqrt(np.maximum(np.diag(covariance), 0.0)) / size
        more = more / size
        k = len(p)
        names = (("magnet height", "m", "over the chips"), ("press reach", "m", "std of how far a press moves them"))
        for value, error, (name, unit, about) in zip(p, errors, names):
            found.add(name, np.exp(value), np.exp(value) * error, unit, about)
        for chip in range(self.n):
            for axis in range(3):
                at = k + 3 * chip + axis
                found.add(f"moment {chip} {'xyz'[axis]}", more[at], errors[at], "A m2", "in the frame of the link")


def axes_of(device: Device) -> np.ndarray:
    """Return each chip's response to a field in the link's frame, ``(n, 3, 3)`` T/T, by the device's own conversion."""
    n, strong = len(device.layout), 1e-3

    def reads(field: np.ndarray) -> np.ndarray:
        counts = np.asarray(device.measure(Reading({"field": field, "temperature": np.full(n, 25.0)}), 0), float)
        return 1e-6 * counts.reshape(n, -1)[:, -3:]

    columns = [reads(np.tile(strong * axis, (n, 1))) - reads(np.zeros((n, 3))) for axis in np.eye(3)]
    return np.stack(columns, axis=-1) / strong
