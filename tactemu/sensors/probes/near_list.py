"""The kernels for a GPU where bodies are searched: one lists the probes that need a search, one searches for each of
them.

If each thread searched for its own probe, only some of which are near a mesh, most threads of a warp would be idle.
"""

# pyright: reportArgumentType=false

import functools

import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.geometry.shapes.shape import FAR, without_search
from tactemu.plan.launches import Launch, in_turn
from tactemu.plan.scalars import natural
from tactemu.sensors.probes.formula import Formula, probe_functions, task_type
from tactemu.sensors.probes.query import within_function
from tactemu.sensors.sensed import ALL_NEAR
from tactemu.sensors.sensor_model import Site

SEARCH_BLOCK_THREADS = 64
"""Number of threads of a searching block: few, since one slow thread keeps the registers of the others."""


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const unsigned together = __activemask();
    const int lane = threadIdx.x % 32, first = __ffs(together) - 1;
    int at = 0;
    if (lane == first)
        at = atomicAdd(count.data, __popc(together));
    at = __shfl_sync(together, at, first) + __popc(together & ((1u << lane) - 1u));
#else
    const int at = count.data[0]++;
#endif
    listed.data[at] = value;
""")
def append(listed: wp.array(dtype=wp.int32), count: wp.array(dtype=wp.int32), value: int):
    """Append a number to a list; the threads of a warp write next to each other, with one atomic operation."""
    ...


@functools.cache
def list_kernel(formula: Formula):
    """Return the kernel that lists the probes near a body, unless their distance is known without a search, and writes
    the readings of the others."""
    real, task_struct = formula.real, task_type(formula.real, formula.numbers)
    within = within_function(real, formula.kinds, formula.along_normal)
    some_known = not formula.along_normal and any(kind.without_search for kind in formula.kinds)
    margin, known, write, away = probe_functions(formula._replace(kinds=without_search(formula.kinds)))

    @warp_kernel(grid_stride=False)
    def list_near(first_env: int, task: task_struct, near: wp.array(dtype=wp.int32), n_near: wp.array(dtype=wp.int32)):
        thread = wp.tid()
        i = natural(thread // task.sensed.pose.shape[0])
        e = natural(
            thread - i * task.sensed.pose.shape[0]
        )  # neighbouring threads take the same probe in many environments
        reach = margin(task, e, i)
        if reach >= real(0.0):
            if not within(task.sensed, task.probes, e, i, reach):
                away(task, e, i)
                return
            if wp.static(some_known):
                distance, normal, b = known(task.sensed, ALL_NEAR, task.probes, e, i, reach)
                if distance != real(-FAR):
                    write(task, distance, normal, b, e, i)
                    return
            append(near, n_near, e * task.probes.radii.shape[0] + i)

    return list_near


@functools.cache
def search_kernel(formula: Formula):
    """Return the kernel that searches the bodies for each probe of the list."""
    task_struct = task_type(formula.real, formula.numbers)
    margin, nearest, write, _away = probe_functions(formula)

    @warp_kernel(grid_stride=False)
    def search_near(
        first_env: int, task: task_struct, near: wp.array(dtype=wp.int32), n_near: wp.array(dtype=wp.int32)
    ):
        k = wp.tid()
        if k < n_near[0]:
            e = natural(near[k] // task.probes.radii.shape[0])
            i = natural(near[k] - e * task.probes.radii.shape[0])
            reach = margin(task, e, i)
            distance, normal, b = nearest(task.sensed, ALL_NEAR, task.probes, e, i, reach)
            write(task, distance, normal, b, e, i)

    return search_near


def record_listed(site: Site, formula: Formula, task) -> Launch:
    """Return the recorded launches of both kernels for a :func:`~tactemu.sensors.probes.formula.task_type`."""
    context, n = site.context, site.probes.n
    # scratch: each step fills both before it reads them
    near = wp.empty(context.n_envs * n, dtype=wp.int32, device=context.device)
    n_near = wp.zeros(1, dtype=wp.int32, device=context.device)
    listed = context.record(list_kernel(formula), near.size, [task], [near, n_near])
    search = search_kernel(formula)
    searched = context.record(search, near.size, [task, near, n_near], [], block_dim=SEARCH_BLOCK_THREADS)
    return in_turn(n_near.zero_, listed, searched)
