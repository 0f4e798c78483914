"""Access to the cells of a solver's windows on a CPU, eight at a time in vector registers; :mod:`.pressure_simd` and
:mod:`.friction_simd` use it."""

from tactemu.geometry.simd import vector_prelude


def over_cells(real, like: str, snippet: str) -> str:
    """Return a C++ snippet that processes the cells of the windows ``win`` of a ``slot``, of ``shape``.

    ``snippet`` may use ``all(visit)``, which calls ``visit(at)`` for each eight cells; it sums up ``doubles(vector)``,
    and ``sum`` reduces that to one number.

    ``like`` is one of the windows; the others have the same strides, which are multiples of a register.
    """
    return vector_prelude(real) + _CELLS.replace("LIKE", like) + snippet


_CELLS = """
    typedef double Doubles __attribute__((vector_size(wide * sizeof(double))));
    const int64_t row = win.LIKE.strides[1] / sizeof(Number);
    const int64_t window = at.slot * (win.LIKE.strides[0] / sizeof(Number));
    auto all = [&](auto visit) {
        for (int y = 0; y < at.shape[0]; ++y)
            for (int x = 0; x < at.shape[1]; x += wide)
                visit(window + y * row + x);
    };
    auto doubles = [](const Vector& v) { return __builtin_convertvector(v, Doubles); };
    auto sum = [](const Doubles& v) {
        double total = 0;
        for (int l = 0; l < wide; ++l)
            total += v[l];
        return total;
    };
"""
