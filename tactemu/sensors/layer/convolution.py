"""Convolutions of a window of cells with a layer's kernels, by real Hartley transforms, inside a Warp kernel.

One block of threads (a GPU) or one thread (a CPU) computes a complete convolution, so that a solver can run to
convergence within one launch. The kernels of a layer are even or odd along each axis; such a convolution is a product
in the space of the *Hartley* transform ``H(k) = sum f(x) (cos kx + sin kx)``, which is real and its own inverse::

    even kernel g:  H[g * f](k) = g_cos(k) H[f](k)          odd kernel:  H[g * f](k) = g_sin(k) H[f](-k)

Two real columns form one complex column of a Stockham FFT of radix 4. Columns lie next to each other in *lanes*: on a
CPU they fill the vector registers (:mod:`.simd`), on a GPU ``lanes`` is 1 and each thread takes columns. Every pass
transforms along the rows and writes its result transposed; a convolution takes two passes forward and two back.
"""

# pyright: reportIndexIssue=false

import functools
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from tactemu.geometry.simd import WIDTH
from tactemu.sensors.layer.shared_memory import shared_hartley
from tactemu.sensors.layer.simd import SCRATCH, simd_hartley, simd_scale

SMALLEST_TRANSFORM = 32
"""Length of the shortest transform used; a window has at most half its length."""


def lane_width(device: wp.Device) -> int:
    """Return the number of lanes on a device."""
    return 1 if device.is_cuda else WIDTH


class Block(NamedTuple):
    """The block of threads that solve an environment together on a GPU; on a CPU a block is one thread."""

    threads: int
    resident: int
    """Number of blocks that a multiprocessor holds at once; it limits the registers of a thread."""


BLOCK = Block(64, 8)
"""Block of solvers that work in the device's global memory; those in shared memory have their own."""


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __syncthreads();
#endif
""")
def block_sync():
    """Wait for the other threads of the block, and make their writes visible."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const int threads = WP_TILE_BLOCK_DIM;
    const int across = columns < 1 ? 1 : columns < threads ? columns : threads, down = threads / across;
    const int row = thread / across;
    return wp::vec_t<4, wp::int32>(row < down ? row : 1 << 30, down, thread % across, across);
#else
    return wp::vec_t<4, wp::int32>(0, 1, 0, 1);
#endif
""")
def spread(columns: int, thread: int) -> wp.vec4i:
    """Return a thread's share of a window: first row, step of rows, first column, step of columns; a surplus thread is
    idle. On a CPU compilers see that one thread takes all cells, and leave out the code for others."""
    ...


@functools.cache
def workspace_type(real):
    """Return the Warp struct of the convolutions' scratch, one slot per block."""

    @wp.struct
    class Workspace:
        # On a GPU the ping-pong buffers of the FFT, real and imaginary part: (2 n_slots, n_max, n_max / 2). On a CPU
        # the values between two transforms, (n_slots, n_max, n_max), and the buffers of a few columns, (n_slots, 1,
        # ...).
        re: wp.array3d(dtype=real)
        im: wp.array3d(dtype=real)
        # Three spectra: (n_slots, n_max, n_max).
        spectrum: wp.array3d(dtype=real)
        second: wp.array3d(dtype=real)
        third: wp.array3d(dtype=real)
        # exp(-2 pi i j / n_max), j < n_max.
        twiddle: wp.array(dtype=wp.types.vector(2, real))

    return Workspace


