"""The nearest point of a mesh's faces to a point, and the normal of the feature on which it lies, as Warp functions."""

# pyright: reportIndexIssue=false

import functools
from collections.abc import Sequence

import numpy as np
import warp as wp

from tactemu.geometry.shapes.mesh_features import Features

MAX_NEIGHBOUR_STEPS = 24
"""Most faces around a vertex that are compared with the face that the search found."""


@functools.cache
def surfaces_type(real):
    """Return the Warp struct of the faces, edges and vertices of one or several meshes, relative to their middles."""
    vec3 = wp.types.vector(3, real)

    @wp.struct
    class Surfaces:
        points: wp.array(dtype=vec3)
        point_normals: wp.array(dtype=vec3)
        side_normals: wp.array2d(dtype=vec3)  # per face: its own normal, and those of its three sides
        beside: wp.array(dtype=wp.vec3i)  # the face beyond each side, counted from the mesh's first; -1: none

    return Surfaces


def upload_surfaces(parts: Sequence[Features], real, device):
    """Return the surfaces of meshes on the device, one behind the other."""
    surfaces, vec3 = surfaces_type(real)(), wp.types.vector(3, real)

    def uploaded(name: str, dtype, number: type, *width: int) -> wp.array:
        values = [getattr(each, name) for each in parts] or [np.zeros((1, *width))]
        together = values[0] if len(values) == 1 else np.concatenate(values)
        # on a CPU the kernels read this very array: nothing writes to it
        return wp.array(np.ascontiguousarray(together, number), dtype=dtype, device=device, copy=False)

    number = np.float32 if real is wp.float32 else np.float64
    surfaces.points = uploaded("points", vec3, number, 3)
    surfaces.point_normals = uploaded("point_normals", vec3, number, 3)
    surfaces.side_normals = uploaded("side_normals", vec3, number, 4, 3)
    surfaces.beside = uploaded("beside", wp.vec3i, np.int32, 3)
    return surfaces


@functools.cache
def feature_functions(real):
    """Return two Warp functions: one for the nearest point of a face, one that also tries the faces around it.

    ``foot(surfaces, mesh, first, face, p) -> (gap, feature)`` and ``nearest(surfaces, mesh, first, found, p) -> (face,
    gap, feature)``. ``gap`` points from the nearest point of the face to ``p``, which
    is relative to the middle of the mesh. Feature 0 is the face's inside, 1 to 3 are its sides, 4 to 6 its corners.
    """
    vec3, surfaces_struct = wp.types.vector(3, real), surfaces_type(real)

    @wp.func
    def foot(surfaces: surfaces_struct, mesh: wp.uint64, first: wp.vec2i, face: int, p: vec3):
        n = surfaces.side_normals[first[1] + face, 0]
        a = surfaces.points[first[0] + wp.mesh_get_index(mesh, 3 * face)]
        b = surfaces.points[first[0] + wp.mesh_get_index(mesh, 3 * face + 1)]
        c = surfaces.points[first[0] + wp.mesh_get_index(mesh, 3 * face + 2)]
        gap = wp.dot(p - a, n) * n
        feature = int(0)
        least = real(wp.inf)
        for k in range(3):
            start = a
            way = b - a
            if k == 1:
                start = b
                way = c - b
            elif k == 2:
                start = c
                way = a - c
            from_start = p - start
            if wp.dot(wp.cross(n, way), from_start) < real(0.0):  # beyond this side
                along = wp.dot(from_start, way)
                squared = wp.dot(way, way)
                here = from_start
                which = 4 + k
                if along >= squared:
                    here = from_start - way
                    which = 4 + (k + 1) % 3
                elif along > real(0.0):
                    here = from_start - (along / squared) * way
                    which = 1 + k
                if wp.dot(here, here) < least:
                    least = wp.dot(here, here)
                    gap = here
                    feature = which
        return gap, feature

    @wp.func
    def nearest(surfaces: surfaces_struct, mesh: wp.uint64, first: wp.vec2i, found: int, p: vec3):
        face = int(found)
        gap, feature = foot(surfaces, mesh, first, face, p)
        least = wp.dot(gap, gap)
        at = int(face)
        where = int(feature)
        turns = int(0)
        # The search, in float32, may have found a neighbour of the nearest face, over a side or around a corner. Of two
        # faces the one is nearer on which the foot is less of a corner, whatever rounding does to the lengths.
        while where > 0 and turns < wp.static(MAX_NEIGHBOUR_STEPS):
            turns += 1
            at = surfaces.beside[first[1] + at][(where - 1) % 3]
            if at < 0 or at == face:
                where = 0
            else:
                other, its = foot(surfaces, mesh, first, at, p)
                if wp.dot(other, other) < least or (its + 2) / 3 < (where + 2) / 3:
                    least = wp.dot(other, other)
                    face = at
                    gap = other
                    feature = its
                    where = its
                elif where > 3 and its > 3:
                    where = its
                else:
                    where = 0
        return face, gap, feature

    return foot, nearest


@functools.cache
def normal_function(real):
    """Return the Warp function ``normal_of(surfaces, mesh, first, face, feature)``.

    It returns the normal of a face, an edge or a vertex.
    """

    @wp.func
    def normal_of(surfaces: surfaces_type(real), mesh: wp.uint64, first: wp.vec2i, face: int, feature: int):
        if feature < 4:
            return surfaces.side_normals[first[1] + face, feature]
        return surfaces.point_normals[first[0] + wp.mesh_get_index(mesh, 3 * face + feature - 4)]

    return normal_of
