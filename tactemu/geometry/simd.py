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
    typedef decltype(Vector{} < Vector{}) Mask;
"""

ROTATION = """
    struct Vectors { Vector x, y, z; };
    // Operation by operation as wp::quat_rotate and, with ``sign`` -1, wp::quat_rotate_inv
    auto rotate = [](const auto& q, const Vectors& v, const auto sign) -> Vectors {
        const Number c = Number(2) * q.w * q.w - Number(1);
        const Vector d = Number(2) * (q.x * v.x + q.y * v.y + q.z * v.z);
        const Vector x = (q.y * v.z - q.z * v.y) * q.w * Number(2);
        const Vector y = (q.z * v.x - q.x * v.z) * q.w * Number(2);
        const Vector z = (q.x * v.y - q.y * v.x) * q.w * Number(2);
        const Vector along_x = v.x * c + q.x * d, along_y = v.y * c + q.y * d, along_z = v.z * c + q.z * d;
        if (sign > 0)
            return {along_x + x, along_y + y, along_z + z};
        return {along_x - x, along_y - y, along_z - z};
    };
"""
"""Lines of a snippet that define ``Vectors``, ``wide`` vectors in space, and ``rotate(quaternion, vectors, sign)``."""


def vector_prelude(real) -> str:
    """Return the first lines of a SIMD snippet for the number type ``real``.

    They define ``Number``, ``Vector`` of ``wide`` numbers, ``get(pointer)``, ``put(pointer, vector)``, and ``Mask``,
    the type of a comparison.
    """
    return _VECTORS.replace("NUMBER", real.__name__)


def padded_length(n: int) -> int:
    """Return the length of an array of ``n`` numbers, rounded up to a multiple of :data:`WIDTH`."""
    return -(-n // WIDTH) * WIDTH
