"""The plan of a scene: the stages that it needs, each with its reason, launched in order.

Stages are compiled once, when the scene is built: arrays are allocated and launches recorded then, and a step only
launches. On the CPU each stage is a recorded launch, and threads may share the environments of a batch
(:mod:`tactemu.plan.thread_pool`); on a GPU the plan is captured in one CUDA graph.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from html import escape
from itertools import pairwise
from statistics import median
from typing import Any, Literal

import numpy as np
import warp as wp

from tactemu.plan.array_types import WarpArray
from tactemu.plan.clock import begin, clock_of
from tactemu.plan.launches import Launch, Launches, record, record_blocks
from tactemu.plan.thread_pool import ThreadPool, cores

Dtype = Literal["float32", "float64"]
"""Width of the kernels' numbers."""
MIN_SHARED_COPY_BYTES = 2**20
"""Size of an array from which on several threads copy it [bytes]; a smaller one is copied faster by one thread."""
MAX_COPY_THREADS = 8
"""Maximum number of threads that copy a GPU's readings."""


@dataclass(frozen=True, kw_only=True)
class Context:
    """The information that a stage may use while it is compiled. All sensors of a scene share it."""

    device: wp.Device
    n_envs: int
    """Environments simulated in one launch (at least 1)."""
    real: type
    """``wp.float32``, or ``wp.float64`` in the float64 mode. Kernels are built for it by cached factories."""
    seed: int
    """Root seed; a stage derives its own stream from it and its name (:mod:`tactemu.base.random_streams`)."""
    first_env: int = 0
    """Number of the first environment if others are simulated elsewhere: an environment draws the same random numbers
    wherever it runs."""
    threads: int = 1
    """Threads that share the environments, on a CPU."""
    memory: list[wp.array] = field(default_factory=list)
    """All arrays that last from step to step, in the order in which they were made: the saved state of a simulation."""
    infinite: set[int] = field(default_factory=set)
    """Indices in :attr:`memory` of arrays in which infinity or NaN has a meaning."""
    constants: dict[Any, Any] = field(default_factory=dict)
    """Objects that take long to make and never change, by their inputs; clones of a simulation share them."""
    dt: wp.array = field(init=False)
    """Length of the step being taken [s], float64, shape ``(1,)``: read on the device, so that a graph sees changes."""
    step: wp.array = field(init=False)
    """Number of the step being taken, from 1, int64, shape ``(1,)``."""
    time_ns: wp.array = field(init=False)
    """Simulated time at the end of the step being taken [ns], int64, shape ``(1,)``."""
    began_step: wp.array = field(init=False)
    """Number of the step after which each environment was last reset, int64, shape ``(n_envs,)``: since then it has
    taken ``step[0] - began_step[e]`` steps."""
    began_ns: wp.array = field(init=False)
    """Simulated time at which each environment was last reset [ns], int64, shape ``(n_envs,)``: its own time is
    ``time_ns[0] - began_ns[e]``."""
    streams: wp.array = field(init=False)
    """The random streams of each environment, vec3i, shape ``(n_envs,)``: its number, counted over all devices, the
    number of its resets, and -1. From a reset with a seed on: the low half of the seed, the number of resets since, and
    the high half (:mod:`tactemu.imperfections.random`)."""

    def __post_init__(self):
        for name, dtype in (("dt", wp.float64), ("step", wp.int64), ("time_ns", wp.int64)):
            object.__setattr__(self, name, self.zeros(1, dtype))
        for name in ("began_step", "began_ns"):
            object.__setattr__(self, name, self.zeros(self.n_envs, wp.int64))
        streams = np.tile(np.array([0, 0, -1], np.int32), (self.n_envs, 1))
        streams[:, 0] = self.first_env + np.arange(self.n_envs)
        object.__setattr__(self, "streams", self.array(streams, wp.vec3i))

    @cached_property
    def clock(self) -> Any:
        """The step being taken, as kernels read it."""
        names = ("dt", "step", "time_ns", "began_step", "began_ns", "streams")
        return clock_of(**{name: getattr(self, name) for name in names})

    def begin(self, mask: wp.array, seeds: wp.array | None = None) -> None:
        """Begin an episode where the mask (bool, shape ``(n_envs,)``) is true.

        On a GPU the call does not wait for the device and can be captured in a graph.

        Args:
            mask: the environments to reset.
            seeds: a number for each environment, int64, shape ``(n_envs,)``, from which those of the mask draw from now
                on; ``None``: they continue as before, and draw anew.
        """
        wp.launch(begin, dim=self.n_envs, inputs=[mask, seeds, self.clock], device=self.device)

    # These methods make every array that a stage writes or that may be set while it runs. Scratch, which a step fills
    # before it reads it, and constants are plain arrays.

    def zeros(self, shape: int | tuple[int, ...] | list[int], dtype: Any) -> WarpArray:
        """Return a new array of zeros that is part of the state."""
        return self._kept(wp.zeros(shape, dtype=dtype, device=self.device))

    def full(self, shape: int | tuple[int, ...] | list[int], value: float, dtype: Any) -> WarpArray:
        """Return a new array of one value that is part of the state; a value that is not finite may occur in it again
        later."""
        if not np.isfinite(value):
            self.infinite.add(len(self.memory))
        return self._kept(wp.full(shape, dtype(value), dtype=dtype, device=self.device))

    def array(self, values: Any, dtype: Any) -> WarpArray:
        """Return a new array of these values that is part of the state."""
        return self._kept(wp.array(values, dtype=dtype, device=self.device))

    def _kept(self, array: wp.array) -> WarpArray:
        self.memory.append(array)
        return array

    @property
    def shares(self) -> list[tuple[int, int]]:
        """The environments of each thread, ``(first, end)``."""
        ends = [self.n_envs * k // self.threads for k in range(self.threads + 1)]
        return list(pairwise(ends))

    def record(
        self,
        kernel: Any,
        dim: int | Sequence[int],
        inputs: list[Any],
        outputs: list[Any],
        *,
        block_dim: int | None = None,
    ) -> Launches:
        """Return a recorded launch over environments, which are the first axis of ``dim``.

        Args:
            kernel: its first argument, which is added to ``inputs``, is the environment that its first thread takes:
                ``e, i = wp.tid()`` and then ``e += first_env``.
            dim: shape of the launch over all environments.
            inputs: the other arguments.
            outputs: the arrays that it writes.
            block_dim: threads of a block on a GPU; choose few where there are few threads, each of which takes long.
                Default: Warp's own.
        """
        dim = (dim,) if isinstance(dim, int) else tuple(dim)
        dims = [(end - first, *dim[1:]) for first, end in self.shares] if self.threads > 1 else [dim]
        launches = zip(self.shares, dims)
        how = (self.device, block_dim)
        return Launches([[record(kernel, d, [e, *inputs], outputs, *how)] for (e, _end), d in launches])

    def record_blocks(
        self, kernel: Any, n_slots: int, inputs: list[Any], outputs: list[Any], block_dim: int
    ) -> Launches:
        """Return a recorded launch of a kernel whose blocks of threads take environments in turn, each block with its
        own slot of scratch.

        Args:
            kernel: its first argument, which is added to ``inputs``, is a ``vec4i``: first environment, end, first
                slot, and how many slots take turns.
            n_slots: number of slots: on a GPU one for each block, on a CPU one for each thread.
            inputs: the other arguments.
            outputs: the arrays that it writes.
            block_dim: threads of a block.
        """
        turns = n_slots // self.threads
        shares = [wp.vec4i(first, end, k * turns, turns) for k, (first, end) in enumerate(self.shares)]
        how = (block_dim, self.device)
        return Launches([[record_blocks(kernel, turns, [share, *inputs], outputs, *how)] for share in shares])


@dataclass(kw_only=True)
class Stage:
    """One entry of the plan."""

    name: str
    reason: str
    """The reason why this scene needs the stage; ``tactemu explain`` prints it."""
    launch: Launch
    """The function that runs the stage: :class:`~tactemu.plan.launches.Launches` where threads may share it. It
    allocates nothing, reads nothing back, and can be captured in a CUDA graph."""
    reset: Callable[[wp.array], None] | None = None
    """A function that clears the stage's state where the mask (bool, shape ``(n_envs,)``) is true; ``None``: the stage
    has no state."""
    check: Callable[[], None] | None = None
    """A function that waits for the device and raises an error if the stage failed there."""
    cost_us: float | None = None
    """Median cost [µs] as measured by :meth:`Plan.time_stages`."""
    cheaper: str = ""
    """The option to change so that the stage costs less, as a phrase; empty where only another model helps."""


@dataclass
class Plan:
    """The stages of a built scene, in the order in which they run. ``print(plan)`` shows them as a table with their
    reasons."""

    stages: list[Stage] = field(default_factory=list)
    device: wp.Device | None = None
    threads: int = 1
    """Number of threads that share the environments on a CPU."""
    why_threads: str = ""
    """The reason for this number, as a phrase."""
    _graph: wp.Graph | None = field(default=None, repr=False)
    _warm: bool = field(default=False, repr=False)
    _thread_pool: ThreadPool | None = field(default=None, repr=False)
    _legs: list[list[list[Launch]]] = field(default_factory=list, repr=False)
    """The legs of a step, after each of which the threads meet: each holds one list of launches, or one for each
    thread."""

    def run(self) -> None:
        """Run all stages once. On a GPU the second run captures them in a graph, and later runs launch that graph."""
        if self._graph is not None:
            wp.capture_launch(self._graph)
        elif self._warm and self.device is not None and self.device.is_cuda:
            self._capture()
        else:  # on a GPU the first run loads the stages' modules, which a capture must not do
            self._launch()
            self._warm = True

    def _launch(self) -> None:
        self._legs = self._legs or self._plan_legs()
        for shares in self._legs:
            if len(shares) > 1:
                self._thread_pool = self._thread_pool or ThreadPool(self.threads)
                self._thread_pool.run(shares)
            else:
                for launch in shares[0]:
                    launch()

    def _plan_legs(self) -> list[list[list[Launch]]]:
        """Return the legs: consecutive stages that threads can share form one leg; the caller's thread runs the other
        stages."""
        legs: list[list[list[Launch]]] = []
        for stage in self.stages:
            launch = stage.launch
            shares = launch.shares if isinstance(launch, Launches) else ((launch,),)
            if not shares:
                continue
            if not legs or len(legs[-1]) != len(shares):
                legs.append([[] for _ in shares])
            for mine, more in zip(legs[-1], shares):
                mine += more
        return legs

    def copied(self, values: np.ndarray) -> np.ndarray:
        """Return a copy of a CPU array; the threads copy a large one if they are running.

        A GPU's steps need no threads, so they start with the first large copy, which spends most of its time on new
        memory pages.
        """
        if values.nbytes < MIN_SHARED_COPY_BYTES:
            return values.copy()
        if self._thread_pool is None and self.device is not None and self.device.is_cuda:
            self._thread_pool = ThreadPool(min(cores(), MAX_COPY_THREADS))
        if self._thread_pool is None or not (self._thread_pool.is_running or self._thread_pool.size > self.threads):
            return values.copy()
        out = np.empty_like(values)
        ends = [len(values) * k // self._thread_pool.size for k in range(self._thread_pool.size + 1)]
        self._thread_pool.run([[partial(np.copyto, out[a:b], values[a:b])] for a, b in pairwise(ends)])
        return out

    def insert(self, stage: Stage, before: str = "") -> None:
        """Add a stage to a plan that may have run already; it replaces a stage of the same name.

        Args:
            stage: the stage, launched from the next run on.
            before: name of the stage in front of which it is inserted; default: at the end.
        """
        self.remove(stage.name)
        names = [each.name for each in self.stages]
        self.stages.insert(names.index(before) if before in names else len(names), stage)

    def remove(self, name: str) -> None:
        """Remove the stage of this name, if there is one."""
        self.stages = [each for each in self.stages if each.name != name]
        self._graph, self._warm, self._legs = None, False, []

    @property
    def has_run(self) -> bool:
        """Has the plan run once, so that it can be captured in a graph?"""
        return self._warm

    def run_within_capture(self) -> None:
        """Run all stages once on a GPU while the caller captures the stream; they become part of the caller's graph."""
        self._launch()

    def close(self) -> None:
        """End the threads; a later run starts them again."""
        if self._thread_pool is not None:
            self._thread_pool.close()

    def _capture(self) -> None:
        with wp.ScopedCapture(self.device, force_module_load=False) as capture:
            self._launch()
        assert capture.graph is not None
        self._graph = capture.graph
        wp.capture_launch(self._graph)

    def reset(self, mask: wp.array) -> None:
        """Clear the state of all stages where the mask (bool, shape ``(n_envs,)``) is true."""
        for stage in self.stages:
            if stage.reset is not None:
                stage.reset(mask)

    def time_stages(self, now_ns: Callable[[], int], repeats: int = 50) -> dict[str, float]:
        """Return the median cost of each stage [µs] by name, and keep it in ``stage.cost_us``. Advances the stages'
        state.

        Args:
            now_ns: a clock, such as ``time.perf_counter_ns``; the plan has none of its own.
            repeats: runs of each stage.
        """
        device = self.device or wp.get_device("cpu")
        costs: dict[str, float] = {}
        for stage in self.stages:
            times = []
            for _ in range(repeats):
                wp.synchronize_device(device)
                start = now_ns()
                stage.launch()
                wp.synchronize_device(device)
                times.append(now_ns() - start)
            stage.cost_us = costs[stage.name] = median(times) / 1e3
        return costs

    def __str__(self) -> str:
        rows = [("stage", "µs", "why")]
        for stage in self.stages:
            cost = "" if stage.cost_us is None else f"{stage.cost_us:.1f}"
            rows.append((stage.name, cost, stage.reason))
        widths = [max(len(row[column]) for row in rows) for column in (0, 1)]
        lines = [f"{name:<{widths[0]}}  {cost:>{widths[1]}}  {why}".rstrip() for name, cost, why in rows]
        return "\n".join([*lines, f"threads: {self.threads}{self.why_threads}"] if self.why_threads else lines)

    def _repr_html_(self) -> str:
        """Return the table of :meth:`__str__` as HTML for a notebook."""
        rows = "".join(
            f"<tr><td>{escape(stage.name)}</td><td>{'' if stage.cost_us is None else f'{stage.cost_us:.1f}'}</td>"
            f"<td>{escape(stage.reason)}</td></tr>"
            for stage in self.stages
        )
        return f"<table><tr><th>stage</th><th>µs</th><th>why</th></tr>{rows}</table>"