def padded_zeros(n: int, rows: int, columns: int, real, lanes: int, device) -> wp.array:
    """Return zeros of shape ``(n, rows, columns or more)``. On a CPU rows fill complete lanes, and are one lane longer,
    so that strides that are powers of two do not crowd one cache set."""
    padded = -(-columns // lanes) * lanes + (lanes if lanes > 1 else 0)
    return wp.zeros((n, rows, padded), dtype=real, device=device)


class Workspace:
    """The scratch for transforms of up to ``n_max``: it allocates the arrays and keeps them alive.

    ``spectra`` is the number of separate spectra needed; the others are aliases of the last of them.
    """

    def __init__(self, n_slots: int, n_max: int, real, lanes: int, device, *, spectra: int = 1):
        half = (2 * n_slots, n_max, n_max // 2)
        shapes = [half, half] if lanes == 1 else [(n_slots, n_max, n_max), (n_slots, 1, SCRATCH * n_max)]
        shapes += [(n_slots, n_max, n_max)] * spectra
        self._arrays = [padded_zeros(*shape, real, lanes, device) for shape in shapes]
        self.struct = struct = workspace_type(real)()
        struct.re, struct.im, struct.spectrum = self._arrays[:3]
        struct.second, struct.third = self._arrays[min(3, 1 + spectra)], self._arrays[-1]
        turns = np.exp(-2j * np.pi * np.arange(n_max) / n_max)
        pairs = np.stack([np.real(turns), np.imag(turns)], axis=1)
        struct.twiddle = wp.array(pairs, dtype=wp.types.vector(2, real), device=device)

    @property
    def nbytes(self) -> int:
        """Size of the arrays [bytes]."""
        return sum(array.size * wp.types.type_size_in_bytes(array.dtype) for array in self._arrays)


class ConvolutionFunctions(NamedTuple):
    """The Warp functions that all threads of a block call together, for transforms of ``size = (n_rows,
    n_columns)``."""

    forward: Any
    """``forward(ws, slot, field, shape, size, spectrum, thread)`` computes the spectrum of the window of ``field`` of
    ``shape = (rows, columns)``."""
    scale: Any
    """``scale(spectrum, table, start, size, thread)`` multiplies a spectrum by an even kernel's."""
    inverse: Any
    """``inverse(ws, slot, spectrum, first, shape, size, out, thread)`` writes the window of ``shape`` that starts at
    ``first = (row, column)``, which may be negative, of the inverse transform into ``out``. It overwrites the
    spectrum."""
    convolve: Any
    """``convolve(ws, slot, field, table, start, shape, size, out, thread)`` does all three; ``out`` has the window's
    shape."""


@functools.cache
def convolution_functions(real, lanes: int, is_shared: bool) -> ConvolutionFunctions:
    """Return the convolution for one float type and lane width. ``rows`` of an inverse and ``columns`` of a forward
    transform must be multiples of ``2 * lanes``. ``is_shared``: the workspace is in shared memory
    (:mod:`.shared_memory`)."""
    workspace = workspace_type(real)
    numbers = wp.array2d(dtype=real)
    turns_array = wp.array(dtype=wp.types.vector(2, real))
    parts_array = wp.array3d(dtype=real)
    radix_4, radix_2 = _fft_stages(numbers, turns_array)

    @wp.func
    def unpack(zr: numbers, zi: numbers, n: int, half: int, first: int, rows_out: int, out: numbers, thread: int):
        """Write the Hartley coefficients of the two columns in each complex one to ``out[column, k - first]``."""
        mine = spread(half, thread)
        for k in range(mine[0], n // 2 + 1, mine[1]):
            mirror = -k & (n - 1)
            at = k - first & (n - 1)
            at_mirror = mirror - first & (n - 1)
            for c in range(mine[2], half, mine[3]):
                xr = zr[k, c]
                xi = zi[k, c]
                yr = zr[mirror, c]
                yi = zi[mirror, c]
                if at < rows_out:
                    out[c, at] = xr + yr - xi + yi
                    out[c + half, at] = xi + yi + xr - yr
                if mirror != k and at_mirror < rows_out:
                    out[c, at_mirror] = xr + yr + xi - yi
                    out[c + half, at_mirror] = xi + yi - xr + yr

    @wp.func(inline=False)  # not inlined: a solver calls it dozens of times
    def long_hartley(
        re_parts: parts_array,
        im_parts: parts_array,
        twiddle: turns_array,
        slot: int,
        field: numbers,
        rows: int,
        columns: int,
        n: int,
        first: int,
        rows_out: int,
        out: numbers,
        thread: int,
    ):
        """Write twice the transform of length ``n`` along the rows of ``field`` to ``out``, ``(columns, rows_out)``,
        which may be the same memory as ``field``."""
        half = columns // 2
        mine = spread(half, thread)
        n_max = twiddle.shape[0]
        re = re_parts[2 * slot]
        im = im_parts[2 * slot]
        for k in range(mine[0], n, mine[1]):
            for c in range(mine[2], half, mine[3]):
                if k < rows:
                    re[k, c] = field[k, c]
                    im[k, c] = field[k, c + half]
                else:
                    re[k, c] = real(0.0)
                    im[k, c] = real(0.0)
        block_sync()
        length = int(n)
        stride = int(1)
        here = int(2 * slot)
        while length >= 4:
            turn = n_max // length
            there = 4 * slot + 1 - here
            radix_4(
                re_parts[here],
                im_parts[here],
                re_parts[there],
                im_parts[there],
                twiddle,
                length,
                stride,
                half,
                turn,
                thread,
            )
            block_sync()
            here = there
            length = length // 4
            stride = stride * 4
        if length == 2:
            there = 4 * slot + 1 - here
            radix_2(re_parts[here], im_parts[here], re_parts[there], im_parts[there], stride, half, thread)
            block_sync()
            here = there
        unpack(re_parts[here], im_parts[here], n, half, first, rows_out, out, thread)
        block_sync()

    in_turn = shared_hartley(real) if is_shared else long_hartley
    simd, scale_simd = simd_hartley(real), simd_scale(real)

    @wp.func
    def hartley(
        ws: workspace,
        slot: int,
        field: numbers,
        rows: int,
        columns: int,
        n: int,
        first: int,
        rows_out: int,
        out: numbers,
        thread: int,
    ):
        if wp.static(lanes > 1):
            simd(ws.im[slot], ws.twiddle, field, rows, columns, n, first, rows_out, out)
        else:
            in_turn(ws.re, ws.im, ws.twiddle, slot, field, rows, columns, n, first, rows_out, out, thread)

    @wp.func
    def between(ws: workspace, slot: int, spectrum: numbers):
        """Return the array into which the first of two passes writes its result."""
        if wp.static(lanes > 1):
            return ws.re[slot]
        else:
            return spectrum

    @wp.func
    def forward(
        ws: workspace, slot: int, field: numbers, shape: wp.vec2i, size: wp.vec2i, spectrum: numbers, thread: int
    ):
        middle = between(ws, slot, spectrum)
        hartley(ws, slot, field, shape[0], shape[1], size[0], 0, size[0], middle, thread)
        hartley(ws, slot, middle, shape[1], size[0], size[1], 0, size[1], spectrum, thread)

    @wp.func
    def scale(spectrum: numbers, table: wp.array(dtype=real), start: int, size: wp.vec2i, thread: int):
        if wp.static(lanes > 1):
            scale_simd(spectrum, table, start, size[0], size[1])
        else:
            mine = spread(size[1], thread)
            for k in range(mine[0], size[0], mine[1]):
                for c in range(mine[2], size[1], mine[3]):
                    spectrum[k, c] = spectrum[k, c] * table[start + k * size[1] + c]
            block_sync()

    @wp.func
    def inverse(
        ws: workspace,
        slot: int,
        spectrum: numbers,
        first: wp.vec2i,
        shape: wp.vec2i,
        size: wp.vec2i,
        out: numbers,
        thread: int,
    ):
        middle = between(ws, slot, spectrum)
        hartley(ws, slot, spectrum, size[0], size[1], size[0], first[0], shape[0], middle, thread)
        hartley(ws, slot, middle, size[1], shape[0], size[1], first[1], shape[1], out, thread)

    @wp.func
    def convolve(
        ws: workspace,
        slot: int,
        field: numbers,
        table: wp.array(dtype=real),
        start: int,
        shape: wp.vec2i,
        size: wp.vec2i,
        out: numbers,
        thread: int,
    ):
        spectrum = ws.spectrum[slot]
        forward(ws, slot, field, shape, size, spectrum, thread)
        scale(spectrum, table, start, size, thread)
        inverse(ws, slot, spectrum, wp.vec2i(0, 0), shape, size, out, thread)

    return ConvolutionFunctions(forward, scale, inverse, convolve)


def _fft_stages(numbers, turns_array):
    """Return the Stockham stages ``(x) -> (y)``: a length of ``length`` remains to be transformed, ``stride`` columns
    of butterflies are done."""

    @wp.func
    def radix_4(
        xr: numbers,
        xi: numbers,
        yr: numbers,
        yi: numbers,
        turns: turns_array,
        length: int,
        stride: int,
        columns: int,
        turn: int,
        thread: int,
    ):
        mine = spread(columns, thread)
        quarter = length // 4
        step = stride * quarter
        for item in range(mine[0], step, mine[1]):
            p = item // stride
            w1 = turns[p * turn]
            w2 = turns[2 * p * turn]
            w3 = turns[3 * p * turn]
            o = item + 3 * stride * p
            for c in range(mine[2], columns, mine[3]):
                ar = xr[item, c]
                ai = xi[item, c]
                br = xr[item + step, c]
                bi = xi[item + step, c]
                cr = xr[item + 2 * step, c]
                ci = xi[item + 2 * step, c]
                dr = xr[item + 3 * step, c]
                di = xi[item + 3 * step, c]
                er = ar + cr
                ei = ai + ci
                fr = ar - cr
                fi = ai - ci
                gr = br + dr
                gi = bi + di
                hr = br - dr
                hi = bi - di
                yr[o, c] = er + gr
                yi[o, c] = ei + gi
                ur = fr + hi
                ui = fi - hr
                yr[o + stride, c] = ur * w1[0] - ui * w1[1]
                yi[o + stride, c] = ur * w1[1] + ui * w1[0]
                ur = er - gr
                ui = ei - gi
                yr[o + 2 * stride, c] = ur * w2[0] - ui * w2[1]
                yi[o + 2 * stride, c] = ur * w2[1] + ui * w2[0]
                ur = fr - hi
                ui = fi + hr
                yr[o + 3 * stride, c] = ur * w3[0] - ui * w3[1]
                yi[o + 3 * stride, c] = ur * w3[1] + ui * w3[0]

    @wp.func
    def radix_2(xr: numbers, xi: numbers, yr: numbers, yi: numbers, stride: int, columns: int, thread: int):
        mine = spread(columns, thread)
        for item in range(mine[0], stride, mine[1]):
            for c in range(mine[2], columns, mine[3]):
                ar = xr[item, c]
                ai = xi[item, c]
                br = xr[item + stride, c]
                bi = xi[item + stride, c]
                yr[item, c] = ar + br
                yi[item, c] = ai + bi
                yr[item + stride, c] = ar - br
                yi[item + stride, c] = ai - bi

    return radix_4, radix_2
