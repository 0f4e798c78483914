"""The kernels for a GPU where bodies are searched: they list the probes that need a search, sort the list by place, and
search for each of its probes.

If each thread searched for its own probe, only some of which are near a mesh, most threads of a warp would be idle. The
threads of a warp also take turns wherever their searches differ. So those probes of all environments are neighbours in
the list which lie in the same cell of a body's own frame: their searches open the same nodes.
"""

# pyright: reportArgumentType=false, reportGeneralTypeIssues=false

import functools

import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.geometry.shapes.distance import shape_functions
from tactemu.geometry.shapes.shape import FAR, without_search
from tactemu.plan.launches import Launch, in_turn, record
from tactemu.plan.scalars import natural
from tactemu.sensors.probes.formula import Formula, probe_functions, task_type
from tactemu.sensors.probes.query import within_function
from tactemu.sensors.sensed import ALL_NEAR, sensed_type
from tactemu.sensors.sensor_model import Site

CELLS_PER_SIDE = 64
"""Number of cells along each axis of a body's frame by which the list is sorted; a cell is so much shorter than the
radius of the ball around the body."""
CELLS_PER_THREAD = 8
"""Number of cells that a thread allots; a warp allots 256, a block of 8 x 8 x 4 cells."""
SEARCH_BLOCK_THREADS = 64
"""Number of threads of a searching block: few, since one slow thread keeps the registers of the others."""
MIN_SEARCH_BLOCKS = 16
"""Number of searching blocks that a multiprocessor holds at once; it limits the registers of a thread."""


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
    return at;
""")
def append(listed: wp.array(dtype=wp.int32), count: wp.array(dtype=wp.int32), value: int) -> int:
    """Append a number to a list, and return its index; the threads of a warp write next to each other, with one atomic
    operation."""
    ...


@wp.struct
class NearList:
    """The probes that need a search."""

    n: wp.array(dtype=wp.int32)  # their number
    probes: wp.array(dtype=wp.int32)  # index of each, over all environments, as found
    cells: wp.array(dtype=wp.int32)  # the cell of each
    ranks: wp.array(dtype=wp.int32)  # its number in its cell
    counts: wp.array(dtype=wp.int32)  # number of probes in each cell, then the first place of each in the sorted list
    n_sorted: wp.array(dtype=wp.int32)
    sorted: wp.array(dtype=wp.int32)


@functools.cache
def cell_function(real, kinds: frozenset):
    """Return ``cell_of(sensed, r, e, margin)``: the cell, in the frame of the first body within reach, that holds the
    point ``r`` of the link's frame.

    Cells are numbered along a Z-order curve, so that those with neighbouring numbers are near each other; numbers
    repeat after :data:`CELLS_PER_SIDE` cells along each axis.
    """
    vec3, reaches = wp.types.vector(3, real), shape_functions(real, kinds).reaches

    @wp.func
    def spread(x: real):
        """Return the last bits of a whole number, as many as a side needs (six), with two zeros before each."""
        bits = int(x) & wp.static(CELLS_PER_SIDE - 1)
        bits = (bits ^ (bits << 8)) & 0x0000F00F
        bits = (bits ^ (bits << 4)) & 0x000C30C3
        return (bits ^ (bits << 2)) & 0x00249249

    @wp.func
    def cell_of(sensed: sensed_type(real), r: vec3, e: int, margin: real):
        for t in range(sensed.targets.shape[0]):
            b = natural(sensed.targets[natural(t)])
            pose = sensed.pose[e, b]
            if reaches(sensed.shapes, b, pose, r, margin):
                p = wp.quat_rotate_inv(wp.transform_get_rotation(pose), r - wp.transform_get_translation(pose))
                p *= real(wp.static(CELLS_PER_SIDE)) / sensed.shapes.bound[b]
                return 4 * spread(wp.floor(p[0])) + 2 * spread(wp.floor(p[1])) + spread(wp.floor(p[2]))
        return int(0)

    return cell_of


@functools.cache
def list_kernel(formula: Formula):
    """Return the kernel that lists the probes near a body, unless their distance is known without a search, and writes
    the readings of the others."""
    real, task_struct = formula.real, task_type(formula.real, formula.numbers)
    within = within_function(real, formula.kinds, formula.along_normal)
    some_known = not formula.along_normal and any(kind.without_search for kind in formula.kinds)
    cell_of = cell_function(real, formula.kinds)
    margin, known, write, away = probe_functions(formula._replace(kinds=without_search(formula.kinds)))

    @warp_kernel(grid_stride=False)
    def list_near(first_env: int, task: task_struct, near: NearList):
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
            at = append(near.probes, near.n, e * task.probes.radii.shape[0] + i)
            cell = cell_of(task.sensed, task.probes.positions[i], e, reach)
            near.cells[at] = cell
            near.ranks[at] = wp.atomic_add(near.counts, cell, 1)

    return list_near


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const int lane = threadIdx.x % 32;
    int sum = count;
    for (int far = 1; far < 32; far *= 2) {
        const int before = __shfl_up_sync(0xffffffffu, sum, far);
        if (lane >= far)
            sum += before;
    }
    int first = lane == 31 ? atomicAdd(total.data, sum) : 0;
    first = __shfl_sync(0xffffffffu, first, 31);
    return first + sum - count;
#else
    const int first = total.data[0];
    total.data[0] += count;
    return first;
#endif
""")
def reserve(total: wp.array(dtype=wp.int32), count: int) -> int:
    """Return the first of ``count`` places of a list; the threads of a warp, which must call it together, get places
    one behind the other."""
    ...


