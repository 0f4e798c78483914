"""Numbers side by side in the vector registers of a CPU, for snippets of C++.

Warp's own vectors of eight leave much of a CPU idle: products and sums are not fused, and what the compiler makes of
longer formulas is half scalar. Its vector types, which Clang and GCC share, are free of that, on every CPU.
"""

WIDTH = 8
"""Numbers side by side."""

_VECTORS = """
    using Number = wp::NUMBER;
    constexpr int wide = 8;
    typedef Number Vector __attribute__((vector_size(wide * sizeof(Number))));
    typedef Number Unaligned __attribute__((vector_size(wide * sizeof(Number)), aligned(alignof(Number))));
    auto get = [](const Number* p) -> Vector { return *reinterpret_cast<const Unaligned*>(p); };
    auto put = [](Number* p, const Vector& v) { *reinterpret_cast<Unaligned*>(p) = v; };
"""


def vector_prelude(real) -> str:
    """What such a snippet begins with: ``Number``, ``Vector`` of ``wide`` of them, ``get(pointer)``, ``put(pointer,
    vector)``."""
    return _VECTORS.replace("NUMBER", real.__name__)


def padded_length(n: int) -> int:
    """``n`` numbers in whole registers."""
    return -(-n // WIDTH) * WIDTH
