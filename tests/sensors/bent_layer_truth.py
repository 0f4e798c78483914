"""The truth for bent pads: a linear elastic layer bonded to a rigid cylinder, in plane strain, by finite elements.

Half of a strip ``[0, length]`` in arc length of its outer face (from the middle of the contact) times the thickness,
bent with a radius of that face (positive: convex), in quadrilaterals of nine nodes. The bottom is held, the middle is a
plane of symmetry, the far end is free. Without friction, the face is moved in by at least a given overlap along its
normals.
"""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

_GAUSS = np.array([-np.sqrt(0.6), 0.0, np.sqrt(0.6)]), np.array([5.0, 8.0, 5.0]) / 9.0


def _shapes(a):
    return (
        np.array([a * (a - 1) / 2, 1 - a * a, a * (a + 1) / 2]),
        np.array([a - 0.5, -2 * a, a + 0.5]),
    )


def contact(give, overlap):
    """Force into the layer at each node, zero or more: it goes in by the overlap where it is pressed."""
    active = overlap > 0
    force = np.zeros(len(overlap))
    for _ in range(100):
        force[:] = 0.0
        force[active] = np.linalg.solve(give[np.ix_(active, active)], overlap[active])
        gap = give @ force - overlap
        new = np.where(active, force > 0, gap < -1e-12 * np.abs(overlap).max())
        if (new == active).all():
            return force
        active = new
    raise AssertionError("the contact does not settle")


class BentLayer:
    """Stiffness of the strip, condensed to its face.

    Args:
        young, nu: of the material.
        thickness: of the layer.
        radius: of the outer face; ``inf``: flat.
        length: of half of the strip.
        n, m: elements along and across.
    """

    def __init__(self, young, nu, thickness, radius, length, n=120, m=12):
        along = length * np.linspace(0, 1, 2 * n + 1) ** 1.5
        across = np.linspace(0.0, thickness, 2 * m + 1)
        s, y = np.meshgrid(along, across, indexing="ij")
        if np.isinf(radius):
            x = np.stack([s, y - thickness], -1)
        else:
            r, angle = radius + y - thickness, s / radius
            x = np.stack([r * np.sin(angle), r * np.cos(angle) - radius], -1)
        rows = 2 * m + 1
        first = (2 * np.arange(n)[:, None] * rows + 2 * np.arange(m)[None]).ravel()
        nodes = first[:, None] + (np.arange(3)[:, None] * rows + np.arange(3)[None]).ravel()
        dofs = (2 * nodes[..., None] + np.arange(2)).reshape(len(nodes), -1)
        lame, shear = young * nu / ((1 + nu) * (1 - 2 * nu)), young / (2 * (1 + nu))
        law = np.array([[lame + 2 * shear, lame, 0], [lame, lame + 2 * shear, 0], [0, 0, shear]])
        places, stiff = x.reshape(-1, 2)[nodes], np.zeros((len(nodes), 18, 18))
        for a, wa in zip(*_GAUSS):
            for b, wb in zip(*_GAUSS):
                (na, da), (nb, db) = _shapes(a), _shapes(b)
                slopes = np.stack([np.outer(da, nb).ravel(), np.outer(na, db).ravel()])
                jacobian = slopes @ places
                real = np.linalg.solve(jacobian, np.broadcast_to(slopes, (len(nodes), 2, 9)))
                strain = np.zeros((len(nodes), 3, 18))
                strain[:, 0, 0::2], strain[:, 1, 1::2] = real[:, 0], real[:, 1]
                strain[:, 2, 0::2], strain[:, 2, 1::2] = real[:, 1], real[:, 0]
                weight = wa * wb * np.abs(np.linalg.det(jacobian))
                stiff += weight[:, None, None] * (strain.swapaxes(1, 2) @ law @ strain)
        size = 2 * x.shape[0] * rows
        k = np.repeat(dofs, 18, axis=1).ravel(), np.tile(dofs, (1, 18)).ravel()
        whole = sp.csc_matrix((stiff.ravel(), k), shape=(size, size))
        number = np.arange(x.shape[0] * rows).reshape(x.shape[0], rows)
        held = np.unique(np.concatenate([2 * number[:, 0], 2 * number[:, 0] + 1, 2 * number[0]]))
        free = np.setdiff1d(np.arange(size), held)
        face = number[:, -1]
        self.along, self.normals = along, np.stack([np.sin(along / radius), np.cos(along / radius)], -1)
        """Arc length of the face's nodes, and the way out of it."""
        push = sp.lil_matrix((size, len(face)))
        for j, (node, normal) in enumerate(zip(face, self.normals)):
            push[2 * node, j], push[2 * node + 1, j] = -normal
        push = push.tocsc()[free]
        solved = splu(whole[free][:, free].tocsc()).solve(push.toarray())
        self.give = push.T @ solved
        """How far each node of the face goes in for a force on each, half of the strip."""

    def lift(self, overlap):
        """Total force along the middle's normal per length of the pad [N/m], both halves."""
        return 2.0 * float(contact(self.give, overlap) @ self.normals[:, 1])


def overlap_of_cylinder(along, radius, indenter, depth):
    """How deep each place of the face is, along its normal, in a cylinder ``depth`` deep; far away less than 0."""
    angle = 0.0 * along if np.isinf(radius) else along / radius
    place = np.stack([along, 0 * along], -1) if np.isinf(radius) else radius * np.stack(
        [np.sin(angle), np.cos(angle) - 1.0], -1)  # fmt: skip
    out = np.stack([np.sin(angle), np.cos(angle)], -1)
    centre = np.array([0.0, indenter - depth])
    away = place - centre
    along_out = (away * out).sum(-1)
    inside = along_out**2 - (away**2).sum(-1) + indenter**2
    with np.errstate(invalid="ignore"):
        entry = -along_out - np.sqrt(inside)  # height of the cylinder's lower face over the place
    return np.where(inside > 0, -entry, -1.0)


