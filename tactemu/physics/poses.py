"""Where every body is, seen from the skin: the one stage in float64, so that a skin 100 km away feels as at home.

World poses come in as ``(n_bodies, n_envs, 13)`` float64: position [m], quaternion (w, x, y, z), velocity of the
body's origin [m/s], angular velocity [rad/s]. For every link that carries a skin this stage forms each body's pose in
the link's frame and, where a sensor asks for it, the relative twist, and rounds only these to the kernels' type.
"""

# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false
# pyright: reportAssignmentType=false, reportOperatorIssue=false, reportGeneralTypeIssues=false

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
import warp as wp

from tactemu.plan.launches import record
from tactemu.plan.plan import Context, Stage
from tactemu.scene.bodies import Body

POSE_WIDTH = 13


@functools.cache
def relative_pose_kernel(real, with_twist: bool, ticks: bool):
    """Poses (and twists) of all bodies in the frame of each link; a pose that is not finite becomes NaN and a flag.

    ``ticks``: it also advances the step count and the time.
    """
    vec3 = wp.types.vector(3, real)
    quat = wp.types.quaternion(real)
    transform = wp.types.transformation(real)

    @wp.func
    def vector(row: wp.array(dtype=wp.float64), at: int):
        return wp.vec3d(row[at], row[at + 1], row[at + 2])

    @wp.func
    def narrow(v: wp.vec3d):
        return vec3(real(v[0]), real(v[1]), real(v[2]))

    @wp.func
    def unit_quaternion(row: wp.array(dtype=wp.float64)):
        q = wp.quatd(row[4], row[5], row[6], row[3])
        length = wp.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
        return q / wp.where(length < wp.float64(1.0e-6), wp.float64(wp.nan), length)

    @wp.kernel(module="unique", enable_backward=False)
    def relative_poses(
        first_env: int,
        world: wp.array3d(dtype=wp.float64),
        links: wp.array(dtype=wp.int32),
        dt_ns: wp.array(dtype=wp.int64),
        step: wp.array(dtype=wp.int64),
        time_ns: wp.array(dtype=wp.int64),
        pose_out: wp.array3d(dtype=transform),
        velocity_out: wp.array3d(dtype=vec3),
        spin_out: wp.array3d(dtype=vec3),
        link_spin_out: wp.array2d(dtype=vec3),
        bad_out: wp.array3d(dtype=wp.uint8),
    ):
        e, l, b = wp.tid()
        e += first_env
        if wp.static(ticks):
            if l == 0 and e == 0 and b == 0:
                step[0] = step[0] + wp.int64(1)
                time_ns[0] = time_ns[0] + dt_ns[0]
        link = world[links[l], e]
        body = world[b, e]
        q_link = unit_quaternion(link)
        to_link = wp.quat_inverse(q_link)
        x = wp.quat_rotate(to_link, vector(body, 0) - vector(link, 0))
        q_body = unit_quaternion(body)
        q = wp.normalize(to_link * q_body)
        v = vector(body, 7)
        w = vector(body, 10)
        wl = vector(link, 10)
        total = wp.dot(x, x) + wp.dot(v, v) + wp.dot(w, w) + q_body[3]  # NaN would not survive normalize()
        total += wp.dot(vector(link, 7), vector(link, 7)) + wp.dot(wl, wl)
        position = narrow(x)
        bad_out[l, e, b] = wp.uint8(0)
        if not wp.isfinite(total) or not wp.isfinite(position[0] + position[1] + position[2]):
            position = vec3(real(wp.nan))
            bad_out[l, e, b] = wp.uint8(1)
        pose_out[l, e, b] = wp.transformation(position, quat(real(q[0]), real(q[1]), real(q[2]), real(q[3])))
        if wp.static(with_twist):
            moved = v + wp.cross(w, vector(link, 0) - vector(body, 0)) - vector(link, 7)
            velocity_out[l, e, b] = narrow(wp.quat_rotate(to_link, moved))
            spin_out[l, e, b] = narrow(wp.quat_rotate(to_link, w - wl))
            if b == 0:
                link_spin_out[l, e] = narrow(wp.quat_rotate(to_link, wl))

    return relative_poses


@wp.kernel(module="unique", enable_backward=False)
def tick(
    dt_ns: wp.array(dtype=wp.int64),
    step: wp.array(dtype=wp.int64),
    time_ns: wp.array(dtype=wp.int64),
):
    """Advance the step count and the time, before threads that share a step begin."""
    step[0] = step[0] + wp.int64(1)
    time_ns[0] = time_ns[0] + dt_ns[0]


