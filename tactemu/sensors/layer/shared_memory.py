"""The shared memory of a block: on a GPU, skins of up to 32 x 32 cells are solved without leaving the multiprocessor.

The complex field of the transforms (:mod:`.complex_transform`) and the vectors of the solvers lie in shared memory;
solvers use them like any arrays.

The memory of a layer that relaxes (:mod:`.recall`) still takes real transforms: spectra and scratch lie there, too. A
transform of 32 or 64 points is one of 4 or 8 and one of 8, each in the registers of a thread; its input is copied to
the scratch before it writes, so that a spectrum is transformed in place.
"""

# pyright: reportCallIssue=false, reportGeneralTypeIssues=false

import functools

import warp as wp

from tactemu.sensors.layer.block import Pass

MAX_CELLS = 32
"""Largest number of cells along a side of a skin that is solved in shared memory."""
_LONGEST = 2 * MAX_CELLS
_RESERVED_BYTES = 2048
"""Maximum size of shared memory for other purposes [bytes]."""
_SCRATCH = _LONGEST * MAX_CELLS
ROW = _LONGEST + 1
"""Row stride of a spectrum: odd, so that the numbers of a column are in different banks of the memory."""
WINDOW_ROW = MAX_CELLS + 1
"""Row stride of a window, odd for the same reason."""


def shared_numbers(spectra: int, windows: int) -> int:
    """Return the numbers of shared memory that a block needs for these spectra and windows."""
    return 2 * _SCRATCH + spectra * _LONGEST * ROW + windows * MAX_CELLS * WINDOW_ROW


def complex_numbers(windows: int) -> int:
    """Return the numbers of shared memory that a block needs for the complex field of :mod:`.complex_transform` and
    these windows."""
    return 2 * _LONGEST * ROW + windows * MAX_CELLS * WINDOW_ROW


def fits(cells: tuple[int, int], numbers: int, real, lanes: int, device: wp.Device) -> bool:
    """Return True if a skin is solved in shared memory by kernels that need at most ``numbers`` of it: 107 KiB with
    friction, which a GPU for data centres has, 73 KiB for a layer that relaxes, 61 KiB with neither."""
    if lanes > 1 or max(cells) > MAX_CELLS:
        return False
    room = device.max_shared_memory_per_block if device.is_cuda else 1 << 18
    return numbers * wp.types.type_size_in_bytes(real) + _RESERVED_BYTES <= room


@functools.cache
def _part_function(real, numbers: int):
    """Return ``part(memory, first, rows, columns)``, an array in a tile of so many ``numbers``, the same for every
    slot."""

    @wp.func_native(f"""
    wp::array_t<wp::{real.__name__}> found(memory.data.ptr + first, 0x7fffffff, rows, columns);
    found.strides[0] = 0;
    return found;
    """)
    def part(memory: wp.tile(dtype=real, shape=(numbers,)), first: int, rows: int, columns: int) -> wp.array3d(
        dtype=real
    ): ...

    return part


@functools.cache
def complex_memory(real, windows: int):
    """Return the functions ``(field, window)``: the complex field ``field(memory)``, a row of which holds pairs of real
    and imaginary part, and the ``k``-th window ``window(memory, k)`` in the tile ``memory``."""
    tile, part = wp.tile(dtype=real, shape=(complex_numbers(windows),)), _part_function(real, complex_numbers(windows))

    @wp.func
    def field(memory: tile):
        return part(memory, 0, wp.static(_LONGEST), wp.static(2 * ROW))

    @wp.func
    def window(memory: tile, k: int):
        first = wp.static(complex_numbers(0)) + k * wp.static(MAX_CELLS * WINDOW_ROW)
        return part(memory, first, wp.static(MAX_CELLS), wp.static(WINDOW_ROW))

    return field, window


@functools.cache
def address_functions(real):
    """Return the functions ``(place, address, address_of_turns)``: the start of an array in the block's memory, counted
    in numbers from there, so that a GPU uses 32-bit addresses, and the addresses of a table and of powers of the root
    in global memory."""
    field, table, turns = wp.array2d(dtype=real), wp.array(dtype=real), wp.array(dtype=wp.types.vector(2, real))

    @wp.func_native(_PLACE.replace("NUMBER", real.__name__))
    def place(a: field) -> wp.int64: ...

    @wp.func_native("return reinterpret_cast<uint64_t>(a.data);")
    def address(a: table) -> wp.uint64: ...

    @wp.func_native("return reinterpret_cast<uint64_t>(a.data);")
    def address_of_turns(a: turns) -> wp.uint64: ...

    return place, address, address_of_turns


