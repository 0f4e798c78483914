"""Convolution of a window of cells with a layer's kernels, by real Hartley transforms, inside a Warp kernel.

One block of threads (a GPU) or one thread (a CPU) does a whole convolution, so that a solver can run to convergence
within one launch. The kernels of a layer are even or odd along each axis; such a convolution is a product in the
space of the *Hartley* transform ``H(k) = sum f(x) (cos kx + sin kx)``, which is real and its own inverse::

    even kernel g:  H[g * f](k) = g_cos(k) H[f](k)          odd kernel:  H[g * f](k) = g_sin(k) H[f](-k)

Two real columns make one complex column of a Stockham FFT of radix 4. Columns lie side by side in *lanes* (vectors of
``lanes`` numbers): on a CPU they fill the SIMD registers, on a GPU ``lanes`` is 1 and the columns go to threads.
Every pass transforms along the rows and writes its result transposed; two passes there and two back are a convolution.
"""

import functools
from typing import Any, NamedTuple

import numpy as np
import warp as wp

CPU_LANES = 8
SMALLEST_TRANSFORM = 32
"""Length of the shortest transform used; a window has at most half its length."""


def lanes_of(device: wp.Device) -> int:
    """Numbers per lane on a device."""
    return 1 if device.is_cuda else CPU_LANES


@functools.cache
def lane_type(real, lanes: int):
    """The Warp type of ``lanes`` numbers side by side."""
    return real if lanes == 1 else wp.types.vector(lanes, real)


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __syncthreads();
#endif
""")
def block_sync():
    """Wait for the other threads of the block, and see what they wrote."""
    ...


@functools.cache
def workspace_type(real, lanes: int):
    """Scratch of the convolutions, one slot per block."""
    lane = lane_type(real, lanes)

    @wp.struct
    class Workspace:
        # Ping-pong buffers of the FFT: (n_slots, n_max, n_max / 2 / lanes), real and imaginary part.
        ar: wp.array3d(dtype=lane)
        ai: wp.array3d(dtype=lane)
        br: wp.array3d(dtype=lane)
        bi: wp.array3d(dtype=lane)
        # Transposed intermediate and spectrum: (n_slots, n_max, n_max), the same memory as numbers and as lanes.
        between: wp.array3d(dtype=real)
        between_lanes: wp.array3d(dtype=lane)
        spectrum: wp.array3d(dtype=real)
        spectrum_lanes: wp.array3d(dtype=lane)
        # exp(-2 pi i j / n_max), j < n_max.
        twiddle: wp.array(dtype=wp.types.vector(2, real))

    return Workspace


class Pair(NamedTuple):
    """One piece of memory seen as numbers, ``(n, rows, columns)``, and as lanes, ``(n, rows, columns / lanes)``."""

    numbers: wp.array
    lanes: wp.array


def allocate_pair(n: int, rows: int, columns: int, real, lanes: int, device) -> Pair:
    """Zeros. Rows are one lane longer than asked for, lest strides that are powers of two crowd one cache set."""
    padded = -(-columns // lanes) * lanes + (lanes if lanes > 1 else 0)
    numbers = wp.zeros((n, rows, padded), dtype=real, device=device)
    if lanes == 1:
        return Pair(numbers, numbers)
    shape = (n, rows, padded // lanes)
    return Pair(numbers, wp.array(ptr=numbers.ptr, shape=shape, dtype=lane_type(real, lanes), device=device))


class Workspace:
    """Allocates the scratch for transforms of up to ``n_max`` and keeps it alive."""

    def __init__(self, n_slots: int, n_max: int, real, lanes: int, device):
        self._pairs = [allocate_pair(n_slots, n_max, n_max // 2, real, lanes, device) for _ in range(4)]
        self._pairs += [allocate_pair(n_slots, n_max, n_max, real, lanes, device) for _ in range(2)]
        self.struct = struct = workspace_type(real, lanes)()
        struct.ar, struct.ai, struct.br, struct.bi = (pair.lanes for pair in self._pairs[:4])
        struct.between, struct.between_lanes = self._pairs[4]
        struct.spectrum, struct.spectrum_lanes = self._pairs[5]
        turns = np.exp(-2j * np.pi * np.arange(n_max) / n_max)
        pairs = np.stack([turns.real, turns.imag], axis=1)
        struct.twiddle = wp.array(pairs, dtype=wp.types.vector(2, real), device=device)

    @property
    def nbytes(self) -> int:
        """Memory held [B]."""
        return sum(pair.numbers.size * wp.types.type_size_in_bytes(pair.numbers.dtype) for pair in self._pairs)


class ConvolutionFunctions(NamedTuple):
    """Warp functions that all threads of a block call together."""

    forward: Any
    """``forward(ws, slot, field, rows, columns, n_rows, n_columns, thread)``: the spectrum of the window
    ``(rows, columns)`` of ``field`` (lanes) into ``ws.spectrum``, ``(n_rows, n_columns)``."""
    scale: Any
    """``scale(ws, slot, table, start, n_rows, n_columns, thread)``: multiplies the spectrum by an even kernel's."""
    inverse: Any
    """``inverse(ws, slot, first_row, rows, first_column, columns, n_rows, n_columns, out, thread)``: the window of the
    inverse transform that starts at ``(first_row, first_column)``, which may be negative, into ``out``."""


