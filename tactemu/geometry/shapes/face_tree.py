"""A tree over the faces of a mesh that finds the face nearest to a point.

Each node has four children, and the faces are dealt out evenly, so that no links are stored: the children of node ``i``
are ``4 i + 1`` to ``4 i + 4``. A flat cylinder bounds the faces of a child; its axis is their mean normal. A search
opens all nodes that its ball cuts. A box along the axes around a slanted face sticks out of the surface by a good part
of the face's size; cylinders follow the surface, so that fewer are cut.
"""

# pyright: reportGeneralTypeIssues=false

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import warp as wp

CHILDREN = 4
"""Number of children of a node."""
FACES_PER_LEAF = 2
"""Most faces of a leaf, on average."""
_MARGIN = 2.0e-6
"""Addition to the extents of a cylinder, in units of the mesh, so that rounding never hides a face."""


@dataclass(frozen=True, eq=False)
class FaceTree:
    """The tree of one mesh, in the units of its stored points."""

    cylinders: np.ndarray
    """Centre, axis, half height and radius of the children of each inner node, shape ``(n, 8, 4)``, float32."""
    faces: np.ndarray
    """A corner and two sides of each face, leaf by leaf, shape ``(m, 12)``, float32; the number behind the corner has
    the bits of the face's index."""
    levels: int
    """Number of levels of inner nodes."""
    seeds: np.ndarray = field(default_factory=lambda: np.empty(0, np.int32))
    """The nearest face at points of a grid, as an index into ``faces``: a search near such a point begins with it."""

    def index_of(self, faces: np.ndarray) -> np.ndarray:
        """Return the indices into ``faces`` of the mesh's faces with these numbers, int32."""
        index = np.empty(len(self.faces), np.int32)
        index[self.faces[:, 3].view(np.int32)] = np.arange(len(self.faces))
        return index[faces]


def build_tree(points: np.ndarray, faces: np.ndarray) -> FaceTree:
    """Return the tree of the faces ``(m, 3)`` between points ``(n, 3)``, which are of unit size."""
    corners = np.asarray(points, np.float32)[faces]
    many, levels = len(faces), 0
    while CHILDREN**levels * FACES_PER_LEAF < many:
        levels += 1
    order = _sorted(corners.mean(axis=1), 2 * levels)
    corner, *others = (np.ascontiguousarray(corners[order, k]) for k in range(3))
    sides = others[0] - corner, others[1] - corner
    normals, parts = np.cross(*sides), [_starts(many, CHILDREN**level) for level in range(1, levels + 1)]
    cylinders = [_cylinders((corner, *others), normals, starts) for starts in parts]
    blocks = np.concatenate([np.empty((0, 8), np.float32), *cylinders]).reshape(-1, CHILDREN, 8)
    stored = np.zeros((many, 12), np.float32)
    stored[:, :3], stored[:, 3] = corner, order.astype(np.int32).view(np.float32)
    stored[:, 4:7], stored[:, 8:11] = sides
    return FaceTree(np.ascontiguousarray(blocks.transpose(0, 2, 1)), stored, levels)


def _starts(many: int, parts: int) -> np.ndarray:
    """Return the index of the first of ``many`` in each of so many equal ``parts``."""
    return np.arange(parts, dtype=np.int64) * many // parts


def _sorted(middles: np.ndarray, splits: int) -> np.ndarray:
    """Return the order of faces in which each part of 2, 4, 8 ... equal parts is one side of its parent along the
    longest axis of the middles ``(m, 3)``."""
    many, order = len(middles), np.arange(len(middles))
    for split in range(splits):
        starts = _starts(many, 2**split)
        part = np.repeat(np.arange(2**split), np.diff(np.append(starts, many)))
        here = middles[order]
        low, high = np.minimum.reduceat(here, starts), np.maximum.reduceat(here, starts)
        axis = np.argmax(high - low, axis=1)
        along, size = np.take_along_axis(here, axis[part][:, None], 1)[:, 0], (high - low).max(axis=1)
        least = np.take_along_axis(low, axis[:, None], 1)[:, 0]
        order = order[np.argsort(part + 0.999 * (along - least[part]) / np.maximum(size[part], 1e-30), kind="stable")]
    return order