@functools.cache
def shared_functions(real, workspace, spectra: int, windows: int):
    """Return the functions ``(shared_workspace, window)``: the workspace ``shared_workspace(ws, memory)`` and the
    ``k``-th window ``window(memory, k)`` in the tile ``memory``, the same for every slot, since each block has its
    own."""
    tile = wp.tile(dtype=real, shape=(shared_numbers(spectra, windows),))
    part = _part_function(real, shared_numbers(spectra, windows))

    @wp.func
    def window(memory: tile, k: int):
        first = wp.static(shared_numbers(spectra, 0)) + k * wp.static(MAX_CELLS * WINDOW_ROW)
        return part(memory, first, wp.static(MAX_CELLS), wp.static(WINDOW_ROW))

    @wp.func
    def spectrum(memory: tile, k: int):
        first = wp.static(2 * _SCRATCH) + k * wp.static(_LONGEST * ROW)
        return part(memory, first, wp.static(_LONGEST), wp.static(ROW))

    @wp.func
    def shared_workspace(ws: workspace, memory: tile):
        here = ws
        here.re = part(memory, 0, wp.static(_LONGEST), wp.static(MAX_CELLS))
        here.im = part(memory, wp.static(_SCRATCH), wp.static(_LONGEST), wp.static(MAX_CELLS))
        here.spectrum = spectrum(memory, 0)
        if wp.static(spectra > 1):
            here.second = spectrum(memory, 1)
        if wp.static(spectra > 2):
            here.third = spectrum(memory, 2)
        return here

    return shared_workspace, window


@wp.struct
class Places:
    """The arrays of a transform as a GPU addresses them fastest, see :data:`_PLACE`."""

    field: wp.int64
    from_row: wp.int32  # row stride of the field
    out: wp.int64
    to_row: wp.int32  # row stride of the result
    re: wp.int64  # scratch: real parts
    im: wp.int64
    turns: wp.uint64  # address of the powers of the root
    n_turns: wp.int32


@functools.cache
def shared_hartley(real):
    """Return ``hartley(re, im, twiddle, slot, field, given, out, thread)``, like the long one of :mod:`.convolution`,
    for lengths of 32 and 64, and columns that are a power of two, in the tile."""
    field_type, parts, turns = wp.array2d(dtype=real), wp.array3d(dtype=real), wp.array(dtype=wp.types.vector(2, real))

    place, _address, address = address_functions(real)

    @wp.func_native(_TRANSFORM.replace("NUMBER", real.__name__))
    def transform(places: Places, given: Pass, thread: int, threads: int): ...

    @wp.func(inline=False)  # not inlined: a solver calls it dozens of times
    def transform_here(places: Places, given: Pass, thread: int):
        transform(places, given, thread, wp.block_dim())

    @wp.func
    def hartley(
        re: parts, im: parts, twiddle: turns, slot: int, field: field_type, given: Pass, out: field_type, thread: int
    ):
        powers, n_powers = address(twiddle), twiddle.shape[0]
        zr, zi = place(re[slot]), place(im[slot])
        places = Places(place(field), field.shape[1], place(out), out.shape[1], zr, zi, powers, n_powers)
        transform_here(places, given, thread)

    return hartley


_PLACE = """
#if defined(__CUDA_ARCH__)
    extern __shared__ char dynamic_smem_base[];
    return a.data - reinterpret_cast<wp::NUMBER*>(dynamic_smem_base);
#else
    return reinterpret_cast<int64_t>(a.data);
#endif
"""
"""C++ of ``place``."""

