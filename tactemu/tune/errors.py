"""The measures of a setting's error, and the choice of those that matter in a scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from firmware_protocols import Device
from firmware_protocols.layouts import Layout
from firmware_protocols.senses import CONTACT, DERIVED, VECTORS

ERRORS = {
    "taxels": "RMS over all taxels and moments, relative to the truth's",
    "total": "of the sum over the skin, RMS over moments, relative to the truth's",
    "worst": "largest of any taxel, relative to the largest of the truth",
    "pressure": "of the component along the normal, RMS over all taxels and moments, relative to the truth's",
    "drag": "of the tangential components' sum over each patch, RMS over moments, relative to the truth's",
    "edges": "RMS over the taxels on both sides of the contact's border and all moments, relative to the truth's",
}
"""The measures by their names."""
SLIDING_SHARE = 0.05
"""Minimum drag, relative to the normal force, at which a body counts as sliding."""
MIN_DRAG_SHARE = 1e-3
"""Minimum drag, relative to the normal force, that is compared: less is what the truth's own residual leaves."""
EDGE_SHARE = 0.8
"""Minimum pressure at the border, relative to the largest, of a contact with an edge. A ball whose contact is six
taxels wide has 0.75 at most."""
MIN_CONTACT_SHARE = 1e-6
"""Minimum reading of a taxel in contact, relative to the largest reading."""
NEAR = 1.3
"""Taxels of a free layout within this many distances to the nearest one are neighbours."""


@dataclass(frozen=True)
class Criterion:
    """The measures whose largest error decides."""

    measures: tuple[str, ...]
    reasons: Mapping[str, str] = field(default_factory=dict)
    """The reason why the scene needs a measure, or does not, by measure; empty if you chose the measure."""

    def error(self, errors: Mapping[str, float]) -> float:
        """Return the error that decides."""
        return max(errors[name] for name in self.measures)


class Comparison:
    """A comparison of a skin's readings with the truth.

    Args:
        truth: the true readings at moments in contact, shape ``(n_moments, n_taxels)`` or ``(n_moments, n_taxels, 3)``.
        device: the device that reads them: the first of its quantities in ``device.contact``.
    """

    def __init__(self, truth: np.ndarray, device: Device):
        self.truth = truth
        self._layout, self._quantity = device.layout, device.contact[0]
        self._read = {sense.quantity for sense in device.sensed}
        push, drag = self._push(truth), self._drag(truth)
        self.drag_share = _ratio(drag, self._by_patch(push))
        self._border = np.zeros(push.shape, bool)
        self.edge_share = 0.0
        if self._quantity not in ("displacement", "field"):  # these are nonzero beside a contact, too
            size = np.linalg.norm(truth, axis=-1) if truth.ndim == 3 else np.abs(truth)
            in_contact = size > MIN_CONTACT_SHARE * size.max()
            self._border = border(self._layout, in_contact)
            inside = np.where(self._border & in_contact, push, 0.0)
            self.edge_share = float(inside.max(axis=1).sum() / max(push.max(axis=1).sum(), 1e-300))

    @property
    def measures(self) -> tuple[str, ...]:
        """The measures for which the truth has a value."""
        missing = {"drag": self.drag_share < MIN_DRAG_SHARE, "edges": not self._border.any()}
        return tuple(name for name in ERRORS if not missing.get(name, False))

    def criterion(self) -> Criterion:
        """Return the measures that follow what the scene does and the device reads."""
        sums = self._read & set(DERIVED)
        singles = bool(self._read & set(CONTACT)) or not sums
        vectors = bool(self._read & {*VECTORS, "wrench"}) or (not sums and self._quantity in VECTORS)
        sliding, sharp = self.drag_share >= SLIDING_SHARE, self.edge_share >= EDGE_SHARE
        reasons, judged = {}, []
        if singles:
            reasons["pressure"] = f"the device reads the {self._quantity} of each taxel"
            judged.append("pressure")
        if sums:
            reasons["total"] = f"the device reads the {', '.join(sorted(sums))} of all taxels"
            judged.append("total")
        if vectors:
            moved = f"the tangential sum is {self.drag_share:.2g} of the normal one"
            reasons["drag"] = f"{'a body slides' if sliding else 'no body slides'}: {moved}"
            judged += ["drag"] if sliding else []
        if singles and self._border.any():
            bears = f"the border bears {self.edge_share:.2g} of the largest pressure"
            reasons["edges"] = f"{'an edge, or a few taxels, touch' if sharp else 'no edge touches'}: {bears}"
            judged += ["edges"] if sharp else []
        return Criterion(tuple(judged), reasons)

    def errors(self, got: np.ndarray) -> dict[str, float]:
        """Return the errors of readings at the same moments, by all measures for which the truth has a value."""
        truth = self.truth
        found = {
            "taxels": _error(got, truth),
            "total": _error(got.sum(axis=1), truth.sum(axis=1)),
            "worst": float(np.abs(got - truth).max() / np.abs(truth).max()),
            "pressure": _error(self._push(got), self._push(truth)),
            "drag": _error(self._drag(got), self._drag(truth)),
            "edges": _error(got[self._border], truth[self._border]),
        }
        return {name: found[name] for name in self.measures}

    def _push(self, values: np.ndarray) -> np.ndarray:
        """Return the component into the skin, shape ``(n_moments, n_taxels)``; of scalars themselves."""
        return self._layout.push(values) if values.ndim == 3 else values

    def _drag(self, values: np.ndarray) -> np.ndarray:
        """Return the sum of tangential components over each patch, ``(n_moments, n_patches, 3)``; of scalars zeros."""
        if values.ndim == 2:
            return np.zeros((len(values), len(self._layout.patches), 3))
        return self._by_patch(values + self._push(values)[..., None] * self._layout.normals)

    def _by_patch(self, values: np.ndarray) -> np.ndarray:
        return np.stack([values[:, patch.taxels].sum(axis=1) for patch in self._layout.patches], axis=1)


