"""Convolutions of a window of cells with a layer's kernels, by real Hartley transforms, inside a Warp kernel.

One block of threads (a GPU) or one thread (a CPU) computes a complete convolution, so that a solver can run to
convergence within one launch. The kernels of a layer are even or odd along each axis; such a convolution is a product
in the space of the *Hartley* transform ``H(k) = sum f(x) (cos kx + sin kx)``, which is real and its own inverse::

    even kernel g:  H[g * f](k) = g_cos(k) H[f](k)          odd kernel:  H[g * f](k) = g_sin(k) H[f](-k)

Two real columns form one complex column of a Stockham FFT of radix 4. Columns lie next to each other in *lanes*: on a
CPU they fill the vector registers (:mod:`.simd`), on a GPU ``lanes`` is 1 and each thread takes columns. Every pass
transforms along the rows and writes its result transposed; a convolution takes two passes forward and two back.
"""

# pyright: reportIndexIssue=false, reportCallIssue=false, reportGeneralTypeIssues=false

import functools
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from tactemu.geometry.simd import WIDTH
from tactemu.sensors.layer.block import Pass, Window, block_sync, spread
from tactemu.sensors.layer.shared_memory import shared_hartley
from tactemu.sensors.layer.simd import SCRATCH, simd_hartley, simd_scale


