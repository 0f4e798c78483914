"""The overlap of :mod:`.overlap` on a CPU where every sensed body is a ball and the skin is flat.

It finds eight cells of a row at a time in vector registers, operation by operation as a single cell, so that both give
equal overlaps.
"""

# pyright: reportGeneralTypeIssues=false

import functools

import warp as wp

from tactemu.geometry.shapes.shape import FAR
from tactemu.geometry.shapes.sphere import SPHERE
from tactemu.geometry.simd import ROTATION, vector_prelude
from tactemu.sensors.sensed import sensed_type


def is_ball_overlap(kinds: frozenset, is_bent: bool) -> bool:
    """Return True if :func:`ball_row` computes the overlaps with these kinds of shape."""
    return kinds == {SPHERE} and not is_bent


@functools.cache
def ball_row(real, cells_struct, overlap_struct, with_slide: bool, no_surface: float):
    """Return ``find_row(sensed, cells, over, env, y)``, which writes the overlaps of a row of active cells."""
    names = {"WITH_SLIDE": str(with_slide).lower(), "NO_SURFACE": repr(no_surface), "FAR": repr(FAR)}
    snippet = vector_prelude(real) + ROTATION + _ROW
    for name, value in names.items():
        snippet = snippet.replace(name, value)

    @wp.func_native(snippet)
    def find_row(sensed: sensed_type(real), cells: cells_struct, over: overlap_struct, env: int, y: int): ...

    return find_row


_ROW = """
    auto dot = [](const auto& a, const auto& b) { return a.x * b.x + a.y * b.y + a.z * b.z; };
    auto root = [](const Vector& v) { return __builtin_elementwise_sqrt(v); };
    struct Axis { Number x, y, z; };
    auto axis = [](const auto& v) { return Axis{v[0], v[1], v[2]}; };
    const Axis n = axis(cells.n), u = axis(cells.u), v = axis(cells.v);
    const auto box = over.active.data[env];
    const int columns = cells.shape[1], n_targets = sensed.targets.shape[0];
    const auto* const poses = &wp::index(sensed.pose, env, 0);
    const auto* const centres = cells.centres.data + y * int64_t(columns);
    const Number* const reaches = cells.reach.data + y * int64_t(columns);
    const bool* const covered = cells.covered.data + y * int64_t(columns);
    const int64_t place = (env * int64_t(cells.shape[0]) + y) * columns;
    Number* const overlaps = over.overlap.data + place;
    const Number pitch = cells.pitch;
    const Vector zero = {};
    for (int first = box[1]; first < box[3]; first += wide) {
        const int count = box[3] - first < wide ? box[3] - first : wide;
        Vectors r;
        Vector reach = {};
        Mask is_covered = {};
        for (int l = 0; l < wide; ++l) {
            const int cell = first + (l < count ? l : count - 1);
            r.x[l] = centres[cell][0], r.y[l] = centres[cell][1], r.z[l] = centres[cell][2];
            reach[l] = reaches[cell], is_covered[l] = covered[cell] ? -1 : 0;
        }
        Vector lowest = zero + Number(cells.horizon);
        Mask body = Mask{} - 1;
        for (int t = 0; t < n_targets; ++t) {
            const int b = sensed.targets.data[t];
            const auto& at = poses[b].p;
            const Number bound = sensed.shapes.bound.data[b], radius = sensed.shapes.size.data[b][0];
            const Vectors away = {at[0] - r.x, at[1] - r.y, at[2] - r.z};
            const Vector height = dot(away, n);
            const Vectors beside = {away.x - height * n.x, away.y - height * n.y, away.z - height * n.z};
            const Mask may_touch = ~((dot(beside, beside) > bound * bound) | (height - bound > lowest));
            const Vectors o = {r.x - at[0], r.y - at[1], r.z - at[2]};
            const Vector along = dot(o, n);
            const Vectors aside = {o.x - along * n.x, o.y - along * n.y, o.z - along * n.z};
            const Vector across = root(dot(aside, aside));
            const Vector drop = across * across / (radius + root((radius - across) * (radius + across)));
            const Mask meets = across <= radius;
            Vector start = meets ? (-along - radius) + drop : zero + Number(FAR);
            const Vector end = meets ? (-along + radius) - drop : zero - Number(FAR);
            start = ((start < -reach) & (end < 0)) ? zero + Number(FAR) : start;
            start = start > -reach ? start : -reach;
            const Mask lower = may_touch & (start < lowest);
            lowest = lower ? start : lowest, body = lower ? Mask{} + b : body;
            if (!(at[0] - at[0] == at[0] - at[0]))  // a pose that is not finite
                lowest = zero + Number(__builtin_nan(""));
        }
        lowest = is_covered ? lowest : zero + Number(FAR), body = is_covered ? body : Mask{} - 1;
        const Mask is_free = (body < 0) & (lowest - lowest == lowest - lowest);
        const Vector overlap = is_free ? zero + Number(NO_SURFACE) : -lowest / pitch;
        if (count == wide)
            put(overlaps + first, overlap);
        else
            for (int l = 0; l < count; ++l)
                overlaps[first + l] = overlap[l];
        if (!WITH_SLIDE)
            continue;
        Vector along_u = {}, along_v = {};
        for (Mask left = (body >= 0) & (lowest < 0); __builtin_reduce_or(left);) {
            int l = 0;
            while (!left[l])
                ++l;
            const int b = body[l];
            const Mask here = left & (body == b);
            left &= ~here;
            const auto& now = poses[b];
            const auto before = wp::index(over.last_pose, env, b);
            bool is_still = true;
            for (int k = 0; k < 7; ++k)
                is_still = is_still && now[k] == before[k];
            if (is_still)
                continue;
            const Vectors x = {r.x + lowest * n.x, r.y + lowest * n.y, r.z + lowest * n.z};
            const Vectors from_body = {x.x - now.p[0], x.y - now.p[1], x.z - now.p[2]};
            const Vectors was = rotate(before.q, rotate(now.q, from_body, -1), 1);
            const Vectors moved = {
                x.x - (was.x + before.p[0]), x.y - (was.y + before.p[1]), x.z - (was.z + before.p[2])
            };
            along_u = here ? dot(moved, u) / pitch : along_u, along_v = here ? dot(moved, v) / pitch : along_v;
        }
        for (int l = 0; l < count; ++l) {
            over.body.data[place + first + l] = body[l];
            over.slide.data[place + first + l] = wp::vec_t<2, Number>(along_u[l], along_v[l]);
        }
    }
"""
