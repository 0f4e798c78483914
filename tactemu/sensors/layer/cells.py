"""Access to the cells of a solver's windows, for the C++ that :mod:`.pressure_cells` and :mod:`.friction_cells` share
between all devices: eight cells at a time in the vector registers of a CPU, one on a GPU."""

from tactemu.geometry.simd import vector_prelude
from tactemu.sensors.layer.shared_memory import WINDOW_ROW


def over_cells(real, lanes: int, is_shared: bool, like: str, snippet: str) -> str:
    """Return a C++ snippet that processes the calling thread's cells of the window ``at`` of ``win``.

    ``snippet`` may use ``all(visit)``, which calls ``visit(cell)`` for each ``Vector`` of cells, ``load(win.x, cell)``
    and ``store(win.x, cell, vector)``, ``root(vector)``, and ``fused(a, b, c)``: ``a * b + c`` as one alternative of a
    choice, which a GPU's compiler would not fuse by itself. It adds up ``doubles(vector)`` in ``Doubles``, and ``sum``
    reduces those to one number: the thread's part.

    With more than one of ``lanes``, the windows have the strides of the window ``like``, multiples of a register. If
    ``is_shared``, they are all in the block's shared memory (:mod:`.shared_memory`).
    """
    if lanes > 1:
        return vector_prelude(real) + _EIGHT.replace("LIKE", like) + snippet
    access = _SHARED.replace("ROW", str(WINDOW_ROW)) if is_shared else _GLOBAL
    return (_ONE + access + _NUMBERS).replace("NUMBER", real.__name__) + snippet


_EIGHT = """
    typedef double Doubles __attribute__((vector_size(wide * sizeof(double))));
    const int64_t row = win.LIKE.strides[1] / sizeof(Number);
    const int64_t window = at.slot * (win.LIKE.strides[0] / sizeof(Number));
    auto all = [&](auto visit) {
        for (int y = 0; y < at.shape[0]; ++y)
            for (int x = 0; x < at.shape[1]; x += wide)
                visit(window + y * row + x);
    };
    auto load = [&](const auto& a, const int64_t cell) { return get(a.data + cell); };
    auto store = [&](const auto& a, const int64_t cell, const Vector& v) { put(a.data + cell, v); };
    auto fused = [](const auto& a, const Vector& b, const Vector& c) { return a * b + c; };
    auto root = [](const Vector& v) { return __builtin_elementwise_sqrt(v); };
    auto doubles = [](const Vector& v) { return __builtin_convertvector(v, Doubles); };
    auto sum = [](const Doubles& v) {
        double total = 0;
        for (int l = 0; l < wide; ++l)
            total += v[l];
        return total;
    };
"""
_ONE = """
    using Number = wp::NUMBER;
    using Vector = Number;
    using Doubles = double;
    struct Cell { int y, x; };
    auto all = [&](auto visit) {
        for (int y = at.mine[0]; y < at.shape[0]; y += at.mine[1])
            for (int x = at.mine[2]; x < at.shape[1]; x += at.mine[3])
                visit(Cell{y, x});
    };
"""
_GLOBAL = """
    auto place = [&](const auto& a, const Cell& cell) {
        const int64_t row = int64_t(a.strides[0]) * at.slot + int64_t(a.strides[1]) * cell.y;
        return reinterpret_cast<Number*>(reinterpret_cast<char*>(a.data) + row) + cell.x;
    };
"""
_SHARED = """
#if defined(__CUDA_ARCH__)
    extern __shared__ char dynamic_smem_base[];
    Number* const memory = reinterpret_cast<Number*>(dynamic_smem_base);
    auto place = [&](const auto& a, const Cell& cell) {  // with 32-bit addresses
        return memory + (static_cast<int>(a.data - memory) + cell.y * ROW + cell.x);
    };
#else
    auto place = [&](const auto& a, const Cell& cell) { return a.data + cell.y * ROW + cell.x; };
#endif
"""
_NUMBERS = """
    auto load = [&](const auto& a, const Cell& cell) { return *place(a, cell); };
    auto store = [&](const auto& a, const Cell& cell, const Vector v) { *place(a, cell) = v; };
#if defined(__CUDA_ARCH__)
    auto fused = [](const Vector a, const Vector b, const Vector c) -> Vector { return fma(a, b, c); };
#else
    auto fused = [](const Vector a, const Vector b, const Vector c) -> Vector { return a * b + c; };
#endif
    auto root = [](const Vector v) { return wp::sqrt(v); };
    auto doubles = [](const Vector v) { return double(v); };
    auto sum = [](const double v) { return v; };
"""