def lane_width(device: wp.Device) -> int:
    """Return the number of lanes on a device."""
    return 1 if device.is_cuda else WIDTH


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
    """Return zeros of shape ``(n, rows, columns or more)``. On a CPU rows fill two lanes, so that each begins where a
    cache line does, and are two lanes longer, so that strides that are powers of two do not crowd one cache set."""
    padded = columns if lanes == 1 else (-(-columns // (2 * lanes)) + 1) * 2 * lanes
    return wp.zeros((n, rows, padded), dtype=real, device=device)


class Workspace:
    """The scratch for transforms of up to ``n_max``: it allocates the arrays and keeps them alive.

    ``spectra`` is the number of separate spectra needed; the others are aliases of the last of them.
    """

    def __init__(self, n_slots: int, n_max: int, real, lanes: int, device, *, spectra: int = 1):
        self.real, self.lanes, self.device = real, lanes, device
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
    """The Warp functions that all threads of a block call together; ``at`` is the :class:`~.block.Window`."""

    forward: Any
    """``forward(ws, at, field, spectrum)`` computes the spectrum of a window of ``field``."""
    scale: Any
    """``scale(at, spectrum, table)`` multiplies a spectrum by an even kernel's."""
    inverse: Any
    """``inverse(ws, at, spectrum, out)`` writes the window of the inverse transform that starts at ``at.first`` into
    ``out``. It overwrites the spectrum."""
    convolve: Any
    """``convolve(ws, at, field, table, out)`` does all three; ``out`` has the window's shape."""


@functools.cache
def convolution_functions(real, lanes: int, is_shared: bool) -> ConvolutionFunctions:
    """Return the convolution for one float type and lane width. ``rows`` of an inverse and ``columns`` of a forward
    transform must be multiples of ``2 * lanes``. ``is_shared``: the workspace is in shared memory
    (:mod:`.shared_memory`)."""
    workspace = workspace_type(real)
    numbers = wp.array2d(dtype=real)
    parts, turns = wp.array3d(dtype=real), wp.array(dtype=wp.types.vector(2, real))
    radix_4, radix_2 = _fft_stages(numbers, turns)

    @wp.func
    def unpack(zr: numbers, zi: numbers, given: Pass, out: numbers, thread: int):
        """Write the Hartley coefficients of the two columns in each complex one to ``out[column, k - first]``."""
        n = given.n
        half = given.columns // 2
        mine = spread(half, thread)
        for k in range(mine[0], n // 2 + 1, mine[1]):
            mirror = -k & (n - 1)
            at = k - given.first & (n - 1)
            at_mirror = mirror - given.first & (n - 1)
            for c in range(mine[2], half, mine[3]):
                xr = zr[k, c]
                xi = zi[k, c]
                yr = zr[mirror, c]
                yi = zi[mirror, c]
                if at < given.rows_out:
                    out[c, at] = xr + yr - xi + yi
                    out[c + half, at] = xi + yi + xr - yr
                if mirror != k and at_mirror < given.rows_out:
                    out[c, at_mirror] = xr + yr + xi - yi
                    out[c + half, at_mirror] = xi + yi - xr + yr

    @wp.func(inline=False)  # not inlined: a solver calls it dozens of times
    def long_hartley(
        all_re: parts, all_im: parts, twiddle: turns, slot: int, field: numbers, given: Pass, out: numbers, thread: int
    ):
        """Write twice the transform along the rows of ``field`` to ``out``, which may be the same memory."""
        n = given.n
        half = given.columns // 2
        mine = spread(half, thread)
        n_max = twiddle.shape[0]
        re = all_re[2 * slot]
        im = all_im[2 * slot]
        for k in range(mine[0], n, mine[1]):
            for c in range(mine[2], half, mine[3]):
                if k < given.rows:
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
            x_re, x_im, y_re, y_im = all_re[here], all_im[here], all_re[there], all_im[there]
            radix_4(x_re, x_im, y_re, y_im, twiddle, length, stride, half, turn, thread)
            block_sync()
            here = there
            length = length // 4
            stride = stride * 4
        if length == 2:
            there = 4 * slot + 1 - here
            radix_2(all_re[here], all_im[here], all_re[there], all_im[there], stride, half, thread)
            block_sync()
            here = there
        unpack(all_re[here], all_im[here], given, out, thread)
        block_sync()

    in_turn = shared_hartley(real) if is_shared else long_hartley
    simd, scale_simd = simd_hartley(real), simd_scale(real)

    @wp.func
    def hartley(ws: workspace, at: Window, field: numbers, given: Pass, out: numbers):
        if wp.static(lanes > 1):
            simd(ws.im[at.slot], ws.twiddle, field, given, out)
        else:
            in_turn(ws.re, ws.im, ws.twiddle, at.slot, field, given, out, at.thread)

    @wp.func
    def between(ws: workspace, slot: int, spectrum: numbers):
        """Return the array into which the first of two passes writes its result."""
        if wp.static(lanes > 1):
            return ws.re[slot]
        else:
            return spectrum

    @wp.func
    def forward(ws: workspace, at: Window, field: numbers, spectrum: numbers):
        middle = between(ws, at.slot, spectrum)
        hartley(ws, at, field, Pass(at.shape[0], at.shape[1], at.size[0], 0, at.size[0]), middle)
        hartley(ws, at, middle, Pass(at.shape[1], at.size[0], at.size[1], 0, at.size[1]), spectrum)

    @wp.func
    def scale(at: Window, spectrum: numbers, table: wp.array(dtype=real)):
        if wp.static(lanes > 1):
            scale_simd(spectrum, table, at.start, at.size[0], at.size[1])
        else:
            mine = spread(at.size[1], at.thread)
            for k in range(mine[0], at.size[0], mine[1]):
                for c in range(mine[2], at.size[1], mine[3]):
                    spectrum[k, c] = spectrum[k, c] * table[at.start + k * at.size[1] + c]
            block_sync()

    @wp.func
    def inverse(ws: workspace, at: Window, spectrum: numbers, out: numbers):
        middle = between(ws, at.slot, spectrum)
        hartley(ws, at, spectrum, Pass(at.size[0], at.size[1], at.size[0], at.first[0], at.shape[0]), middle)
        hartley(ws, at, middle, Pass(at.size[1], at.shape[0], at.size[1], at.first[1], at.shape[1]), out)

    @wp.func
    def convolve(ws: workspace, at: Window, field: numbers, table: wp.array(dtype=real), out: numbers):
        spectrum = ws.spectrum[at.slot]
        forward(ws, at, field, spectrum)
        scale(at, spectrum, table)
        inverse(ws, at, spectrum, out)

    return ConvolutionFunctions(forward, scale, inverse, convolve)


def _fft_stages(numbers, turns_type):
    """Return the Stockham stages ``(x) -> (y)``: a length of ``length`` remains to be transformed, ``stride`` columns
    of butterflies are done."""

    @wp.func
    def radix_4(
        xr: numbers,
        xi: numbers,
        yr: numbers,
        yi: numbers,
        turns: turns_type,
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
