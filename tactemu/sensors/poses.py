"""The pose of every body relative to the skin: the one stage in float64, so that a skin 100 km away is as accurate as
one at the origin.

World poses are given as ``(n_envs, n_bodies, 13)`` float64: position [m], quaternion (w, x, y, z), velocity of the
body's origin [m/s], angular velocity [rad/s]. For every link that carries a skin this stage computes each body's pose
in the link's frame and, where a sensor needs it, the relative twist, and rounds only these to the kernels' type.
"""

# pyright: reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false, reportAssignmentType=false
# pyright: reportOperatorIssue=false, reportGeneralTypeIssues=false

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import cast

import numpy as np
import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.geometry.bodies import Body
from tactemu.geometry.coalesced import row_writer
from tactemu.geometry.shapes.shape import FAR
from tactemu.plan.clock import Clock, advance, tick
from tactemu.plan.launches import record
from tactemu.plan.plan import Context, Stage
from tactemu.plan.scalars import is_finite

POSE_WIDTH = 13
MAX_QUATERNION_NORM = 1.0e150
"""Largest usable norm of a quaternion, so that its square stays finite."""


@functools.cache
def links_type(real):
    """Return the Warp struct of the links that carry skins, and of the bodies' poses in their frames."""
    vec3 = wp.types.vector(3, real)

    @wp.struct
    class Links:
        world: wp.array3d(dtype=wp.float64)
        links: wp.array(dtype=wp.int32)  # indices of the links
        middles: wp.array(dtype=wp.vec3d)  # centre of the skin on each
        reaches: wp.array2d(dtype=wp.float64)  # distance from it within which a body is near, (n_links, n_bodies)
        # Written, (n_links, n_envs * n_bodies, 7 or 3):
        pose: wp.array3d(dtype=real)
        velocity: wp.array3d(dtype=real)
        spin: wp.array3d(dtype=real)
        link_spin: wp.array2d(dtype=vec3)  # (n_links, n_envs)
        near: wp.array3d(dtype=wp.uint8)  # (n_links, n_envs, n_bodies)
        bad: wp.array3d(dtype=wp.uint8)  # likewise: 1 for a pose that could not be used

    return Links


@functools.cache
def relative_pose_kernel(real, with_twist: bool, ticks: bool):
    """Return the kernel that computes poses (and twists) of all bodies in the frame of each link. A pose that is not
    finite becomes NaN and sets a flag.

    With ``ticks`` it also advances the step count and the time.
    """
    vec3, numbers = wp.types.vector(3, real), wp.types.vector(7, real)
    write_pose, write_vector = row_writer(real, 7), row_writer(real, 3)

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
        usable = length >= wp.float64(1.0e-6) and length <= wp.float64(MAX_QUATERNION_NORM)
        return q * (wp.float64(1.0) / wp.where(usable, length, wp.float64(wp.nan)))

    @warp_kernel(grid_stride=False)
    def relative_poses(first_env: int, clock: Clock, dt_ns: wp.array(dtype=wp.int64), links: links_type(real)):
        e, b = wp.tid()
        e += first_env
        place = e * links.world.shape[1] + b
        if wp.static(ticks):
            if e == 0 and b == 0:
                advance(clock, dt_ns)
        body = links.world[e, b]
        q_body = unit_quaternion(body)
        v = vector(body, 7)
        w = vector(body, 10)
        l = int(0)
        while l < links.links.shape[0]:
            link = links.world[e, links.links[l]]
            to_link = wp.quat_inverse(unit_quaternion(link))
            x = wp.quat_rotate(to_link, vector(body, 0) - vector(link, 0))
            q = to_link * q_body
            wl = vector(link, 10)
            total = wp.dot(x, x) + wp.dot(v, v) + wp.dot(w, w) + q_body[3]
            total += wp.dot(vector(link, 7), vector(link, 7)) + wp.dot(wl, wl)
            position = narrow(x)
            away = x - links.middles[l]
            links.near[l, e, b] = wp.where(
                wp.dot(away, away) > links.reaches[l, b] * links.reaches[l, b], wp.uint8(0), wp.uint8(1)
            )
            links.bad[l, e, b] = wp.uint8(0)
            if not is_finite(total) or not is_finite(position[0] + position[1] + position[2]):
                position = vec3(real(wp.nan))
                links.bad[l, e, b] = wp.uint8(1)
                links.near[l, e, b] = wp.uint8(1)  # so that the taxels read NaN
            pose = numbers(position[0], position[1], position[2], real(q[0]), real(q[1]), real(q[2]), real(q[3]))
            write_pose(links.pose, l, place, pose, True)
            if wp.static(with_twist):
                moved = v + wp.cross(w, vector(link, 0) - vector(body, 0)) - vector(link, 7)
                write_vector(links.velocity, l, place, narrow(wp.quat_rotate(to_link, moved)), True)
                write_vector(links.spin, l, place, narrow(wp.quat_rotate(to_link, w - wl)), True)
                if b == 0:
                    links.link_spin[l, e] = narrow(wp.quat_rotate(to_link, wl))
            l += 1

    return relative_poses