def _cylinders(corners: Sequence[np.ndarray], normals: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Return the cylinder around the faces of each part, shape ``(parts, 8)``, from their three corners ``(m, 3)``
    each; where faces are fewer than parts, some hold a face too many."""
    axis = np.add.reduceat(normals, starts)
    length = np.linalg.norm(axis, axis=1, keepdims=True)
    axis = np.where(length > 0.0, axis / np.where(length > 0.0, length, 1.0), [0.0, 0.0, 1.0]).astype(np.float32)
    low = functools.reduce(np.minimum, (np.minimum.reduceat(corner, starts) for corner in corners))
    high = functools.reduce(np.maximum, (np.maximum.reduceat(corner, starts) for corner in corners))
    centre = 0.5 * (low + high)
    part = np.repeat(np.arange(len(starts)), np.diff(np.append(starts, len(normals))))
    bottom, top, aside = (np.full(len(starts), start, np.float32) for start in (np.inf, -np.inf, 0.0))
    axes, centres = axis[part], centre[part]
    for corner in corners:
        away = corner - centres
        along = np.einsum("ij,ij->i", away, axes)
        bottom = np.minimum(bottom, np.minimum.reduceat(along, starts))
        top = np.maximum(top, np.maximum.reduceat(along, starts))
        aside = np.maximum(aside, np.maximum.reduceat(np.einsum("ij,ij->i", away, away) - along * along, starts))
    height, radius = 0.5 * (top - bottom) + _MARGIN, np.sqrt(aside) * (1.0 + 1e-5) + _MARGIN
    return np.column_stack([centre + axis * (0.5 * (bottom + top))[:, None], axis, height, radius]).astype(np.float32)


@functools.cache
def trees_type():
    """Return the Warp struct of the trees of one or several meshes, one behind the other."""

    @wp.struct
    class FaceTrees:
        places: wp.array(dtype=wp.vec4i)  # of each body: its first inner node and first face, its faces and its levels
        first_seed: wp.array(dtype=wp.int32)  # of each body
        seeds: wp.array(dtype=wp.int32)
        cylinders: wp.array(dtype=wp.vec4)
        faces: wp.array(dtype=wp.vec4)

    return FaceTrees


def upload_trees(bodies: Sequence[FaceTree | None], device):
    """Return the trees of bodies on the device; bodies may share one."""
    parts = list({id(tree): tree for tree in bodies if tree is not None}.values())
    sizes = [(len(tree.cylinders), len(tree.faces), len(tree.seeds)) for tree in parts]
    ends = np.cumsum([(0, 0, 0), *sizes], axis=0)
    place = {id(tree): (*ends[k, :2], len(tree.faces), tree.levels) for k, tree in enumerate(parts)}
    first_seed = {id(tree): ends[k, 2] for k, tree in enumerate(parts)}

    def uploaded(values: list[np.ndarray], dtype) -> wp.array:
        together = values[0] if len(values) == 1 else np.concatenate(values or [np.empty(0, np.float32)])
        rows = together.reshape(-1, 4) if dtype is wp.vec4 else together
        # on a CPU the kernels read this very array: nothing writes to it
        return wp.array(np.ascontiguousarray(rows), dtype=dtype, device=device, copy=False)

    # on a GPU a thread reads the numbers of one child, on a CPU a SIMD vector reads one number of each
    axes = (0, 1, 2) if wp.get_device(device).is_cpu else (0, 2, 1)
    trees = trees_type()()
    trees.places = wp.array([place.get(id(tree), (0, 0, 0, 0)) for tree in bodies], dtype=wp.vec4i, device=device)
    trees.first_seed = wp.array([first_seed.get(id(tree), 0) for tree in bodies], dtype=wp.int32, device=device)
    trees.seeds = uploaded([tree.seeds for tree in parts], wp.int32)
    trees.cylinders = uploaded([tree.cylinders.transpose(axes) for tree in parts], wp.vec4)
    trees.faces = uploaded([tree.faces for tree in parts], wp.vec4)
    return trees


@functools.cache
def nearest_face_function():
    """Return ``nearest_face(trees, body, p, farthest, seed)``, the number of the face nearest to ``p`` and nearer than
    ``farthest``, or -1. ``seed`` is a seed of the body, or -1. Points are in units of the mesh."""

    @wp.func_native(_SEARCH)
    def nearest_face(trees: trees_type(), body: int, p: wp.vec3, farthest: float, seed: int) -> int: ...

    return nearest_face


_SEARCH = """
    struct alignas(16) Quad { float x, y, z, w; };
    const auto place = trees.places.data[body];
    const Quad* const nodes = reinterpret_cast<const Quad*>(trees.cylinders.data) + 8 * (int64_t)place[0];
    const Quad* const faces = reinterpret_cast<const Quad*>(trees.faces.data) + 3 * (int64_t)place[1];
    const int many = place[2], levels = place[3], leaves = 1 << 2 * levels, inner = (leaves - 1) / 3;
    const float px = p[0], py = p[1], pz = p[2];
    float best = farthest * farthest;
    int found = -1;
    auto first_of = [&](const int leaf) -> int { return (int64_t)leaf * many >> 2 * levels; };
    auto try_face = [&](const int k) {
        const Quad a = faces[3 * k], u = faces[3 * k + 1], v = faces[3 * k + 2];
        const float ax = px - a.x, ay = py - a.y, az = pz - a.z;
        const float au = ax * u.x + ay * u.y + az * u.z, av = ax * v.x + ay * v.y + az * v.z;
        const float uu = u.x * u.x + u.y * u.y + u.z * u.z, vv = v.x * v.x + v.y * v.y + v.z * v.z;
        const float uv = u.x * v.x + u.y * v.y + u.z * v.z;
        const float det = uu * vv - uv * uv, s = vv * au - uv * av, t = uu * av - uv * au;
        auto squared = [&](const float s, const float t) {
            const float x = ax - s * u.x - t * v.x, y = ay - s * u.y - t * v.y, z = az - s * u.z - t * v.z;
            return x * x + y * y + z * z;
        };
        auto clamped = [](const float x) { return wp::min(wp::max(x, 0.0f), 1.0f); };
        float least;
        if (s >= 0.0f && t >= 0.0f && s + t < det)
            least = squared(s / det, t / det);
        else {
            const float across = clamped((av - au + uu - uv) / (uu + vv - 2.0f * uv));
            least = wp::min(squared(clamped(au / uu), 0.0f), squared(0.0f, clamped(av / vv)));
            least = wp::min(least, squared(1.0f - across, across));
        }
        if (least < best) {
            best = least;
            found = reinterpret_cast<const int&>(a.w);
        }
    };
#if defined(__CUDA_ARCH__)
    auto bounds_of = [&](const int i, float* const out) {
        for (int k = 0; k < 4; ++k) {
            const Quad a = nodes[8 * i + 2 * k], b = nodes[8 * i + 2 * k + 1];
            const float dx = px - a.x, dy = py - a.y, dz = pz - a.z, along = dx * a.w + dy * b.x + dz * b.y;
            const float aside = wp::sqrt(wp::max(dx * dx + dy * dy + dz * dz - along * along, 0.0f));
            const float h = wp::max(wp::abs(along) - b.z, 0.0f), r = wp::max(aside - b.w, 0.0f);
            out[k] = h * h + r * r;
        }
    };
#else
    auto bounds_of = [&](const int i, float* const out) {
        typedef float Four __attribute__((vector_size(16), aligned(4)));
        const Four* const c = reinterpret_cast<const Four*>(nodes) + 8 * (int64_t)i;
        const Four zero = {}, dx = px - c[0], dy = py - c[1], dz = pz - c[2];
        const Four along = dx * c[3] + dy * c[4] + dz * c[5], squared = dx * dx + dy * dy + dz * dz - along * along;
        const Four aside = __builtin_elementwise_sqrt(__builtin_elementwise_max(squared, zero));
        const Four h = __builtin_elementwise_max(__builtin_elementwise_abs(along) - c[6], zero);
        const Four r = __builtin_elementwise_max(aside - c[7], zero);
        *reinterpret_cast<Four*>(out) = h * h + r * r;
    };
#endif
    if (seed >= 0)
        try_face(trees.seeds.data[trees.first_seed.data[body] + seed]);
    struct Waiting { int node; float bound; } waiting[40];
    int i = 0, top = 0;
    while (true) {
        if (i < inner) {
            float b[4];
            bounds_of(i, b);
            const float least = wp::min(wp::min(b[0], b[1]), wp::min(b[2], b[3]));
            if (least < best) {
                const int nearest = b[0] == least ? 0 : b[1] == least ? 1 : b[2] == least ? 2 : 3;
                for (int k = 0; k < 4; ++k)
                    if (k != nearest && b[k] < best)
                        waiting[top++] = Waiting{4 * i + 1 + k, b[k]};
                i = 4 * i + 1 + nearest;
                continue;
            }
        } else
            for (int k = first_of(i - inner); k < first_of(i - inner + 1); ++k)
                try_face(k);
        do {
            if (top == 0)
                return found;
        } while (!(waiting[--top].bound < best));
        i = waiting[top].node;
    }
"""
"""The search opens the nearest child first; others wait on a stack. ``bounds_of`` finds the smallest squared distances
to what the cylinders of a node's children hold."""
