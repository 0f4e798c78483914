"""Convolution weights on a grid as sums of products: ``K[dy, dx] = sum_t row_t[dy] col_t[dx]``.

A Gaussian is one product, and the smooth far-reaching weights of an elastomer need 7 to 20 of them to be exact to the
last digit. A convolution then takes two short passes that skip everything outside the contact, which is faster than a
padded FFT at every size of a real skin, and has no periodic images.
"""

from __future__ import annotations

import numpy as np

_MAX_EXACT_SIDE = 200
"""Largest side of a table that is decomposed exactly; a larger one is projected at random onto half as many
directions."""


def _parity_parts(table: np.ndarray):
    """Yield the even and odd parts along both axes, with their signs, of a table over signed offsets, centre in the
    middle."""
    for row_sign in (1, -1):
        half = (table + row_sign * table[::-1]) / 2
        for col_sign in (1, -1):
            yield row_sign, col_sign, (half + col_sign * half[:, ::-1]) / 2


def _mirror(vectors: np.ndarray, sign: int) -> np.ndarray:
    """Extend vectors over offsets 0..n-1, shape ``(terms, n)``, to -(n-1)..n-1."""
    return np.concatenate([sign * vectors[:, :0:-1], vectors], axis=1)


def _svd(table: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the singular value decomposition; of a large table only the part that the tolerance needs, by random
    projection."""
    if min(table.shape) > _MAX_EXACT_SIDE:
        probe = np.random.default_rng(0).normal(size=(table.shape[1], _MAX_EXACT_SIDE // 2))
        basis, _ = np.linalg.qr(table @ probe)
        left, strength, right = np.linalg.svd(basis.T @ table, full_matrices=False)
        left = basis @ left
        if np.abs((left * strength) @ right - table).max() <= tolerance * strength[0]:
            return left, strength, right
    return np.linalg.svd(table, full_matrices=False)


def separable_terms(table: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Return rows and columns of the fewest products that add up to ``table``.

    Args:
        table: weights at signed offsets, shape ``(2 rows - 1, 2 cols - 1)``, offset 0 in the middle.
        tolerance: largest error allowed, as a part of the table's largest singular value.

    Returns:
        ``(row, col)``, shapes ``(terms, 2 rows - 1)`` and ``(terms, 2 cols - 1)``; one term of zeros for a zero table.
    """
    cy, cx = table.shape[0] // 2, table.shape[1] // 2
    parts = []
    for row_sign, col_sign, part in _parity_parts(table):
        quarter = part[cy:, cx:]
        if np.any(quarter):
            parts.append((row_sign, col_sign, *_svd(quarter, tolerance)))
    largest = max((strength[0] for *_, strength, _ in parts), default=0.0)
    rows, cols = [], []
    for row_sign, col_sign, left, strength, right in parts:
        keep = strength > tolerance * largest
        root = np.sqrt(strength[keep])
        rows.append(_mirror(left.T[keep] * root[:, None], row_sign))
        cols.append(_mirror(right[keep] * root[:, None], col_sign))
    if not rows:
        return np.zeros((1, table.shape[0])), np.zeros((1, table.shape[1]))
    return np.concatenate(rows), np.concatenate(cols)


def overlapping_blocks(vectors: np.ndarray, width: int) -> np.ndarray:
    """Return ``blocks[t, k, m] = vectors[t, k + m]``, zero past the end: a thread loads ``width`` neighbours at
    once."""
    padded = np.pad(vectors, ((0, 0), (0, width)))
    return np.stack([padded[:, m : m + vectors.shape[1]] for m in range(width)], axis=-1)
