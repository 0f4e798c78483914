"""The number of threads that share the environments of a batch on a CPU."""

from __future__ import annotations

from collections.abc import Sequence

import warp as wp

from tactemu.base.errors import SceneError
from tactemu.plan.thread_pool import cores
from tactemu.sensors.sensor import Sensor

WORK_PER_THREAD = 2**14
"""Work of a step (:attr:`SensorModel.work` of all taxels) from which on one more thread saves time: it takes about
75 µs, and waking a thread up to 50."""


def thread_count(threads: int | None, device: wp.Device, n_envs: int, sensors: Sequence[Sensor]) -> tuple[int, str]:
    """Return the number of threads that share the environments, and the reason as a phrase."""
    if threads is not None and (isinstance(threads, bool) or int(threads) != threads or threads < 1):
        raise SceneError(f"build: threads must be None or a whole number >= 1, got {threads!r}")
    if not device.is_cpu:
        if threads not in (None, 1):
            raise SceneError(f"build: threads applies to a CPU only, and this is {device}; leave it out")
        return 1, ""
    if n_envs == 1:
        return 1, " (one environment)"
    each = f" of {n_envs} environments"
    if threads is not None:
        found = min(int(threads), n_envs)
        return found, f" (as asked for), {-(-n_envs // found)}{each} at most to each"
    work = n_envs * sum(sensor.model.work * sensor.n_taxels for sensor in sensors)
    pays = max(1, int(work // WORK_PER_THREAD))
    found = min(cores(), n_envs, pays)
    if found == 1:
        return 1, " (a step is too short for more)" if pays == 1 else " (one core)"
    return found, f", {-(-n_envs // found)}{each} at most to each"
