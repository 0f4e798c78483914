"""KinematicTaxel: a bed of springs and dampers; force and torque of each probe from depth and relative velocity.

With depth ``d > 0``, ``s = d**normal_exponent``, ``n`` the normal of the body there (out of it, so into the skin),
``v = v_body - v_skin`` at the probe, ``v_n = v . n`` and ``v_t = v - v_n n``::

    F = k s n + c s v_n n + c_s v_t              k normal_stiffness, c normal_damping, c_s shear_scalar
    T = r x F + c_w ((w_body - w_skin) . n) n    c_w twist_scalar, r the probe's position in the link's frame

All of F and T acts on the skin. With ``convention="genesis"`` the shear and twist parts, those with ``c_s`` and
``c_w``, are reversed: they act on the body, as in Genesis.
"""

# pyright: reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false

import functools
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from tactemu.base.units import NonNegative, Positive
from tactemu.geometry.shapes.shape import FAR
from tactemu.plan.plan import Stage
from tactemu.sensors.probes.query import CHEAPER_QUERY, probes_struct, query_trials, touch_type
from tactemu.sensors.probes.strips import record_strips
from tactemu.sensors.sensor_model import Compiled, SensorModel, Site


class ForceTorque(NamedTuple):
    """A reading in the link's frame; each field of shape ``([n_envs,] [history,] layout, 3)``."""

    force: NDArray[np.floating]
    """Force on each taxel [N]."""
    torque: NDArray[np.floating]
    """Torque about the link's origin [N m]."""


@functools.cache
def force_torque_writer(real):
    """Return ``write(out, e, i, force, torque)``, which writes both into the reading of taxel ``i``."""
    vec3 = wp.types.vector(3, real)

    @wp.func
    def write(out: wp.array3d(dtype=real), e: int, i: int, force: vec3, torque: vec3):
        for k in range(3):
            out[e, i, k] = force[k]
            out[e, i, 3 + k] = torque[k]

    return write


@functools.cache
def springs_type(real):
    """Return the Warp struct of a KinematicTaxel's parameters and of the motion of the pressing bodies."""
    vec3 = wp.types.vector(3, real)

    @wp.struct
    class Springs:
        stiffness: real
        damping: real
        exponent: real
        shear: real
        twist: real
        pull_floor: real  # least normal force: 0 forbids adhesion, -FAR allows it
        velocity: wp.array2d(dtype=vec3)
        spin: wp.array2d(dtype=vec3)

    return Springs


@functools.cache
def springs_formula(real, moving: bool):
    """Return the formula of force and torque of one probe; ``moving``: damping, shear or twist are not 0."""
    vec3 = wp.types.vector(3, real)
    springs_struct, probes_type, touch_struct = springs_type(real), probes_struct(real), touch_type(real)
    readings, write = wp.array3d(dtype=real), force_torque_writer(real)

    @wp.func
    def measure(c: springs_struct, probes: probes_type, touch: touch_struct, e: int, i: int, out: readings):
        force = vec3(real(0.0))
        torque = vec3(real(0.0))
        n = touch.normal
        body = touch.body
        d = touch.depth * touch.gain
        if not (d <= real(0.0)):  # a form of the test that lets NaN pass
            if wp.dot(n, n) < real(0.5):
                n = -probes.normals[i]
            r = probes.positions[i]
            s = d
            if c.exponent != real(1.0):
                s = wp.pow(d, c.exponent)
            push = c.stiffness * s
            if wp.static(moving):
                v = vec3(real(0.0))
                w = vec3(real(0.0))
                if body >= 0:
                    w = c.spin[e, body]
                    v = c.velocity[e, body] + wp.cross(w, r)
                vn = wp.dot(v, n)
                push += c.damping * s * vn
                if push < c.pull_floor:  # not max(), which would turn NaN into the floor
                    push = c.pull_floor
                force = push * n + c.shear * (v - vn * n)
                torque = wp.cross(r, force) + c.twist * wp.dot(w, n) * n
            else:
                force = push * n
                torque = wp.cross(r, force)
        write(out, e, i, force, torque)

    return measure