_TRANSFORM = """
    using Number = wp::NUMBER;
#if defined(__CUDA_ARCH__)
    extern __shared__ char dynamic_smem_base[];
    Number* const memory = reinterpret_cast<Number*>(dynamic_smem_base);
    auto at = [&](const int64_t place) { return memory + static_cast<int>(place); };
#define WAIT __syncthreads()
#else
    auto at = [](const int64_t place) { return reinterpret_cast<Number*>(place); };
#define WAIT
#endif
    const int rows = given.rows, half = given.columns / 2, n = given.n, first = given.first, rows_out = given.rows_out;
    const int from_row = places.from_row, to_row = places.to_row;
    const Number* const in = at(places.field);
    Number* const result = at(places.out);
    Number* const zr = at(places.re);
    Number* const zi = at(places.im);
    const auto* const powers = reinterpret_cast<const wp::vec_t<2, Number>*>(places.turns);
    const int bits = half == 32 ? 5 : half == 16 ? 4 : 3, turn = places.n_turns / n;
    const Number root = Number(0.70710678118654752440);
    struct Short { enum { parts = 4, padded = 0 }; };
    struct Long { enum { parts = 8, padded = 0 }; };
    struct Padded { enum { parts = 8, padded = 1 }; };  // elements from 4 on are 0
    auto fft4 = [](Number* r, Number* m) {
        const Number ar = r[0] + r[2], ai = m[0] + m[2], br = r[0] - r[2], bi = m[0] - m[2];
        const Number cr = r[1] + r[3], ci = m[1] + m[3], dr = r[1] - r[3], di = m[1] - m[3];
        r[0] = ar + cr, m[0] = ai + ci, r[1] = br + di, m[1] = bi - dr;
        r[2] = ar - cr, m[2] = ai - ci, r[3] = br - di, m[3] = bi + dr;
    };
    auto fft8 = [&](Number* r, Number* m, const bool padded) {
        Number er[4], ei[4], tr[4], ti[4];
        for (int i = 0; i < 4; ++i) {
            er[i] = padded ? r[i] : r[i] + r[i + 4], ei[i] = padded ? m[i] : m[i] + m[i + 4];
            tr[i] = padded ? r[i] : r[i] - r[i + 4], ti[i] = padded ? m[i] : m[i] - m[i + 4];
        }
        const Number ur = root * (tr[1] + ti[1]), ui = root * (ti[1] - tr[1]);
        const Number vr = root * (ti[3] - tr[3]), vi = -root * (ti[3] + tr[3]), wr = ti[2], wi = -tr[2];
        tr[1] = ur, ti[1] = ui, tr[2] = wr, ti[2] = wi, tr[3] = vr, ti[3] = vi;
        fft4(er, ei);
        fft4(tr, ti);
        for (int i = 0; i < 4; ++i)
            r[2 * i] = er[i], m[2 * i] = ei[i], r[2 * i + 1] = tr[i], m[2 * i + 1] = ti[i];
    };
    auto begin = [&](auto kind) {  // over every eighth point
        constexpr int parts = decltype(kind)::parts, given = decltype(kind)::padded ? 4 : parts;
#pragma unroll 1
        for (int item = thread; item < 8 * half; item += threads) {
            const int c = item & (half - 1), j = item >> bits;
            Number r[8], m[8];
            for (int i = 0; i < given; ++i) {
                const bool there = 8 * i + j < rows;
                const Number* const x = in + (8 * i + j) * from_row + c;
                r[i] = there ? x[0] : Number(0), m[i] = there ? x[half] : Number(0);
            }
            if (parts == 8)
                fft8(r, m, given == 4);
            else
                fft4(r, m);
            for (int i = 0; i < parts; ++i) {
                const wp::vec_t<2, Number> w = powers[turn * j * i];
                zr[(8 * i + j) * half + c] = r[i] * w[0] - m[i] * w[1];
                zi[(8 * i + j) * half + c] = r[i] * w[1] + m[i] * w[0];
            }
        }
    };
    auto end = [&](auto kind) {  // over the eight that are left, of a row and its mirror; then Hartley, transposed
        constexpr int parts = decltype(kind)::parts;
#pragma unroll 1
        for (int item = thread; item < parts / 2 * half; item += threads) {
            const int c = item & (half - 1), a = item >> bits, b = a ? parts - a : parts / 2;
            Number xr[8], xi[8], yr[8], yi[8];
            for (int i = 0; i < 8; ++i) {
                xr[i] = zr[(8 * a + i) * half + c], xi[i] = zi[(8 * a + i) * half + c];
                yr[i] = zr[(8 * b + i) * half + c], yi[i] = zi[(8 * b + i) * half + c];
            }
            fft8(xr, xi, false);
            fft8(yr, yi, false);
            Number* const one = result + c * to_row;
            Number* const other = one + half * to_row;
            auto put = [&](const int k, const Number pr, const Number pi, const Number qr, const Number qi) {
                const int row = (k - first) & (8 * parts - 1);
                if (row < rows_out)
                    one[row] = pr + qr - (pi - qi), other[row] = pi + qi + (pr - qr);
            };
            for (int i = 0; i < 8; ++i) {
                put(a + parts * i, xr[i], xi[i], a ? yr[7 - i] : xr[(8 - i) & 7], a ? yi[7 - i] : xi[(8 - i) & 7]);
                put(b + parts * i, yr[i], yi[i], a ? xr[7 - i] : yr[7 - i], a ? xi[7 - i] : yi[7 - i]);
            }
        }
    };
    if (n == 32)
        begin(Short());
    else if (rows <= 32)
        begin(Padded());
    else
        begin(Long());
    WAIT;
    if (n == 32)
        end(Short());
    else
        end(Long());
    WAIT;
#undef WAIT
"""
