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
        launch = record_strips(site, springs_formula(real, moving), springs_type(real), self._springs(site), truth, raw)
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
