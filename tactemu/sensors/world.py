"""World poses of all bodies: set from Python per body, sent to the device in one copy per body and step."""

# pyright: reportArgumentType=false, reportAssignmentType=false, reportGeneralTypeIssues=false

import functools
from collections.abc import Iterable, Sequence
from typing import cast

import numpy as np
import warp as wp

from tactemu.base.errors import SceneError
from tactemu.base.kernels import warp_kernel
from tactemu.geometry import rotation
from tactemu.geometry.bodies import Body
from tactemu.geometry.motion import Pose
from tactemu.sensors.poses import POSE_WIDTH, pose_row

PARTS = {
    "position": slice(0, 3),
    "quaternion": slice(3, 7),
    "linear_velocity": slice(7, 10),
    "angular_velocity": slice(10, 13),
}


def on_host(value) -> bool:
    """Return True for a NumPy array or any value that is not an array of a device."""
    return not (isinstance(value, wp.array) or hasattr(value, "__dlpack__")) or isinstance(value, np.ndarray)


class World:
    """The array ``(n_envs, n_bodies, 13)`` behind :meth:`Simulation.set_pose`.

    On the CPU host and device share it. On a GPU the host keeps a pinned copy; a body set from the host is sent at the
    next step, and one set from a device array never leaves the device.
    """

    def __init__(self, bodies: Sequence[Body], device_array: wp.array):
        self.n_envs, self.n_bodies = device_array.shape[:2]
        self._names = [body.name for body in bodies]
        self.device_array = device_array
        """The poses that a step reads, ``(n_envs, n_bodies, 13)``."""
        assert device_array.device is not None
        self._shared = device_array.device.is_cpu
        if self._shared:
            self._values = device_array.numpy().transpose(1, 0, 2)
        else:  # all poses of a body are contiguous, so that one copy sends them
            shape = (self.n_bodies, self.n_envs, POSE_WIDTH)
            self._staging = wp.zeros(shape, dtype=wp.float64, device="cpu", pinned=True)
            self._arrived = wp.zeros(shape, dtype=wp.float64, device=device_array.device)
            self._values = self._staging.numpy()
        self._start = np.array([pose_row(body.position, body.quaternion) for body in bodies]).reshape(-1, POSE_WIDTH)
        self._dirty: set[int] = set()
        self._device_newer: set[int] = set()
        self.start_rows = wp.array(self._start, dtype=wp.float64, device=device_array.device)
        """The start pose of each body, ``(n_bodies, 13)``."""
        self._moved: set[int] = set()
        """Bodies that the device moves by itself at each step."""
        self.bound: frozenset[int] = frozenset()
        """Bodies whose poses come from arrays on the device."""
        self._exposed = False
        self._sent = None if self._shared else wp.Event(device_array.device)
        self._in_flight = False
        self.reset(None)

    def env_indices(self, envs) -> slice | np.ndarray:
        """Return the environments as an index of arrays.

        Raises:
            SceneError: an index is out of range.
        """
        if envs is None:
            return slice(None)
        indices = np.atleast_1d(np.asarray(envs))
        if indices.dtype == bool and indices.shape == (self.n_envs,):
            return np.flatnonzero(indices)
        if indices.size and (indices.dtype.kind not in "iu" or indices.min() < 0 or indices.max() >= self.n_envs):
            raise SceneError(f"envs must be indices in 0..{self.n_envs - 1} or a mask of {self.n_envs}, got {envs!r}")
        return indices.astype(np.int64)

    def put(self, b: int, pose: Pose, where: np.ndarray | None = None) -> None:
        """Set the pose and both velocities of a body in some environments (``None``: all); each part may have a row
        for each environment.

        Raises:
            SceneError: a part has another shape.
        """
        self._before_write(b)
        rows = self._values[b]
        try:
            if where is None:
                rows[:, 0:3], rows[:, 3:7], rows[:, 7:10], rows[:, 10:13] = pose
            else:
                whole = rows.copy()
                whole[:, 0:3], whole[:, 3:7], whole[:, 7:10], whole[:, 10:13] = pose
                rows[where] = whole[where]
        except ValueError:
            shapes = ", ".join(str(np.shape(part)) for part in pose)
            raise SceneError(
                f"body {self._names[b]!r}: its motion must return position, quaternion and two velocities of shapes "
                f"(3,), (4,), (3,), (3,), or with {self.n_envs} rows, got {shapes}"
            ) from None

    def put_all(self, bodies: np.ndarray, rows: np.ndarray) -> None:
        """Set the poses and velocities of several bodies: shape ``(n, 1 or n_envs, 13)``."""
        for b in () if self._shared else bodies.tolist():
            self._before_write(b)
        self._values[bodies] = rows

    def set(self, body: Body, given, envs=None, order: str = "wxyz") -> None:
        """Set the given parts of a body's pose (``None``: unchanged) in the given environments.

        Args:
            body: the body.
            given: position, quaternion and two velocities.
            envs: the environments; ``None``: all.
            order: order of the numbers of a quaternion in an array of a device.

        Raises:
            SceneError: a shape or the order is wrong, or an environment is out of range.
        """
        b = body.index
        if b in self.bound:
            raise SceneError(
                f"set_pose({body.name!r}): its poses come from the arrays that you gave to bind_poses; change those"
            )
        where = self.env_indices(envs)
        rows = self.n_envs if envs is None else len(where)
        for (name, part), value in zip(PARTS.items(), given):
            if value is not None and not on_host(value):
                value = self._from_device(b, name, part, value, envs, order if name == "quaternion" else "")
            if value is None:
                continue
            width = part.stop - part.start
            try:
                numbers = np.asarray(value, np.float64)
            except (TypeError, ValueError):
                raise self._shape_error(body.name, name, part, value, rows) from None
            if numbers.shape not in ((width,), (rows, width)):
                raise self._shape_error(body.name, name, part, value, rows)
            self._before_write(b)
            self._values[b][where, part] = numbers

    @staticmethod
    def _shape_error(body: str, name: str, part: slice, value, rows: int) -> SceneError:
        width = part.stop - part.start
        expected = f"({width},) or ({rows}, {width})"
        got = value.shape if hasattr(value, "shape") else repr(value)
        return SceneError(f"set_pose({body!r}): {name} must be numbers of shape {expected}, got {got}")

    def _from_device(self, b: int, name: str, part: slice, value, envs, order: str):
        """Copy an array on the simulation's device into the world; an array that must go through the host is returned
        as numpy."""
        array = value if isinstance(value, wp.array) else cast(wp.array, wp.from_dlpack(value))
        rows = _as_rows(array)
        if array.device != self.device_array.device or envs is not None or rows is None:
            return rotation.wxyz(array.numpy(), order or "wxyz", "set_pose")
        width = part.stop - part.start
        if rows.shape not in ((1, width), (self.n_envs, width)):
            raise self._shape_error(self._names[b], name, part, array, self.n_envs)
        if b in self._dirty:
            self._send([b])
            self._dirty.discard(b)
        if not self._shared:
            self._device_newer.add(b)
        target = self.device_array[:, b, part.start : part.stop]
        kernel = _spread_kernel(rows.dtype, 3 if order == "xyzw" else 0)
        wp.launch(kernel, dim=target.shape, inputs=[rows], outputs=[target], device=target.device)
        return None

    def _before_write(self, b: int) -> None:
        if self._shared:
            return
        if self._in_flight:
            wp.synchronize_event(self._sent)
            self._in_flight = False
        if b in self._device_newer and b not in self._dirty:
            self._values[b] = self.device_array[:, b].numpy()
            if not self._exposed and b not in self._moved:
                self._device_newer.discard(b)
        self._dirty.add(b)

    def upload(self) -> None:
        """Send the poses that the host has changed to the device. On the CPU it does nothing."""
        if not self._dirty:
            return
        self._send(sorted(self._dirty))
        self._dirty.clear()

    def _send(self, bodies: Sequence[int]) -> None:
        device = self.device_array.device
        for b in bodies:
            wp.copy(self._arrived[b], self._staging[b])
            dim = (self.n_envs, POSE_WIDTH)
            wp.launch(_spread_kernel(wp.float64), dim, [self._arrived[b]], [self.device_array[:, b]], device=device)
        wp.get_stream(device).record_event(self._sent)
        self._in_flight = True

    def download(self) -> np.ndarray:
        """Return all poses as numpy, ``(n_envs, n_bodies, 13)``."""
        return self.device_array.numpy()

    def pose(self, b: int, env: int = 0) -> Pose:
        """Return the pose of a body in an environment, as last set."""
        newer = b in self._device_newer and b not in self._dirty
        row = (self.device_array[env, b].numpy() if newer else self._values[b, env]).copy()
        position, quaternion, velocity, turning = (row[part] for part in PARTS.values())
        return Pose(position, quaternion / np.linalg.norm(quaternion), velocity, turning)

    def poses(self) -> np.ndarray:
        """Return position and quaternion of each body in environment 0, as last set, shape ``(n_bodies, 7)``."""
        self.upload()
        values = self.device_array[0].numpy() if self._device_newer else self._values[:, 0]
        return values[:, :7].copy()

    @property
    def has_unsent(self) -> bool:
        """Has the host set poses that the next step must send?"""
        return bool(self._dirty)

    def exposed(self) -> wp.array:
        """Return the array of poses ``(n_envs, n_bodies, 13)`` itself, which the caller may write to on the device."""
        self.upload()
        self._exposed = True
        self.changed_on_device()
        return self.device_array

    def let_device_move(self, bodies: Iterable[int]) -> None:
        """Expect the device to move these bodies, and no others, by itself at each step."""
        self._moved = {*bodies}
        if not self._shared:
            self._device_newer |= self._moved

    def bind(self, bodies: frozenset[int]) -> None:
        """Let the device write the poses of these bodies from now on."""
        self.upload()
        self._moved -= bodies
        self.bound = bodies
        if not self._shared:
            self._device_newer |= bodies

    def reset_rows(self, mask: wp.array) -> None:
        """Put all bodies back where they started, on the device, where the mask is true. A graph can capture it."""
        inputs = [mask, self.start_rows]
        device = self.device_array.device
        dim = self.device_array.shape[:2]
        wp.launch(_restart_kernel, dim=dim, inputs=inputs, outputs=[self.device_array], device=device)

    def changed_on_device(self) -> None:
        """Mark the host's copy as outdated for all bodies."""
        self._device_newer = set() if self._shared else set(range(self.n_bodies))

    def after_restore(self) -> None:
        """Mark the host's copy as outdated after the device's array was restored."""
        self._dirty.clear()
        self.changed_on_device()

    def reset(self, envs) -> None:
        """Put all bodies back where they started, from the host."""
        where = self.env_indices(envs)
        for b, row in enumerate(self._start):
            self._before_write(b)
            self._values[b, where] = row