_SPRINGS_SIMD = """
    constexpr int CHANNELS = 6;
    const auto& c = task.numbers;
    const Number stiffness = c.stiffness, damping = c.damping, exponent = c.exponent, slide = c.shear, spin = c.twist;
    const Number pull_floor = c.pull_floor;
    auto measure = [&](const Touch& touch, int first, Vector* out) {
        const Vector zero = {}, depth = touch.depth * touch.gain, x = touch.x, y = touch.y, z = touch.z;
        const Mask presses = ~(depth <= 0);  // a form of the test that lets NaN pass
        if (!__builtin_reduce_or(presses)) {
            for (int k = 0; k < CHANNELS; ++k)
                out[k] = zero;
            return;
        }
        Vector nx = touch.nx, ny = touch.ny, nz = touch.nz, power = depth;
        const Mask has_none = presses & (nx * nx + ny * ny + nz * nz < Number(0.5));
        if (__builtin_reduce_or(has_none))
            for (int l = 0; l < wide; ++l)
                if (has_none[l] && first + l < task.probes.normals.shape[0]) {
                    const auto normal = task.probes.normals.data[first + l];
                    nx[l] = -normal[0], ny[l] = -normal[1], nz[l] = -normal[2];
                }
        if (exponent != Number(1))
            for (int l = 0; l < wide; ++l)
                power[l] = presses[l] ? wp::pow(depth[l], exponent) : Number(0);
        Vector push = stiffness * power, fx, fy, fz, tx, ty, tz;
        if (MOVING) {
            Vector vx = {}, vy = {}, vz = {}, wx = {}, wy = {}, wz = {};
            auto move = [&](const Mask& moved, int b) {
                const auto v = wp::index(c.velocity, e, b), w = wp::index(c.spin, e, b);
                wx = moved ? zero + w[0] : wx, wy = moved ? zero + w[1] : wy, wz = moved ? zero + w[2] : wz;
                vx = moved ? zero + v[0] : vx, vy = moved ? zero + v[1] : vy, vz = moved ? zero + v[2] : vz;
            };
            for (Mask left = presses & (touch.body >= 0); __builtin_reduce_or(left);) {
                int l = 0;
                while (!left[l])
                    ++l;
                const int b = touch.body[l];
                const Mask moved = left & (touch.body == b);
                move(moved, b);
                left &= ~moved;
            }
            vx += wy * z - wz * y, vy += wz * x - wx * z, vz += wx * y - wy * x;
            const Vector vn = vx * nx + vy * ny + vz * nz;
            push += damping * power * vn;
            push = push < pull_floor ? zero + pull_floor : push;
            fx = push * nx + slide * (vx - vn * nx);
            fy = push * ny + slide * (vy - vn * ny);
            fz = push * nz + slide * (vz - vn * nz);
            const Vector twist = spin * (wx * nx + wy * ny + wz * nz);
            tx = (y * fz - z * fy) + twist * nx;
            ty = (z * fx - x * fz) + twist * ny;
            tz = (x * fy - y * fx) + twist * nz;
        } else {
            fx = push * nx, fy = push * ny, fz = push * nz;
            tx = y * fz - z * fy, ty = z * fx - x * fz, tz = x * fy - y * fx;
        }
        out[0] = presses ? fx : zero, out[1] = presses ? fy : zero, out[2] = presses ? fz : zero;
        out[3] = presses ? tx : zero, out[4] = presses ? ty : zero, out[5] = presses ? tz : zero;
    };
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class KinematicTaxel(SensorModel[ForceTorque]):
    """The reading is a :class:`ForceTorque`: force [N], and torque about the link's origin [N m]."""

    normal_stiffness: NonNegative = 1000.0
    """Normal force of a probe per depth [N/m**normal_exponent]."""
    normal_damping: NonNegative = 1.0
    """Normal force of a probe per depth and closing speed [N s/m**(normal_exponent + 1)]."""
    normal_exponent: Positive = 1.0
    """Exponent of the depth in the normal force; > 0."""
    shear_scalar: NonNegative = 1.0
    """Tangential force of a probe per sliding speed [N s/m]."""
    twist_scalar: NonNegative = 1.0
    """Torque of a probe per spin about the normal [N m s/rad]."""
    clamp_adhesion: bool = False
    """Never let the damper pull on the skin."""

    level = 2
    work = 2
    channels = ("force", "torque")
    unit = "N"
    layouts = {"force": slice(0, 3)}
    has_genesis_signs = True
    more_fields = {"torque": slice(3, 6)}
    reading_unit = "N, N m"
    load_fields = ("force", "torque")
    senses_within_radius = True
    strengths = ("normal_stiffness", "normal_damping", "shear_scalar", "twist_scalar")
    valid = (
        "Each probe is an independent spring: it shows where a body presses, and how hard, once the stiffness is "
        "fitted. Under a flat face or an edge the fitted force is off by up to 74 %; it neither sticks nor slips."
    )
    source = "Springs and dampers. Options and numbers are those of the sensor of this name in Genesis."
    tried = query_trials()

    def velocity_reason(self) -> str | None:
        terms = {"damping": self.normal_damping, "shear": self.shear_scalar, "twist": self.twist_scalar}
        wanted = [name for name, value in terms.items() if value != 0.0]
        return "KinematicTaxel " + ", ".join(wanted) if wanted else None

    def present(self, values: NDArray[Any]) -> ForceTorque:
        return ForceTorque(values[..., :3], values[..., 3:])

    def compile(self, site: Site) -> Compiled:
        real, truth = site.context.real, site.zeros()
        raw = site.zeros() if site.separate else truth
        moving = self.velocity_reason() is not None
        simd = f"    constexpr bool MOVING = {str(moving).lower()};\n{_SPRINGS_SIMD}"
        springs = springs_type(real), self._springs(site)
        launch = record_strips(site, springs_formula(real, moving), *springs, truth, raw, simd=simd)
        why = "KinematicTaxel reads force and torque"
        stage = Stage(name=f"{site.name}: springs", reason=why, launch=launch, cheaper=CHEAPER_QUERY)
        return Compiled(truth=truth, raw=raw, stages=[stage])

    def _springs(self, site: Site):
        c = springs_type(site.context.real)()
        side = 1.0 if site.on_skin else -1.0
        c.stiffness, c.damping, c.exponent = self.normal_stiffness, self.normal_damping, self.normal_exponent
        c.shear, c.twist = side * self.shear_scalar, side * self.twist_scalar
        c.pull_floor = 0.0 if self.clamp_adhesion else -FAR
        c.velocity, c.spin = site.view.velocity, site.view.spin
        return c
