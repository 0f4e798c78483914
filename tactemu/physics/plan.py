"""The plan of a scene: the stages that it needs, each with its reason, launched in order.

Stages are compiled once, when the scene is built: arrays are allocated and launches recorded there, and a step does
nothing but launch. On the CPU each stage is a recorded launch; on a GPU the plan is captured in one CUDA graph.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import warp as wp


@dataclass(frozen=True, kw_only=True)
class Context:
    """What a stage may know while it is compiled. Shared by all sensors of a scene."""

    device: wp.Device
    n_envs: int
    """Environments simulated in one launch (at least 1)."""
    real: type
    """``wp.float32``, or ``wp.float64`` in the float64 mode. Kernels are built for it by cached factories."""
    seed: int
    """Root seed; a stage derives its own stream from it and its name (:mod:`tactemu.random_streams`)."""
    dt: wp.array
    """Length of the step being taken [s], float64, shape ``(1,)``: read on the device, so that a graph sees changes."""
    step: wp.array
    """Number of the step being taken, from 1, int64, shape ``(1,)``."""
    time_ns: wp.array | None = None
    """Simulated time at the end of the step being taken [ns], int64, shape ``(1,)``. A scene always gives it."""


@dataclass(kw_only=True)
class Stage:
    """One entry of the plan."""

    name: str
    reason: str
    """Why this scene needs it: printed by ``tactemu explain``."""
    launch: Callable[[], None]
    """Runs it. Allocates nothing, reads nothing back, and can be captured in a CUDA graph."""
    reset: Callable[[wp.array], None] | None = None
    """Clears its state where the mask (bool, shape ``(n_envs,)``) is true. ``None``: it has no state."""
    cost_us: float | None = None
    """Measured by :meth:`Plan.measure`."""


@dataclass
class Plan:
    """The stages of a built scene, in the order they run."""

    stages: list[Stage] = field(default_factory=list)


def record(kernel, dim, inputs: list, outputs: list, device) -> Callable[[], None]:
    """A recorded launch of ``kernel``: calling it costs a fraction of ``wp.launch``."""
    command = wp.launch(kernel, dim=dim, inputs=inputs, outputs=outputs, device=device, record_cmd=True)
    return command.launch
