"""Force and torque of a ProximityTaxel from the sums over points around it: parameters, and functions for a GPU."""

# pyright: reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false, reportAssignmentType=false
# pyright: reportGeneralTypeIssues=false

import functools

import warp as wp


@functools.cache
def proximity_type(real):
    """Return the Warp struct of a ProximityTaxel's parameters, and of what its forces are computed from."""
    vec3 = wp.types.vector(3, real)

    @wp.struct
    class Proximity:
        normal: real  # factor of the sum, along the probe's normal
        shear: real  # factor of the velocity sum
        twist: real
        bodies: wp.array(dtype=wp.int32)  # of the clouds
        velocity: wp.array2d(dtype=vec3)
        spin: wp.array2d(dtype=vec3)
        link_spin: wp.array(dtype=vec3)
        positions: wp.array(dtype=vec3)
        normals: wp.array(dtype=vec3)
        gain: wp.array2d(dtype=real)

    return Proximity


@functools.cache
def sums_type(real):
    """Return the Warp struct of a taxel's sums over the points of all bodies."""

    @wp.struct
    class Sums:
        total: real  # sum P_j
        motion: wp.types.vector(3, real)  # sum P_j v_j
        twist: real  # sum P_j (w_j - w_skin) . a

    return Sums


@functools.cache
def force_functions(real, moving: bool):
    """Return the functions ``(add_body, write)``.

    ``add_body(sums, c, e, i, k, total, moment)`` adds the sums over the points of the ``k``-th cloud: ``sum P_j`` and
    ``sum P_j (x_j - r)``. ``write(c, sums, gain, e, i, out)`` writes force and torque.
    """
    vec3, proximity_struct, sums_struct = wp.types.vector(3, real), proximity_type(real), sums_type(real)
    exact_ratio, write_pairs = _exact_ratio(real), _pair_writer(real)

    @wp.func
    def add_body(sums: sums_struct, c: proximity_struct, e: int, i: int, k: int, total: real, moment: vec3):
        motion = sums.motion
        twist = sums.twist
        if wp.static(moving):
            b = c.bodies[k]
            w = c.spin[e, b]
            motion += total * (c.velocity[e, b] + wp.cross(w, c.positions[i])) + wp.cross(w + c.link_spin[e], moment)
            twist += total * wp.dot(w, c.normals[i])
        return sums_struct(sums.total + total, motion, twist)

    @wp.func
    def write(c: proximity_struct, sums: sums_struct, gain: real, e: int, i: int, out: wp.array3d(dtype=real)):
        r = c.positions[i]
        a = c.normals[i]
        force = -c.normal * gain * sums.total * a
        if wp.static(moving):
            force += c.shear * gain * (sums.motion - wp.dot(sums.motion, a) * a)
        torque = wp.cross(r, force)
        if wp.static(moving):
            if sums.total > real(0.0):
                torque += exact_ratio(c.twist * sums.twist, sums.total) * a
        write_pairs(out, e, i, force, torque)

    return add_body, write


@functools.cache
def _exact_ratio(real):
    """Return ``exact_ratio(a, b)``, the correctly rounded ratio also in a kernel with ``fast_math``."""
    divide = "return a / b;" if real is wp.float64 else _EXACT_RATIO

    @wp.func_native(divide)
    def exact_ratio(a: real, b: real) -> real: ...

    return exact_ratio


_EXACT_RATIO = """
#if defined(__CUDA_ARCH__)
    return __fdiv_rn(a, b);
#else
    return a / b;
#endif
"""


@functools.cache
def _pair_writer(real):
    """Return ``write(out, e, i, force, torque)``, which writes two numbers at once."""
    vec3 = wp.types.vector(3, real)

    @wp.func_native(_WRITE_PAIRS.replace("NUMBER", real.__name__))
    def write(out: wp.array3d(dtype=real), e: int, i: int, force: vec3, torque: vec3): ...

    return write


_WRITE_PAIRS = """
    struct alignas(2 * sizeof(wp::NUMBER)) Pair { wp::NUMBER one, other; };
    const int64_t offset = int64_t(out.strides[0]) * e + int64_t(out.strides[1]) * i;
    Pair* const to = reinterpret_cast<Pair*>(reinterpret_cast<char*>(out.data) + offset);
    to[0] = Pair{force[0], force[1]};
    to[1] = Pair{force[2], torque[0]};
    to[2] = Pair{torque[1], torque[2]};
"""