class BentPad:
    """The same in three dimensions: a quarter of a pad that is bent along both sides, in bricks of 27 nodes.

    Its face is an arc along x that is moved along an arc along y.

    Args:
        young, nu: of the material.
        thickness: of the layer.
        radii: of the face along x and y; ``inf``: straight, negative: concave.
        length: of half of each side.
        reach: contact is looked for so far from the middle, along both sides.
        n, m: elements along and across.
    """

    def __init__(self, young, nu, thickness, radii, length, reach, n=12, m=4):
        along = length * np.linspace(0, 1, 2 * n + 1) ** 1.5
        across = np.linspace(-thickness, 0.0, 2 * m + 1)
        face, out = self.surface(along[:, None], along[None, :], radii)
        places = (face[:, :, None] + across[:, None] * out[:, :, None]).reshape(-1, 3)
        number = np.arange(len(places)).reshape(len(along), len(along), len(across))
        first = number[:-1:2, :-1:2, :-1:2].ravel()
        near = (number[:3, :3, :3] - number[0, 0, 0]).ravel()
        nodes = first[:, None] + near
        lame, shear = young * nu / ((1 + nu) * (1 - 2 * nu)), young / (2 * (1 + nu))
        law = np.diag([2 * shear] * 3 + [shear] * 3)
        law[:3, :3] += lame
        stiff = np.zeros((len(nodes), 81, 81))
        for i, j, k in np.ndindex(3, 3, 3):
            (fi, di), (fj, dj), (fk, dk) = (_shapes(_GAUSS[0][at]) for at in (i, j, k))
            slopes = np.stack(
                [
                    np.einsum("a,b,c", di, fj, fk).ravel(),
                    np.einsum("a,b,c", fi, dj, fk).ravel(),
                    np.einsum("a,b,c", fi, fj, dk).ravel(),
                ]
            )
            jacobian = slopes @ places[nodes]
            x, y, z = np.moveaxis(np.linalg.solve(jacobian, np.broadcast_to(slopes, (len(nodes), 3, 27))), 1, 0)
            strain = np.zeros((len(nodes), 6, 81))
            strain[:, 0, 0::3], strain[:, 1, 1::3], strain[:, 2, 2::3] = x, y, z
            strain[:, 3, 0::3], strain[:, 3, 1::3] = y, x
            strain[:, 4, 1::3], strain[:, 4, 2::3] = z, y
            strain[:, 5, 0::3], strain[:, 5, 2::3] = z, x
            weight = _GAUSS[1][i] * _GAUSS[1][j] * _GAUSS[1][k] * np.abs(np.linalg.det(jacobian))
            stiff += weight[:, None, None] * (strain.swapaxes(1, 2) @ law @ strain)
        dofs = (3 * nodes[..., None] + np.arange(3)).reshape(len(nodes), -1)
        k = np.repeat(dofs, 81, axis=1).ravel(), np.tile(dofs, (1, 81)).ravel()
        size = 3 * len(places)
        whole = sp.csc_matrix((stiff.ravel(), k), shape=(size, size))
        bottom = number[:, :, 0].ravel()
        held = np.unique(np.concatenate([
            *(3 * bottom + axis for axis in range(3)), 3 * number[0].ravel(), 3 * number[:, 0].ravel() + 1
        ]))  # fmt: skip
        free = np.setdiff1d(np.arange(size), held)
        inside = along <= reach
        pressed = number[inside][:, inside, -1].ravel()
        self.face, self.normals = face[inside][:, inside].reshape(-1, 3), out[inside][:, inside].reshape(-1, 3)
        """Places and normals of the nodes that may be pressed."""
        push = np.zeros((size, len(pressed)))
        for axis in range(3):
            push[3 * pressed + axis, np.arange(len(pressed))] = -self.normals[:, axis]
        push = push[free]
        self.give = push.T @ splu(whole[free][:, free].tocsc()).solve(push)
        """How far each of them goes in for a force on each, of a quarter."""

    @staticmethod
    def surface(x, y, radii):
        """Places and normals of the face so far along both sides, shapes ``(..., 3)``."""
        x, y = np.broadcast_arrays(x, y)
        place, slope = np.zeros((*x.shape, 3)), []
        for axis, (far, radius) in enumerate(zip((x, y), radii)):
            angle = far / radius
            place[..., axis] = far if np.isinf(radius) else radius * np.sin(angle)
            place[..., 2] += 0.0 if np.isinf(radius) else radius * (np.cos(angle) - 1.0)
            slope.append(np.tan(angle))
        out = np.stack([*slope, np.ones_like(x)], -1)
        return place, out / np.linalg.norm(out, axis=-1, keepdims=True)

    def lift(self, radius, depth):
        """Total force of a ball that is pressed in so deep at the middle [N], along the middle's normal."""
        away = self.face - np.array([0.0, 0.0, radius - depth])
        along_out = (away * self.normals).sum(-1)
        inside = along_out**2 - (away**2).sum(-1) + radius**2
        overlap = np.where(inside > 0, along_out + np.sqrt(np.maximum(inside, 0.0)), -1.0)
        force = contact(self.give, overlap)
        assert not force.reshape(2 * [round(len(force) ** 0.5)])[-1].any(), (
            "contact reaches the end of what may be pressed"
        )
        return 4.0 * float(force @ self.normals[:, 2])
