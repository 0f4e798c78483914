"""The options with which a scene is built, and the device that they name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import warp as wp

from tactemu.base.errors import SceneError
from tactemu.base.kernels import start_warp
from tactemu.sensors.sensor_compiler import MAX_LAUNCH_THREADS

REAL = {"float32": wp.float32, "float64": wp.float64}
"""The number type of the kernels by its name."""


def device_of(name: Any) -> wp.Device:
    """Return the Warp device of a name; ``None``: Warp's current one.

    Raises:
        SceneError: there is none of this name.
    """
    start_warp()
    try:
        return wp.get_device(name)
    except Exception as error:
        known = ", ".join(str(device) for device in wp.get_devices())
        raise SceneError(
            f"no device {name!r} on this machine ({error}): write 'cpu', 'cuda' or 'cuda:N', such as 'cuda:0' for the "
            f"first GPU; kernels run on: {known}"
        ) from None


@dataclass(frozen=True, kw_only=True)
class BuildOptions:
    """The options of :meth:`tactemu.Scene.build`, which describes them."""

    n_envs: int | None
    device: Any = "cpu"
    seed: int = 0
    dtype: str = "float32"
    first_env: int = 0
    threads: int | None = None

    def __post_init__(self):
        n_envs, first_env = self.n_envs, self.first_env
        if n_envs is not None and (isinstance(n_envs, bool) or int(n_envs) != n_envs or n_envs < 1):
            raise SceneError(f"build: n_envs must be None or a whole number >= 1, got {n_envs!r}")
        if isinstance(first_env, bool) or int(first_env) != first_env or not 0 <= first_env < MAX_LAUNCH_THREADS:
            raise SceneError(
                f"build: first_env must be a whole number from 0 to {MAX_LAUNCH_THREADS - 1}, got {first_env!r}"
            )
        if self.dtype not in REAL:
            raise SceneError(f"build: dtype must be one of {', '.join(REAL)}, got {self.dtype!r}")