@dataclass(frozen=True, kw_only=True)
class LinkView:
    """The poses of all bodies relative to one link, updated before any sensor runs. Arrays of shape ``(n_envs,
    n_bodies)``.

    A point ``r`` fixed to the link meets the material of body ``b`` there with the relative velocity
    ``velocity[e, b] + cross(spin[e, b], r)``.
    """

    link: int
    pose: wp.array
    """Transforms (position, quaternion) of the bodies in the link's frame. NaN where a world pose is not finite."""
    velocity: wp.array
    """Relative velocity of each body's material at the link's *origin* [m/s], link frame; empty unless a sensor needs
    it."""
    spin: wp.array
    """Relative angular velocity [rad/s], link frame; empty unless a sensor needs it."""
    link_spin: wp.array
    """Angular velocity of the link itself in the world [rad/s], link frame, shape ``(n_envs,)``; empty likewise."""
    near: wp.array
    """May the body reach any probe that :meth:`RelativePoses.watch` was given? uint8."""
    watch: Callable[[np.ndarray, np.ndarray, np.ndarray], None]
    """``watch(positions, radii, bounds)``: add probes on this link, with a bounding radius of each body's shape about
    its origin."""


class RelativePoses:
    """The world's poses, and the stage that turns them into one :class:`LinkView` per link that carries a skin.

    Args:
        links: body indices of the links.
        n_bodies: bodies in the scene.
        twist_reasons: why relative velocities are needed, one per sensor that needs them; empty: they are not computed.
        middles: centre of the skin on each link, ``(n_links, 3)``.
    """

    def __init__(
        self, links: list[int], n_bodies: int, twist_reasons: list[str], middles: np.ndarray, context: Context
    ):
        device, real, n_envs = context.device, context.real, context.n_envs
        self.with_twist = bool(twist_reasons)
        self._reasons = twist_reasons
        self._context = context
        self.links = list(links)
        self.world = context.zeros((n_envs, n_bodies, POSE_WIDTH), wp.float64)
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
        self._near = context.zeros(shape, wp.uint8)
        self._middles = wp.array(middles, dtype=wp.vec3d, device=device)
        self._reach = np.zeros((len(links), n_bodies))
        self._reaches = wp.zeros(self._reach.shape, dtype=wp.float64, device=device)

    def view(self, link: int) -> LinkView:
        """Return the relative poses of one link."""
        l = self.links.index(link)
        if self.with_twist:
            arrays = {"velocity": self._velocity[l], "spin": self._spin[l], "link_spin": self._link_spin[l]}
        else:
            none = wp.zeros((0, 0), dtype=self._spin.dtype, device=self._spin.device)
            arrays = {"velocity": none, "spin": none, "link_spin": none.reshape((0,))}
        return LinkView(link=link, pose=self._pose[l], near=self._near[l], watch=partial(self.watch, l), **arrays)

    def watch(self, l: int, positions: np.ndarray, radii: np.ndarray, bounds: np.ndarray) -> None:
        """Include these probes when ``near`` is computed from now on.

        Args:
            l: number of the link.
            positions: positions of the probes in the link's frame [m], ``(n, 3)``.
            radii: sensing radius of each probe [m], ``(n,)``.
            bounds: bounding radius of each body's shape about its origin [m], ``(n_bodies,)``.
        """
        away = np.linalg.norm(positions - self._middles.numpy()[l], axis=-1) + radii
        reach = np.minimum(away.max(initial=0.0) + bounds, FAR) * (
            1 + 1e-4
        )  # slack: kernels test again in their own precision
        self._reach[l] = np.maximum(self._reach[l], reach)
        self._reaches.assign(self._reach)

    def status(self, link: int) -> wp.array:
        """Return flags of the poses that a link could not use at the last step, uint8, ``(n_envs, n_bodies)``: 1 for
        unusable."""
        return cast(wp.array, self.bad[self.links.index(link)])

    @property
    def ahead(self) -> int:
        """Number of steps by which the time on the device lags behind that of the step being taken, before relative
        poses: 0 if a stage of its own advances it."""
        return int(self._context.threads == 1 and bool(self.links))

    def stages(self) -> list[Stage]:
        """Return the stages: relative poses, which also advances the step count and the time unless threads share the
        step; then, and where no link carries a skin, a stage of its own does."""
        context, before = self._context, []
        shared = context.threads > 1
        if not self.ahead:
            launch = record(tick, 1, [context.clock, self.dt_ns], [], context.device)
            reason = "advances before threads share the step" if shared else "advances; there is no skin"
            before = [Stage(name="time", reason=reason, launch=launch)]
        if not self.links:
            return before
        links = links_type(context.real)()
        links.world, links.links, links.middles, links.reaches = self.world, self._links, self._middles, self._reaches
        links.pose, links.velocity, links.spin = map(self._numbers, (self._pose, self._velocity, self._spin))
        links.link_spin, links.near, links.bad = self._link_spin, self._near, self.bad
        kernel = relative_pose_kernel(context.real, self.with_twist, self.ahead > 0)
        reason = "poses of all bodies in the skin's frame, formed in float64"
        if self.with_twist:
            reason += "; velocities for " + ", ".join(self._reasons)
        dim = self.world.shape[:2]
        # float64 is slow on a GPU: spread it over more blocks
        launch = context.record(kernel, dim, [context.clock, self.dt_ns, links], [], block_dim=32)
        return [*before, Stage(name="relative poses", reason=reason, launch=launch)]

    def _numbers(self, array: wp.array) -> wp.array:
        """Return an array of poses or vectors, ``(n_links, n_envs, n_bodies)``, as ``(n_links, n_envs * n_bodies,
        width)``.
        """
        links, n_envs, bodies = array.shape
        shape = (links, n_envs * bodies, array.dtype._length_)
        return wp.array(ptr=array.ptr, shape=shape, dtype=self._context.real, device=array.device)


