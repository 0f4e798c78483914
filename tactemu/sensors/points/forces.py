"""Force and torque of a ProximityTaxel from the sums over points around it: parameters, and the kernel for a GPU."""

# pyright: reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false, reportAssignmentType=false
# pyright: reportGeneralTypeIssues=false

import functools

import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.sensors.probes.kinematic_taxel import force_torque_writer


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
        sums: wp.array3d(dtype=wp.types.vector(4, real))  # (n_envs, n_clouds, n_taxels)
        place: wp.array(dtype=wp.int32)  # index of each taxel in the sums
        velocity: wp.array2d(dtype=vec3)
        spin: wp.array2d(dtype=vec3)
        link_spin: wp.array(dtype=vec3)
        positions: wp.array(dtype=vec3)
        normals: wp.array(dtype=vec3)
        gain: wp.array2d(dtype=real)

    return Proximity


@functools.cache
def proximity_kernel(real, moving: bool, has_gain: bool):
    """Return the kernel of force and torque from the sums over points
    (:mod:`tactemu.sensors.points.proximity_sums`)."""
    vec3, proximity_struct, write = wp.types.vector(3, real), proximity_type(real), force_torque_writer(real)

    @warp_kernel
    def proximity(first_env: int, c: proximity_struct, out: wp.array3d(dtype=real)):
        e, i = wp.tid()
        e += first_env
        r = c.positions[i]
        a = c.normals[i]
        total = real(0.0)
        motion = vec3(real(0.0))  # sum P_j v_j
        twist = real(0.0)  # sum P_j (w_j - w_skin) . a
        for k in range(c.bodies.shape[0]):
            s = c.sums[e, k, c.place[i]]
            total += s[3]
            if wp.static(moving):
                b = c.bodies[k]
                w = c.spin[e, b]
                moment = vec3(s[0], s[1], s[2])
                motion += s[3] * (c.velocity[e, b] + wp.cross(w, r)) + wp.cross(w + c.link_spin[e], moment)
                twist += s[3] * wp.dot(w, a)
        g = real(1.0)
        if wp.static(has_gain):
            g = c.gain[e, i]
        force = -c.normal * g * total * a
        if wp.static(moving):
            force += c.shear * g * (motion - wp.dot(motion, a) * a)
        torque = wp.cross(r, force)
        if wp.static(moving):
            if total > real(0.0):
                torque += c.twist * twist / total * a
        write(out, e, i, force, torque)

    return proximity