def border(layout: Layout, in_contact: np.ndarray) -> np.ndarray:
    """Return the taxels that have a neighbour on the other side of the contact's border.

    Args:
        layout: the skin.
        in_contact: the taxels in contact at each moment, bool, shape ``(n_moments, n_taxels)``, like the result.
    """
    one, other = neighbours(layout).T
    differ = in_contact[:, one] != in_contact[:, other]
    found = np.zeros(in_contact.shape, bool)
    for row, ends in zip(found, differ):
        row[one[ends]] = row[other[ends]] = True
    return found


def neighbours(layout: Layout) -> np.ndarray:
    """Return the pairs of neighbouring taxels of each patch, shape ``(n_pairs, 2)``: those beside each other in a row
    or column of a grid, the nearest ones of a free layout."""
    pairs = [np.empty((0, 2), int)]
    for patch in layout.patches:
        taxels = np.arange(patch.start, patch.start + len(patch))
        if patch.rows:
            grid = taxels.reshape(patch.rows, patch.cols)
            both = [(grid[:, :-1], grid[:, 1:]), (grid[:-1], grid[1:])]
            pairs += [np.stack([one.ravel(), other.ravel()], axis=1) for one, other in both]
        else:
            places = layout.positions[patch.taxels]
            apart = np.linalg.norm(places[:, None] - places, axis=-1)
            np.fill_diagonal(apart, np.inf)
            near = apart <= NEAR * apart.min(axis=1, keepdims=True)
            pairs.append(taxels[np.argwhere(np.triu(near | near.T, k=1))])
    return np.concatenate(pairs)


def _error(got: np.ndarray, truth: np.ndarray) -> float:
    return _ratio(got - truth, truth)


def _ratio(values: np.ndarray, to: np.ndarray) -> float:
    size = float(np.linalg.norm(to))
    return float(np.linalg.norm(values)) / size if size > 0 else 0.0
