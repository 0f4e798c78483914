"""World poses of all bodies: set from Python per body, sent to the device in one copy per body and step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import warp as wp

from tactemu.errors import SceneError
from tactemu.physics.poses import POSE_WIDTH, pose_row
from tactemu.scene.bodies import Body

PARTS = {
    "position": slice(0, 3),
    "quaternion": slice(3, 7),
    "linear_velocity": slice(7, 10),
    "angular_velocity": slice(10, 13),
}


def _on_host(value) -> bool:
    return not (isinstance(value, wp.array) or hasattr(value, "__dlpack__")) or isinstance(value, np.ndarray)


class World:
    """The array ``(n_bodies, n_envs, 13)`` behind :meth:`Simulation.set_pose`.

    On the CPU host and device share it. On a GPU the host keeps a pinned copy; a body that was set from the host is
    sent at the next step, one that was set from a device array never leaves the device.
    """

    def __init__(self, bodies: Sequence[Body], device_array: wp.array):
        self.n_envs = device_array.shape[1]
        self._names = [body.name for body in bodies]
        self._device_array = device_array
        self._shared = device_array.device.is_cpu
        self._staging = (
            device_array if self._shared else wp.zeros(device_array.shape, dtype=wp.float64, device="cpu", pinned=True)
        )
        self._values = self._staging.numpy()
        self._start = np.array([pose_row(body.position, body.quaternion) for body in bodies]).reshape(-1, POSE_WIDTH)
        self._dirty: set[int] = set()
        self._device_newer: set[int] = set()
        self._sent = None if self._shared else wp.Event(device_array.device)
        self._in_flight = False
        self.reset(None)

    def env_indices(self, envs) -> slice | np.ndarray:
        """Environments as an index.

        Raises:
            SceneError: one is not there.
        """
        if envs is None:
            return slice(None)
        indices = np.atleast_1d(np.asarray(envs))
        if indices.dtype == bool and indices.shape == (self.n_envs,):
            return np.flatnonzero(indices)
        if indices.size and (indices.dtype.kind not in "iu" or indices.min() < 0 or indices.max() >= self.n_envs):
            raise SceneError(f"envs must be indices in 0..{self.n_envs - 1} or a mask of {self.n_envs}, got {envs!r}")
        return indices.astype(np.int64)

    def put(self, b: int, pose) -> None:
        """Set the whole pose of a body in all environments: position, quaternion, two velocities."""
        self._before_write(b)
        row = self._values[b]
        row[:, 0:3], row[:, 3:7], row[:, 7:10], row[:, 10:13] = pose

    def set(self, body: Body, given, envs) -> None:
        """Set the parts given, in the environments given."""
        b = body.index
        if self._shared and envs is None and all(_on_host(value) for value in given):
            where = self._values[b]
        else:
            where = None
        for (name, part), value in zip(PARTS.items(), given):
            if value is None:
                continue
            if where is None and not _on_host(value):
                value = self._from_device(b, name, part, value, envs)
                if value is None:
                    continue
            try:
                if where is None:
                    self._before_write(b)
                    block = self._values[b]
                    block[self.env_indices(envs), part] = np.asarray(value, np.float64)
                else:
                    where[:, part] = value
            except ValueError as error:
                raise self._shape_error(body.name, name, part, value, envs) from error

    def _shape_error(self, body: str, name: str, part: slice, value, envs) -> SceneError:
        rows = self.n_envs if envs is None else len(np.atleast_1d(envs))
        width = part.stop - part.start
        expected = f"({width},) or ({rows}, {width})"
        return SceneError(f"set_pose({body!r}): {name} must be numbers of shape {expected}, got {np.shape(value)}")

    def _from_device(self, b: int, name: str, part: slice, value, envs):
        """Copy a device array into the world without the host; returns it as numpy where that cannot be."""
        array = value if isinstance(value, wp.array) else wp.from_dlpack(value)
        width = part.stop - part.start
        if self._shared or array.device != self._device_array.device or envs is not None:
            return array.numpy()
        if array.dtype in (wp.vec3f, wp.vec3d, wp.vec4f, wp.vec4d):
            array = array.view(wp.float64 if array.dtype in (wp.vec3d, wp.vec4d) else wp.float32)
        if array.shape not in ((width,), (self.n_envs, width)):
            raise self._shape_error(self._names[b], name, part, array.numpy(), envs)
        if b in self._dirty:
            wp.copy(self._device_array[b], self._staging[b])
            self._dirty.discard(b)
            self._mark_sent()
        self._device_newer.add(b)
        target = self._device_array[b][:, part.start : part.stop]
        _copy_rows(array, target)
        return None

    def _before_write(self, b: int) -> None:
        if self._shared:
            return
        if self._in_flight:
            wp.synchronize_event(self._sent)
            self._in_flight = False
        if b in self._device_newer:
            self._values[b] = self._device_array[b].numpy()
            self._device_newer.discard(b)
        self._dirty.add(b)

    def _mark_sent(self) -> None:
        wp.record_event(self._sent)
        self._in_flight = True

    def upload(self) -> None:
        """Send what the host has changed. Nothing to do on the CPU."""
        if not self._dirty:
            return
        for b in self._dirty:
            wp.copy(self._device_array[b], self._staging[b])
        self._dirty.clear()
        self._mark_sent()

    def download(self) -> np.ndarray:
        """All poses as numpy, ``(n_bodies, n_envs, 13)``."""
        return self._values if self._shared else self._device_array.numpy()

    def reset(self, envs) -> None:
        """Put all bodies back where they started."""
        where = self.env_indices(envs)
        for b, row in enumerate(self._start):
            self._before_write(b)
            self._values[b, where] = row


@wp.kernel(module="unique", enable_backward=False)
def _spread_f32(source: wp.array2d(dtype=wp.float32), target: wp.array2d(dtype=wp.float64)):
    e, k = wp.tid()
    target[e, k] = wp.float64(source[wp.min(e, source.shape[0] - 1), k])


@wp.kernel(module="unique", enable_backward=False)
def _spread_f64(source: wp.array2d(dtype=wp.float64), target: wp.array2d(dtype=wp.float64)):
    e, k = wp.tid()
    target[e, k] = source[wp.min(e, source.shape[0] - 1), k]


def _copy_rows(source: wp.array, target: wp.array) -> None:
    """Write one row to all environments, or one each; float32 or float64."""
    if source.ndim == 1:
        source = source.reshape((1, -1))
    kernel = _spread_f64 if source.dtype == wp.float64 else _spread_f32
    wp.launch(kernel, dim=target.shape, inputs=[source], outputs=[target], device=target.device)