@warp_kernel
def _restart_kernel(
    mask: wp.array(dtype=wp.bool), start: wp.array2d(dtype=wp.float64), world: wp.array3d(dtype=wp.float64)
):
    e, b = wp.tid()
    if mask[e]:
        for k in range(world.shape[2]):
            world[e, b, k] = start[b, k]


@functools.cache
def _spread_kernel(dtype, first: int = 0):
    """Return the kernel that copies rows, from number ``first`` on and round."""

    @warp_kernel
    def spread(source: wp.array2d(dtype=dtype), target: wp.array2d(dtype=wp.float64)):
        e, k = wp.tid()
        target[e, k] = wp.float64(source[wp.min(e, source.shape[0] - 1), (k + first) % source.shape[1]])

    return spread


def _as_rows(array: wp.array) -> wp.array | None:
    """Return an array of scalars or vectors as ``(rows, width)`` scalars, on its device; ``None`` for other types."""
    dtype = array.dtype
    if hasattr(dtype, "_wp_scalar_type_"):
        array = array.contiguous()
        shape = (*array.shape, dtype._length_)
        array = wp.array(ptr=array.ptr, shape=shape, dtype=dtype._wp_scalar_type_, device=array.device)
    if array.dtype not in (wp.float32, wp.float64) or array.ndim not in (1, 2):
        return None
    return array.reshape((1, -1)) if array.ndim == 1 else array
