"""Vectors read and written 16 bytes at a time.

Warp's vectors are aligned like one of their numbers, so that a GPU would move each number alone.
"""

# pyright: reportInvalidTypeForm=false, reportReturnType=false, reportArgumentType=false

import functools

import warp as wp


@functools.cache
def vector_readers(real, width: int):
    """``(load, load_2, load_4)``: ``load(vectors, i)``, ``load_2(vectors, i, j)``, ``load_4(vectors, i, j, k, l)``, of
    arrays of vectors of ``width`` numbers, a whole number of times 16 bytes."""
    vector = wp.types.vector(width, real)

    def snippet(axes: str) -> str:
        copy = f"for (int m = 0; m < {width}; ++m) value[m] = found.numbers[m];"
        fetch = f"const Wide found = *here; wp::vec_t<{width}, wp::{real.__name__}> value; {copy} return value;"
        return _here(real, width, axes) + fetch

    @wp.func_native(snippet("i"))
    def load(vectors: wp.array(dtype=vector), i: int) -> vector: ...

    @wp.func_native(snippet("ij"))
    def load_2(vectors: wp.array2d(dtype=vector), i: int, j: int) -> vector: ...

    @wp.func_native(snippet("ijkl"))
    def load_4(vectors: wp.array4d(dtype=vector), i: int, j: int, k: int, l: int) -> vector: ...

    return load, load_2, load_4


@functools.cache
def vector_writer(real, width: int):
    """``store(vectors, i, j, k, l, value)``: into an array of four axes."""
    vector = wp.types.vector(width, real)
    copy = f"for (int m = 0; m < {width}; ++m) given.numbers[m] = value[m];"

    @wp.func_native(_here(real, width, "ijkl") + f"Wide given; {copy} *here = given;")
    def store(vectors: wp.array4d(dtype=vector), i: int, j: int, k: int, l: int, value: vector): ...

    return store


def _here(real, width: int, axes: str) -> str:
    """C++ that declares ``here``, the vector at a place of the array, as what is aligned."""
    offset = " + ".join(f"int64_t(vectors.strides[{axis}]) * {name}" for axis, name in enumerate(axes))
    return f"""
        struct alignas(16) Wide {{ wp::{real.__name__} numbers[{width}]; }};
        Wide* const here = reinterpret_cast<Wide*>(reinterpret_cast<char*>(vectors.data) + {offset});
    """
