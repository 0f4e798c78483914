"""Finite elements of a soft ball on a bonded layer, linear and without friction.

``pip install scikit-fem``, then run it: it writes ``soft_ball.json`` beside it. Both bodies are axisymmetric, of
quadratic elements. Each gives the compliance of its surface to rings of pressure, across its own undeformed surface and
without shear; the two are added, and contact follows from the gap of a true ball (Lawson and Hanson's non-negative
least squares). The ball is free: a body force balances the pressure, as where its weight or its inertia presses it, and
depth is that of its mean displacement.
"""

import json
from pathlib import Path

import numpy as np
from scipy.optimize import nnls
from scipy.sparse.linalg import splu
from skfem import Basis, BilinearForm, ElementQuad2, ElementVector, LinearForm, MeshQuad
from skfem.helpers import grad

RADIUS, THICKNESS, YOUNG = 5e-3, 4e-3, 1e5


def graded(near: float, far: float, fine: int, coarse: int) -> np.ndarray:
    """Return nodes from 0 to ``far``, even up to ``near`` and from there in growing steps."""
    step, low, high = near / fine, 1.0, 4.0
    for _ in range(100):
        ratio = (low + high) / 2
        low, high = (low, ratio) if step * np.sum(ratio ** np.arange(1, coarse + 1)) > far - near else (ratio, high)
    rest = near + step * np.cumsum(ratio ** np.arange(1, coarse + 1))
    rest[-1] = far
    return np.concatenate([np.linspace(0, near, fine + 1), rest])


def stiffness(basis: Basis, young: float, nu: float):
    """Return the stiffness matrix of an axisymmetric body."""
    first, second = young * nu / (1 + nu) / (1 - 2 * nu), young / 2 / (1 + nu)

    @BilinearForm
    def energy(u, v, w):
        r, du, dv = w.x[0], grad(u), grad(v)
        a, b = (du[0, 0], du[1, 1], u[0] / r), (dv[0, 0], dv[1, 1], v[0] / r)
        direct = sum(x * y for x, y in zip(a, b))
        shear = (du[0, 1] + du[1, 0]) * (dv[0, 1] + dv[1, 0])
        return 2 * np.pi * r * (first * sum(a) * sum(b) + 2 * second * direct + second * shear)

    return energy.assemble(basis).tocsc()


def solve(matrix, loads: np.ndarray, fixed: np.ndarray) -> np.ndarray:
    """Return displacements by loads (one a column), with some held at zero."""
    free = np.setdiff1d(np.arange(matrix.shape[0]), fixed)
    out = np.zeros_like(loads)
    out[free] = splu(matrix[np.ix_(free, free)].tocsc()).solve(loads[free])
    return out


def surface_nodes(basis: Basis, facets, near: float, component: str = "u^2") -> tuple[np.ndarray, np.ndarray]:
    """Return the unknowns of a surface up to the radius ``near``, vertical ones, outward, and their radii."""
    unknowns = basis.get_dofs(facets).all([component])
    r = basis.doflocs[0, unknowns]
    order = np.argsort(r)
    order = order[r[order] < near * (1 + 1e-9)]
    return unknowns[order], r[order]


