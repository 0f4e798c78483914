"""The kernel for a GPU, where one or a few blocks of threads handle the probes of an environment.

All threads of a block then read the same poses, and compute the environment from the block's number alone: dividing a
thread's own number by the number of probes would take longer than testing a ball.
"""

import functools
from dataclasses import dataclass

import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.plan.scalars import natural
from tactemu.sensors.probes.formula import Formula, probe_functions, task_type
from tactemu.sensors.sensed import near_bits

MAX_BLOCK_THREADS = 128
"""Maximum number of threads of a block."""
MIN_BUSY_THREADS = 2**18
"""Number of threads that keep a GPU busy: with fewer, several blocks share an environment."""


@dataclass(frozen=True)
class Blocks:
    """The distribution of threads over environments and probes."""

    n_envs: int
    n_probes: int

    @property
    def block_dim(self) -> int:
        """Number of threads of a block, a multiple of a warp."""
        n_probes = max(1, self.n_probes)
        turns = -(-n_probes // MAX_BLOCK_THREADS)
        return 32 * -(-n_probes // (32 * turns))

    @property
    def shift(self) -> int:
        """Binary logarithm of the number of blocks that share an environment."""
        turns, shift = -(-self.n_probes // self.block_dim), 0
        while 2**shift < turns and self.n_envs * self.block_dim * 2**shift < MIN_BUSY_THREADS:
            shift += 1
        return shift

    @property
    def n_threads(self) -> int:
        """Number of threads of the launch."""
        return self.n_envs * self.block_dim * 2**self.shift


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return (blockIdx.z * gridDim.y + blockIdx.y) * gridDim.x + blockIdx.x;
#else
    return 0;
#endif
""")
def block_index() -> int:
    """Return the index of this thread's block in the launch."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return threadIdx.x;
#else
    return 0;
#endif
""")
def thread_index() -> int:
    """Return the index of this thread in its block."""
    ...


@functools.cache
def block_kernel(formula: Formula, shift: int):
    """Return the kernel of a formula on a GPU: the truth and, if separate, the measured branch."""
    real, task_struct = formula.real, task_type(formula.real, formula.numbers)
    margin, nearest, write, _away = probe_functions(formula)

    @warp_kernel(grid_stride=False)
    def measure_probes(first_env: int, task: task_struct):
        block = block_index()
        e = natural(block >> wp.static(shift))
        first = (block - (e << wp.static(shift))) * wp.block_dim() + thread_index()
        near = near_bits(task.sensed.near, task.sensed.targets, e)
        for i in range(first, task.probes.radii.shape[0], wp.block_dim() << wp.static(shift)):
            i = natural(i)
            reach = margin(task, e, i)
            if reach >= real(0.0):
                distance, normal, b = nearest(task.sensed, near, task.probes, e, i, reach)
                write(task, distance, normal, b, e, i)

    return measure_probes
