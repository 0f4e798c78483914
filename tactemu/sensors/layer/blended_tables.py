"""The compliances that contact sees in a step of a relaxing skin under soft objects.

The displacement of the skin is ``C P``, with the pressures ``P`` of an elastic layer that is displaced equally; that of
the object, which does not relax, is ``C_o p``, with the true pressures ``p``. With ``P = z + h`` and ``p = s z``
(:mod:`.memory`), and the overlap ``o``::

    C P + C_o p = (C + s C_o) z + C h        z >= 0,  (C + s C_o) z >= o - C h,  z ((C + s C_o) z - (o - C h)) = 0

Tractions, and the displacement along the skin by pressure, are treated alike. The skin's memory is an offset, as under
rigid objects, and contact is solved with the blend ``C + s C_o``, which is computed anew where the length of a step,
and so ``s``, has changed.
"""

# pyright: reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false, reportGeneralTypeIssues=false

import functools
from typing import Any

import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.plan.launches import Launch, record
from tactemu.sensors.layer.memory import memory_type, share_of_step
from tactemu.sensors.layer.tables import COMPLIANCES, INVERSES, LayerTables, tables_type

MAX_THREADS = 65536
"""Maximum number of threads on a GPU; each computes several entries of longer tables."""


class BlendedTables:
    """The spectra of a relaxing skin and of soft objects, weighed for the step.

    Args:
        skin: the spectra of the skin alone.
        both: those of the skin and of the objects, in the same unit.
        real: type of the numbers.
        device: device of the arrays.
    """

    def __init__(self, skin: LayerTables, both: LayerTables, real: Any, device: Any):
        self._skin, self._both, self._real, self._device = skin.struct, both.struct, real, device
        self.struct = tables_type(real)()
        self.struct.start = both.struct.start
        for name in (*COMPLIANCES, *INVERSES):
            array = getattr(both.struct, name)
            if array is not None and array.shape[0]:
                setattr(self.struct, name, wp.clone(array))
        self._made_for = wp.full(1, -1.0, dtype=wp.float64, device=device)

    def blend(self, dt: wp.array, memory: Any) -> Launch:
        """Return the launch that weighs the spectra for a step of ``dt[0]`` [s]."""
        threads = 1 if wp.get_device(self._device).is_cpu else min(self.struct.nn.shape[0], MAX_THREADS)
        inputs = [dt, memory, self._skin, self._both, self._made_for, threads]
        kernel = blend_kernel(self._real, wp.get_device(self._device).is_cpu)
        return record(kernel, threads, inputs, [self.struct], self._device)


@functools.cache
def blend_kernel(real, is_alone: bool):
    """Return the kernel that weighs spectra; ``is_alone``: one thread computes all entries, unless the step is as long
    as the last one."""
    tables_struct, memory_struct = tables_type(real), memory_type(real)
    numbers = wp.array(dtype=real)

    @wp.func
    def mix(skin: numbers, both: numbers, s: real, first: int, threads: int, out: numbers):
        for i in range(first, out.shape[0], threads):
            out[i] = skin[i] + s * (both[i] - skin[i])

    @wp.func
    def mix_inverse(skin: numbers, both: numbers, s: real, first: int, threads: int, out: numbers):
        one = real(1.0)
        for i in range(first, out.shape[0], threads):
            out[i] = one / (one / skin[i] + s * (one / both[i] - one / skin[i]))

    @warp_kernel
    def blend(
        dt: wp.array(dtype=wp.float64),
        memory: memory_struct,
        skin: tables_struct,
        both: tables_struct,
        made_for: wp.array(dtype=wp.float64),
        threads: int,
        out: tables_struct,
    ):
        first = wp.tid()
        scale = share_of_step(memory, dt[0])
        if wp.static(is_alone):
            if scale == made_for[0]:
                return
            made_for[0] = scale
        s = real(scale)
        mix(skin.nn, both.nn, s, first, threads, out.nn)
        mix(skin.xx, both.xx, s, first, threads, out.xx)
        mix(skin.yy, both.yy, s, first, threads, out.yy)
        mix(skin.xy, both.xy, s, first, threads, out.xy)
        mix(skin.nx, both.nx, s, first, threads, out.nx)
        mix(skin.ny, both.ny, s, first, threads, out.ny)
        mix_inverse(skin.soften, both.soften, s, first, threads, out.soften)
        mix_inverse(skin.soften_x, both.soften_x, s, first, threads, out.soften_x)
        mix_inverse(skin.soften_y, both.soften_y, s, first, threads, out.soften_y)

    return blend