@functools.cache
def convolution_functions(real, lanes: int) -> ConvolutionFunctions:
    """The convolution for one float type and lane width. ``rows`` of an inverse and ``columns`` of a forward transform
    must be multiples of ``2 * lanes``."""
    lane = lane_type(real, lanes)
    workspace = workspace_type(real, lanes)
    lanes_array = wp.array2d(dtype=lane)
    numbers_array = wp.array2d(dtype=real)
    turns_array = wp.array(dtype=wp.types.vector(2, real))
    radix_4, radix_2 = _fft_stages(lane, lanes_array, turns_array)

    if lanes == 1:

        @wp.func
        def store(out: numbers_array, row: int, column: int, value: lane):
            out[row, column] = value
    else:

        @wp.func
        def store(out: numbers_array, row: int, column: int, value: lane):
            for l in range(wp.static(lanes)):
                out[row * wp.static(lanes) + l, column] = value[l]

    @wp.func
    def unpack(
        zr: lanes_array, zi: lanes_array, n: int, half: int, first: int, rows_out: int, out: numbers_array, thread: int
    ):
        """Hartley coefficients of the two columns in each complex one; ``out[column, k - first]``."""
        across = wp.min(half, wp.block_dim())
        c0 = thread % across
        for k in range(thread // across, n // 2 + 1, wp.block_dim() // across):
            mirror = (n - k) % n
            at = (k - first + n) % n
            at_mirror = (mirror - first + n) % n
            for c in range(c0, half, across):
                xr = zr[k, c]
                xi = zi[k, c]
                yr = zr[mirror, c]
                yi = zi[mirror, c]
                if at < rows_out:
                    store(out, c, at, xr + yr - xi + yi)
                    store(out, c + half, at, xi + yi + xr - yr)
                if mirror != k and at_mirror < rows_out:
                    store(out, c, at_mirror, xr + yr + xi - yi)
                    store(out, c + half, at_mirror, xi + yi - xr + yr)

    @wp.func
    def hartley(
        ws: workspace,
        slot: int,
        field: lanes_array,
        rows: int,
        columns: int,
        n: int,
        first: int,
        rows_out: int,
        out: numbers_array,
        thread: int,
    ):
        """Twice the transform of length ``n`` along the rows of ``field``; ``out`` is ``(columns, rows_out)``."""
        half = columns // wp.static(2 * lanes)
        across = wp.min(half, wp.block_dim())
        c0 = thread % across
        n_max = ws.twiddle.shape[0]
        ar = ws.ar[slot]
        ai = ws.ai[slot]
        br = ws.br[slot]
        bi = ws.bi[slot]
        for k in range(thread // across, n, wp.block_dim() // across):
            for c in range(c0, half, across):
                if k < rows:
                    ar[k, c] = field[k, c]
                    ai[k, c] = field[k, c + half]
                else:
                    ar[k, c] = lane(real(0.0))
                    ai[k, c] = lane(real(0.0))
        block_sync()
        length = int(n)
        stride = int(1)
        while length >= 8:  # two stages: there and back
            radix_4(ar, ai, br, bi, ws.twiddle, length, stride, half, n_max // length, thread)
            block_sync()
            length = length // 4
            stride = stride * 4
            if length >= 4:
                radix_4(br, bi, ar, ai, ws.twiddle, length, stride, half, n_max // length, thread)
                length = length // 4
                stride = stride * 4
            else:
                radix_2(br, bi, ar, ai, stride, half, thread)
                length = length // 2
            block_sync()
        if length == 4:
            radix_4(ar, ai, br, bi, ws.twiddle, length, stride, half, n_max // length, thread)
            block_sync()
            unpack(br, bi, n, half, first, rows_out, out, thread)
        elif length == 2:
            radix_2(ar, ai, br, bi, stride, half, thread)
            block_sync()
            unpack(br, bi, n, half, first, rows_out, out, thread)
        else:
            unpack(ar, ai, n, half, first, rows_out, out, thread)
        block_sync()

    @wp.func
    def forward(
        ws: workspace,
        slot: int,
        field: lanes_array,
        rows: int,
        columns: int,
        n_rows: int,
        n_columns: int,
        thread: int,
    ):
        hartley(ws, slot, field, rows, columns, n_rows, 0, n_rows, ws.between[slot], thread)
        hartley(ws, slot, ws.between_lanes[slot], columns, n_rows, n_columns, 0, n_columns, ws.spectrum[slot], thread)

    @wp.func
    def scale(
        ws: workspace, slot: int, table: wp.array(dtype=lane), start: int, n_rows: int, n_columns: int, thread: int
    ):
        spectrum = ws.spectrum_lanes[slot]
        across = n_columns // wp.static(lanes)
        begin = start // wp.static(lanes)
        for item in range(thread, n_rows * across, wp.block_dim()):
            k = item // across
            c = item - k * across
            spectrum[k, c] = wp.cw_mul(spectrum[k, c], table[begin + item])
        block_sync()

    @wp.func
    def scale_number(
        ws: workspace, slot: int, table: wp.array(dtype=lane), start: int, n_rows: int, n_columns: int, thread: int
    ):
        spectrum = ws.spectrum[slot]
        for item in range(thread, n_rows * n_columns, wp.block_dim()):
            k = item // n_columns
            c = item - k * n_columns
            spectrum[k, c] = spectrum[k, c] * table[start + item]
        block_sync()

    @wp.func
    def inverse(
        ws: workspace,
        slot: int,
        first_row: int,
        rows: int,
        first_column: int,
        columns: int,
        n_rows: int,
        n_columns: int,
        out: numbers_array,
        thread: int,
    ):
        hartley(ws, slot, ws.spectrum_lanes[slot], n_rows, n_columns, n_rows, first_row, rows, ws.between[slot], thread)
        between = ws.between_lanes[slot]
        hartley(ws, slot, between, n_columns, rows, n_columns, first_column, columns, out, thread)

    return ConvolutionFunctions(forward, scale_number if lanes == 1 else scale, inverse)


def _fft_stages(lane, lanes_array, turns_array):
    """Stockham stages ``(x) -> (y)``: ``length`` is left to transform, ``stride`` columns of butterflies are done."""

    @wp.func
    def radix_4(
        xr: lanes_array,
        xi: lanes_array,
        yr: lanes_array,
        yi: lanes_array,
        turns: turns_array,
        length: int,
        stride: int,
        columns: int,
        turn: int,
        thread: int,
    ):
        across = wp.min(columns, wp.block_dim())
        c0 = thread % across
        quarter = length // 4
        step = stride * quarter
        for item in range(thread // across, step, wp.block_dim() // across):
            p = item // stride
            w1 = turns[p * turn]
            w2 = turns[2 * p * turn]
            w3 = turns[3 * p * turn]
            o = item + 3 * stride * p
            for c in range(c0, columns, across):
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
    def radix_2(
        xr: lanes_array, xi: lanes_array, yr: lanes_array, yi: lanes_array, stride: int, columns: int, thread: int
    ):
        across = wp.min(columns, wp.block_dim())
        c0 = thread % across
        for item in range(thread // across, stride, wp.block_dim() // across):
            for c in range(c0, columns, across):
                ar = xr[item, c]
                ai = xi[item, c]
                br = xr[item + stride, c]
                bi = xi[item + stride, c]
                yr[item, c] = ar + br
                yi[item, c] = ai + bi
                yr[item + stride, c] = ar - br
                yi[item + stride, c] = ai - bi

    return radix_4, radix_2