@warp_kernel(grid_stride=False)
def allot_cells(near: NearList):
    """Give each cell its part of the sorted list: those of a warp one behind the other, warps in any order."""
    first = wp.tid() * wp.static(CELLS_PER_THREAD)
    count = int(0)
    for k in range(wp.static(CELLS_PER_THREAD)):
        count += near.counts[first + k]
    place = reserve(near.n_sorted, count)
    for k in range(wp.static(CELLS_PER_THREAD)):
        count = near.counts[first + k]
        near.counts[first + k] = place
        place += count


@warp_kernel
def sort_probes(near: NearList):
    """Copy each probe of the list to its place in the sorted one."""
    k = wp.tid()
    if k < near.n[0]:
        near.sorted[near.counts[near.cells[k]] + near.ranks[k]] = near.probes[k]


@functools.cache
def search_kernel(formula: Formula):
    """Return the kernel that searches the bodies for each probe of the list."""
    task_struct = task_type(formula.real, formula.numbers)
    margin, nearest, write, _away = probe_functions(formula)

    @warp_kernel(grid_stride=False, launch_bounds=(SEARCH_BLOCK_THREADS, MIN_SEARCH_BLOCKS))
    def search_near(first_env: int, task: task_struct, near: NearList):
        k = wp.tid()
        if k < near.n[0]:
            e = natural(near.sorted[k] // task.probes.radii.shape[0])
            i = natural(near.sorted[k] - e * task.probes.radii.shape[0])
            reach = margin(task, e, i)
            distance, normal, b = nearest(task.sensed, ALL_NEAR, task.probes, e, i, reach)
            write(task, distance, normal, b, e, i)

    return search_near


def record_listed(site: Site, formula: Formula, task) -> Launch:
    """Return the recorded launches of all kernels for a :func:`~tactemu.sensors.probes.formula.task_type`."""
    context, size = site.context, site.context.n_envs * site.probes.n
    cells = CELLS_PER_SIDE**3
    near, numbers = NearList(), wp.zeros(cells + 2, dtype=wp.int32, device=context.device)
    near.counts, near.n, near.n_sorted = numbers[:cells], numbers[cells : cells + 1], numbers[cells + 1 :]
    # scratch: each step fills all of it before it reads it
    near.probes, near.cells, near.ranks, near.sorted = (
        wp.empty(size, dtype=wp.int32, device=context.device) for _ in range(4)
    )
    listed = context.record(list_kernel(formula), size, [task, near], [])
    allotted = record(allot_cells, cells // CELLS_PER_THREAD, [near], [], context.device)
    sorting = record(sort_probes, size, [near], [], context.device)
    search = search_kernel(formula)
    searched = context.record(search, size, [task, near], [], block_dim=SEARCH_BLOCK_THREADS)
    return in_turn(numbers.zero_, listed, allotted, sorting, searched)