def layer_compliance(nodes: np.ndarray, near: float, nu: float, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Return radii, and the depth of each surface node by a force on each other."""
    z = THICKNESS - graded(0.3 * THICKNESS, THICKNESS, rows, rows)
    mesh = MeshQuad.init_tensor(nodes, np.sort(np.abs(z)))
    basis = Basis(mesh, ElementVector(ElementQuad2()), intorder=5)
    top = mesh.facets_satisfying(lambda x: np.abs(x[1] - THICKNESS) < 1e-9 * THICKNESS)
    held = basis.get_dofs(mesh.facets_satisfying(lambda x: x[1] < 1e-9 * THICKNESS)).all()
    axis = basis.get_dofs(mesh.facets_satisfying(lambda x: x[0] < 1e-12)).all(["u^1"])
    unknowns, r = surface_nodes(basis, top, near)
    loads = np.zeros((basis.N, len(unknowns)))
    loads[unknowns, np.arange(len(unknowns))] = -1.0
    return r, -solve(stiffness(basis, YOUNG, nu), loads, np.union1d(held, axis))[unknowns]


def ball_compliance(nodes: np.ndarray, near: float, young: float, nu: float, rows: int):
    """Return radii, and the rise of each node at the bottom by a force on each other, relative to the ball's mean."""
    angle = np.arcsin(np.minimum(nodes[nodes < 0.9 * RADIUS] / RADIUS, 1))
    angle = np.concatenate([angle, np.linspace(angle[-1], np.pi, 2 * rows)[1:]])
    depth = graded(0.2 * RADIUS, 0.98 * RADIUS, rows, rows)
    plane = MeshQuad.init_tensor(angle, np.sort(RADIUS - depth))
    mesh = MeshQuad(np.array([plane.p[1] * np.sin(plane.p[0]), -plane.p[1] * np.cos(plane.p[0])]), plane.t)
    mesh.p[0][np.abs(mesh.p[0]) < 1e-12 * RADIUS] = 0.0
    basis = Basis(mesh, ElementVector(ElementQuad2()), intorder=5)
    outside = mesh.facets_satisfying(
        lambda x: (np.hypot(x[0], x[1]) > RADIUS * 0.999) & (x[1] < 0), boundaries_only=True
    )
    axis = basis.get_dofs(mesh.facets_satisfying(lambda x: x[0] < 1e-9 * RADIUS)).all(["u^1"])
    unknowns, r = surface_nodes(basis, outside, near)
    radial, _ = surface_nodes(basis, outside, near, "u^1")
    sine, each = r / RADIUS, np.arange(len(r))
    cosine = np.sqrt(1 - sine**2)

    @LinearForm
    def weight(v, w):
        return 2 * np.pi * w.x[0] * v[1]

    mass = weight.assemble(basis) / (4 / 3 * np.pi * RADIUS**3)
    loads = -mass[:, None] * cosine[None, :]
    loads[unknowns, each] += cosine
    loads[radial, each] -= sine
    top = basis.get_dofs(mesh.facets_satisfying(lambda x: (x[0] < 1e-9 * RADIUS) & (x[1] > 0))).all(["u^2"])
    moved = solve(stiffness(basis, young, nu), loads, np.union1d(axis, top[:1]))
    mean = mass @ moved
    return r, (moved[unknowns] - mean) * cosine[:, None] - moved[radial] * sine[:, None]


def force(near: float, depth: float, layer: tuple, ball: tuple | None) -> tuple[float, float]:
    """Return the force [N] and the radius of contact [m]."""
    r, compliance = layer
    if ball is not None:
        assert np.allclose(ball[0], r, rtol=1e-3, atol=1e-9), np.abs(ball[0] - r).max()
        compliance = compliance + ball[1]
    gap = depth - (RADIUS - np.sqrt(RADIUS**2 - r**2))
    # p >= 0, C p >= gap, p (C p - gap) = 0 is the least of p C p / 2 - p gap: non-negative least squares of C's root
    symmetric = (compliance + compliance.T) / 2
    values, vectors = np.linalg.eigh(symmetric)
    root = (vectors * np.sqrt(np.maximum(values, 0))).T
    inverse = (vectors / np.sqrt(np.maximum(values, 1e-14 * values.max()))).T
    pressed, _ = nnls(root, inverse @ gap, maxiter=20 * len(r))
    return float(pressed.sum()), float(r[pressed > 0].max())


def main() -> None:
    """Compute all cases on two meshes, and write those of the finer one with the change."""
    cases = []
    for nu, young, object_nu, depth in (
        (0.49, None, 0.5, 1e-4), (0.49, 1e6, 0.3, 1e-4), (0.49, 1e5, 0.3, 1e-4), (0.3, 1e5, 0.45, 1e-4),
        (0.49, 1e6, 0.3, 4e-4), (0.49, 1e5, 0.3, 4e-4), (0.3, 3e4, 0.3, 1e-4), (0.45, 3e5, 0.49, 4e-4),
    ):  # fmt: skip
        near = 1.45 * np.sqrt(RADIUS * depth)
        found = []
        for fine, rows in ((24, 14), (40, 22)):
            nodes = graded(near, 10 * THICKNESS, fine, rows)
            layer = layer_compliance(nodes, near, nu, rows)
            ball = None if young is None else ball_compliance(nodes, near, young, object_nu, rows)
            found.append(force(near, depth, layer, ball))
        newtons, radius = found[-1]
        cases.append(
            {"nu": nu, "object_E": young, "object_nu": object_nu, "d": depth, "F": float(f"{newtons:.6g}"),
             "a": float(f"{radius:.3g}"), "change": float(f"{newtons / found[0][0] - 1:.1e}")}
        )  # fmt: skip
        print(cases[-1], flush=True)
    out = {"E": YOUNG, "h": THICKNESS, "R": RADIUS, "cases": cases}
    Path(__file__).with_suffix(".json").write_text(json.dumps(out, indent=1) + "\n")


if __name__ == "__main__":
    main()
