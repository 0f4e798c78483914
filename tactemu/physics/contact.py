"""How deep each probe is in what it touches: the query that ContactProbe, ContactDepthProbe and KinematicTaxel share.

``d = max(0, R - signed distance)`` over the bodies felt: a probe at the surface of a body reads its radius ``R``, and
one in free space within ``R`` reads ``R`` minus the distance. There is no gate: two fixed bodies touch as any two do.
"""

import functools

import warp as wp

from tactemu.physics.shapes import shape_functions, table_type


@functools.cache
def nearest_function(real, kinds: frozenset):
    """``nearest(shapes, pose, targets, e, r, margin) -> (signed distance, normal, body)``.

    The body felt that is nearest to the point ``r`` of the link's frame, and the normal there in the link's frame.
    Bodies farther than ``margin`` may be skipped: then the distance is 1e18 m and the body -1. A pose that is not
    finite gives a NaN distance.
    """
    vec3 = wp.types.vector(3, real)
    transform = wp.types.transformation(real)
    shapes_type = table_type(real)
    functions = shape_functions(real, kinds)
    distance_in_link, reaches = functions.distance_in_link, functions.reaches

    @wp.func
    def nearest(
        shapes: shapes_type,
        pose: wp.array2d(dtype=transform),
        targets: wp.array(dtype=wp.int32),
        e: int,
        r: vec3,
        margin: real,
    ):
        best = real(1.0e18)
        normal = vec3(real(0.0))
        body = int(-1)
        for t in range(targets.shape[0]):
            b = targets[t]
            x = pose[e, b]
            if reaches(shapes, b, x, r, margin):
                d, n = distance_in_link(shapes, b, x, r)
                if d < best or wp.isnan(d):
                    best = d
                    normal = n
                    body = b
                if wp.isnan(wp.transform_get_translation(x)[0]):
                    best = real(wp.nan)
        return best, normal, body

    return nearest