def pose_error_message(bodies: Sequence[Body], values: np.ndarray, bad: np.ndarray, step: int, real: type) -> str:
    """Return the error message for poses of which some were not usable.

    Args:
        bodies: the bodies of the scene.
        values: the world's poses, ``(n_envs, n_bodies, 13)``.
        bad: True where a pose was not usable, ``(n_envs, n_bodies)``.
        step: number of the step.
        real: type of the kernels' numbers.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        length = np.linalg.norm(values[..., 3:7], axis=-1)
        usable = np.isfinite(values).all(-1) & (length >= 1e-6) & (length <= MAX_QUATERNION_NORM)
    wrong = np.argwhere(~usable)
    if len(wrong):
        e, b = wrong[np.lexsort(wrong.T)[0]]  # the first body, then its first environment
        what = f"pose {values[e, b]}"
    else:
        e, b = np.argwhere(bad)[0]
        what = f"pose {values[e, b]} too far from the skin for {real.__name__}"
    envs = sorted({int(env) for env in np.argwhere(bad)[:, 0]})
    return (
        f"body {bodies[b].name!r}, environment {e}, step {step}: {what} "
        f"(position, quaternion w x y z, velocity, angular velocity) must be finite and the quaternion not 0. "
        f"Environments that read NaN: {envs}; set_pose a good pose there and reset(envs={envs})"
    )


def pose_row(position, quaternion, linear_velocity=(0.0, 0.0, 0.0), angular_velocity=(0.0, 0.0, 0.0)) -> np.ndarray:
    """Return the 13 numbers of one pose."""
    return np.concatenate([position, quaternion, linear_velocity, angular_velocity]).astype(np.float64)