@dataclass(frozen=True, kw_only=True)
class LinkView:
    """All bodies as one link sees them, updated before any sensor runs. Arrays of shape ``(n_envs, n_bodies)``.

    A point ``r`` fixed to the link meets the material of body ``b`` there with the relative velocity
    ``velocity[e, b] + cross(spin[e, b], r)``.
    """

    link: int
    pose: wp.array
    """Transforms (position, quaternion) of the bodies in the link's frame. NaN where a world pose is not finite."""
    velocity: wp.array
    """Relative velocity of each body's material at the link's *origin* [m/s], link frame; empty unless asked for."""
    spin: wp.array
    """Relative angular velocity [rad/s], link frame; empty unless asked for."""
    link_spin: wp.array
    """Angular velocity of the link itself in the world [rad/s], link frame, shape ``(n_envs,)``; empty likewise."""


class RelativePoses:
    """The world's poses, and the stage that turns them into one :class:`LinkView` per link that carries a skin.

    Args:
        links: body indices of the links.
        n_bodies: bodies in the scene.
        twist_reasons: why relative velocities are needed, one per sensor that asks; empty: they are not computed.
    """

    def __init__(self, links: list[int], n_bodies: int, twist_reasons: list[str], context: Context):
        device, real, n_envs = context.device, context.real, context.n_envs
        self.with_twist = bool(twist_reasons)
        self._reasons = twist_reasons
        self._context = context
        self.links = list(links)
        self.world = context.zeros((n_bodies, n_envs, POSE_WIDTH), wp.float64)
        shape = (len(links), n_envs, n_bodies)
        vec3 = wp.types.vector(3, real)
        self.dt_ns = context.zeros(1, wp.int64)
        self._links = wp.array(links, dtype=wp.int32, device=device)
        self._pose = context.zeros(shape, wp.types.transformation(real))
        twist_shape = shape if self.with_twist else (0, 0, 0)
        self._velocity = context.zeros(twist_shape, vec3)
        self._spin = context.zeros(twist_shape, vec3)
        self._link_spin = context.zeros(twist_shape[:2], vec3)
        self.bad = context.zeros(shape, wp.uint8)

    def view(self, link: int) -> LinkView:
        """What the link sees."""
        l = self.links.index(link)
        if self.with_twist:
            arrays = {"velocity": self._velocity[l], "spin": self._spin[l], "link_spin": self._link_spin[l]}
        else:
            none = wp.zeros((0, 0), dtype=self._spin.dtype, device=self._spin.device)
            arrays = {"velocity": none, "spin": none, "link_spin": none.reshape((0,))}
        return LinkView(link=link, pose=self._pose[l], **arrays)

    def status(self, link: int) -> wp.array:
        """Which poses a link could not use at the last step, uint8, ``(n_envs, n_bodies)``: 1 where one was not."""
        return cast(wp.array, self.bad[self.links.index(link)])

    def stages(self) -> list[Stage]:
        """The stage, which also advances the step count and the time; where threads share the step, one before it."""
        context = self._context
        shared, before = context.threads > 1, []
        if shared:
            launch = record(tick, 1, [self.dt_ns], [context.step, context.time_ns], context.device)
            before = [Stage(name="time", reason="advances before threads share the step", launch=launch)]
        inputs = [self.world, self._links, self.dt_ns, context.step, context.time_ns]
        outputs = [self._pose, self._velocity, self._spin, self._link_spin, self.bad]
        kernel = relative_pose_kernel(context.real, self.with_twist, not shared)
        reason = "poses of all bodies in the skin's frame, formed in float64"
        if self.with_twist:
            reason += "; velocities for " + ", ".join(self._reasons)
        links, n_envs, bodies = self._pose.shape
        launch = context.record(kernel, (n_envs, links, bodies), inputs, outputs, block_dim=32)  # float64: spread it
        return [*before, Stage(name="relative poses", reason=reason, launch=launch)]


def complaint(bodies: Sequence[Body], values: np.ndarray, bad: np.ndarray, step: int, real: type) -> str:
    """What is wrong with poses of which some were not usable, in words.

    Args:
        bodies: of the scene.
        values: the world's poses, ``(n_bodies, n_envs, 13)``.
        bad: which were not usable, ``(n_envs, n_bodies)``.
        step: that they were for.
        real: type of the kernels' numbers.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        usable = np.isfinite(values).all(-1) & (np.linalg.norm(values[..., 3:7], axis=-1) >= 1e-6)
    wrong = np.argwhere(~usable)
    if len(wrong):
        b, e = wrong[0]
        what = f"pose {values[b, e]}"
    else:
        e, b = np.argwhere(bad)[0]
        what = f"pose {values[b, e]} too far from the skin for {real.__name__}"
    envs = sorted({int(env) for env in np.argwhere(bad)[:, 0]})
    return (
        f"body {bodies[b].name!r}, environment {e}, step {step}: {what} "
        f"(position, quaternion w x y z, velocity, angular velocity) must be finite and the quaternion not 0. "
        f"Environments that read NaN: {envs}; set_pose a good pose there and reset(envs={envs})"
    )


def pose_row(position, quaternion, linear_velocity=(0.0, 0.0, 0.0), angular_velocity=(0.0, 0.0, 0.0)) -> np.ndarray:
    """The 13 numbers of one pose."""
    return np.concatenate([position, quaternion, linear_velocity, angular_velocity]).astype(np.float64)
