"""The scan of taxels that are read one after the other, each at a time of its own."""

# pyright: reportArgumentType=false, reportAssignmentType=false, reportGeneralTypeIssues=false

import functools

import numpy as np
import warp as wp

from tactemu.base.errors import SceneError
from tactemu.base.kernels import warp_kernel
from tactemu.base.options import numbers
from tactemu.imperfections.info import ReadingInfo
from tactemu.imperfections.options import ChainOptions
from tactemu.imperfections.ring import Ring, entries, entry_before, ring_depth, share_of_newer, slot
from tactemu.plan.plan import Context, Stage


@functools.cache
def _kernel(real: type):
    @warp_kernel
    def scan(
        first_env: int,
        x: wp.array2d(dtype=real),
        n_channels: int,
        step: wp.array(dtype=wp.int64),
        time_ns: wp.array(dtype=wp.int64),
        dt: wp.array(dtype=wp.float64),
        ages: wp.array(dtype=wp.int64),
        birth: wp.array(dtype=wp.int64),
        times: wp.array(dtype=wp.int64),
        ring: wp.array3d(dtype=real),
        out: wp.array2d(dtype=real),
    ):
        e, i = wp.tid()
        e += first_env
        now, number = time_ns[0], step[0]
        source = now - ages[i]
        dt_ns = wp.max(dt[0] * wp.float64(1.0e9), wp.float64(1.0))
        guess = int(wp.float64(ages[i]) / dt_ns)
        count = entries(birth[e], number, times.shape[0])
        old = entry_before(times, now, number, count, guess, source)
        share = real(share_of_newer(times, now, number, count, old, source, wp.int64(dt_ns)))
        for c in range(i * n_channels, (i + 1) * n_channels):
            v = x[e, c]
            ring[slot(number, 0, times.shape[0]), e, c] = v
            if old > 0:
                a = real(0.0)
                if old < count:
                    a = ring[slot(number, old, times.shape[0]), e, c]
                if share > real(0.0):
                    if old > 1:
                        v = ring[slot(number, old - 1, times.shape[0]), e, c]
                    a = a + share * (v - a)
                v = a
            out[e, c] = v
        if i == 0:
            if birth[e] < wp.int64(0):
                birth[e] = number - wp.int64(1)
            if e == 0:
                times[slot(number, 0, times.shape[0])] = now

    return scan


def slots(options: ChainOptions, info: ReadingInfo) -> np.ndarray:
    """Return the slot of the scan in which each taxel is read, from 0, shape ``(n_taxels,)``.

    Raises:
        SceneError: the order needs rows on a layout without rows, or is a list of the wrong length.
    """
    order, index = options.scan_order, np.arange(info.n_taxels)
    if not isinstance(order, str):
        given = numbers(f"sensor {info.name!r}", "scan_order", order).reshape(-1)
        if given.shape != index.shape or (given < 0).any() or (given != np.rint(given)).any():
            raise SceneError(
                f"sensor {info.name!r}: scan_order must give one slot (0, 1, ...) for each taxel, got {order!r}"
            )
        return given.astype(np.int64)
    if order == "taxel":
        return index
    if len(info.layout) != 2:
        raise SceneError(
            f"sensor {info.name!r}: scan_order {order!r} on layout {info.layout}; expected 'taxel', slots, or on a"
            f" (rows, cols) layout 'row' or 'column'"
        )
    row, col = np.divmod(index, info.layout[1])
    return col if order == "row" else row


def compile_scan(options: ChainOptions, x: wp.array, info: ReadingInfo, context: Context) -> tuple[wp.array, Stage]:
    """Return readings ``(n_envs, n_columns)``, each of its taxel's slot in the scan that ends now, and the stage."""
    order = slots(options, info)
    n_slots = int(order.max(initial=0)) + 1
    ages = np.rint(options.scan_time * 1e9 * (1.0 - (order + 1.0) / n_slots)).astype(np.int64)
    depth = ring_depth(float(ages.max(initial=0)) * 1e-9, context, f"sensor {info.name!r}: scan_time")
    ring = Ring(depth, info.n_columns, context.real, context)
    out = context.zeros(x.shape, context.real)
    launch = context.record(
        _kernel(context.real),
        (context.n_envs, info.n_taxels),
        [x, info.n_channels, context.step, context.time_ns, context.dt, wp.array(ages, device=context.device)],
        [ring.birth, ring.times, ring.values, out],
    )
    reason = f"scan_time {options.scan_time:g} s over {n_slots} slots"
    return out, Stage(name=f"{info.name}: scan", reason=reason, launch=launch, reset=ring.reset)
