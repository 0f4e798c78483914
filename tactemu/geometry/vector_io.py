"""Warp functions that read and write vectors 16 bytes at a time.

Warp aligns a vector like one of its numbers, so that a GPU would move each number separately.
"""

import functools

import warp as wp


@functools.cache
def vector_readers(real, width: int):
    """Return the Warp functions ``read(vectors, i)``, ``read_2(vectors, i, j)`` and ``read_4(vectors, i, j, k, l)``.

    They read arrays of vectors of ``width`` numbers; a vector's size must be a multiple of 16 bytes.
    """
    vector = wp.types.vector(width, real)

    def snippet(axes: str) -> str:
        copy = f"for (int m = 0; m < {width}; ++m) value[m] = found.numbers[m];"
        fetch = f"const Wide found = *here; wp::vec_t<{width}, wp::{real.__name__}> value; {copy} return value;"
        return _here(real, width, axes) + fetch

    @wp.func_native(snippet("i"))
    def read(vectors: wp.array(dtype=vector), i: int) -> vector: ...

    @wp.func_native(snippet("ij"))
    def read_2(vectors: wp.array2d(dtype=vector), i: int, j: int) -> vector: ...

    @wp.func_native(snippet("ijkl"))
    def read_4(vectors: wp.array4d(dtype=vector), i: int, j: int, k: int, l: int) -> vector: ...

    return read, read_2, read_4


@functools.cache
def vector_writer(real, width: int):
    """Return the Warp function ``write(vectors, i, j, k, l, value)``, which writes into an array of four axes."""
    vector = wp.types.vector(width, real)
    copy = f"for (int m = 0; m < {width}; ++m) given.numbers[m] = value[m];"

    @wp.func_native(_here(real, width, "ijkl") + f"Wide given; {copy} *here = given;")
    def write(vectors: wp.array4d(dtype=vector), i: int, j: int, k: int, l: int, value: vector): ...

    return write


def _here(real, width: int, axes: str) -> str:
    """Return C++ that declares ``here``, an aligned pointer to the vector at the indices named by ``axes``."""
    offset = " + ".join(f"int64_t(vectors.strides[{axis}]) * {name}" for axis, name in enumerate(axes))
    return f"""
        struct alignas(16) Wide {{ wp::{real.__name__} numbers[{width}]; }};
        Wide* const here = reinterpret_cast<Wide*>(reinterpret_cast<char*>(vectors.data) + {offset});
    """
