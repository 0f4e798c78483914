"""SIMD vectors of a CPU, for snippets of C++.

Warp's own vectors of eight leave much of a CPU idle: products and sums are not fused, and the compiler turns longer
formulas into code that is half scalar. The compiler's vector types, which Clang and GCC share, avoid both on every CPU.
"""

WIDTH = 8
"""Numbers in one SIMD vector."""

_VECTORS = """
    using Number = wp::NUMBER;
    constexpr int wide = 8;
    typedef Number Vector __attribute__((vector_size(wide * sizeof(Number))));
    typedef Number Unaligned __attribute__((vector_size(wide * sizeof(Number)), aligned(alignof(Number))));
    auto get = [](const Number* p) -> Vector { return *reinterpret_cast<const Unaligned*>(p); };
    auto put = [](Number* p, const Vector& v) { *reinterpret_cast<Unaligned*>(p) = v; };
"""


def vector_prelude(real) -> str:
    """Return the first lines of a SIMD snippet for the number type ``real``.

    They define ``Number``, ``Vector`` of ``wide`` numbers, ``get(pointer)`` and ``put(pointer, vector)``.
    """
    return _VECTORS.replace("NUMBER", real.__name__)


def padded_length(n: int) -> int:
    """Return the length of an array of ``n`` numbers, rounded up to a multiple of :data:`WIDTH`."""
    return -(-n // WIDTH) * WIDTH
