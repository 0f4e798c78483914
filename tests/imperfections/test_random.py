"""The counter-based generator against its published test vectors, and its draws against their laws."""

import functools

import numpy as np
import pytest
import warp as wp

from tactemu.imperfections.random import draw, normals, philox, unit_f64

KNOWN_ANSWERS = [
    # Random123 1.14 (Salmon et al.), file kat_vectors, lines "philox4x32 10": counter, key, result.
    ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((0xFFFFFFFF,) * 4, (0xFFFFFFFF,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0xA4093822, 0x299F31D0),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]


@wp.kernel(module="unique", enable_backward=False)
def _philox(counter: wp.array(dtype=wp.vec4ui), key: wp.array(dtype=wp.vec2ui), out: wp.array(dtype=wp.vec4ui)):
    i = wp.tid()
    out[i] = philox(counter[i], key[i][0], key[i][1])


@functools.cache
def _normal_kernel(real):
    four, normals4 = wp.types.vector(4, real), normals(real)

    @wp.kernel(module="unique", enable_backward=False)
    def _draws(
        keys: wp.vec2ui,
        stream: wp.vec3i,
        step: wp.int64,
        out: wp.array(dtype=four),
        unit: wp.array(dtype=wp.float64),
    ):
        i = wp.tid()
        words = draw(keys, stream, step, i)
        out[i] = normals4(words)
        unit[i] = unit_f64(words[0])

    return _draws, four


def draws(n: int, key: int = 1, resets: int = 0, step: int = 1, high: int = -1, real=wp.float64):
    """Normals ``(n, 4)`` and uniforms ``(n,)``."""
    kernel, four = _normal_kernel(real)
    out, unit = wp.zeros(n, dtype=four, device="cpu"), wp.zeros(n, dtype=wp.float64, device="cpu")
    inputs = [wp.vec2ui(key, 7), wp.vec3i(0, resets, high), step, out, unit]
    wp.launch(kernel, dim=n, inputs=inputs, device="cpu")
    return out.numpy(), unit.numpy()


def test_philox_gives_the_published_words():
    counter, key, expected = (np.array([case[k] for case in KNOWN_ANSWERS], dtype=np.uint32) for k in range(3))
    out = wp.zeros(3, dtype=wp.vec4ui, device="cpu")
    inputs = [wp.array(counter, dtype=wp.vec4ui, device="cpu"), wp.array(key, dtype=wp.vec2ui, device="cpu")]
    wp.launch(_philox, dim=3, inputs=inputs, outputs=[out], device="cpu")
    np.testing.assert_array_equal(out.numpy(), expected)


def test_normals_are_standard_and_independent():
    """Kolmogorov-Smirnov on 4e5 numbers at p = 1e-3, and no correlation beyond 4.5 standard errors."""
    from scipy.stats import kstest

    single, double = draws(100_000, real=wp.float32)[0], draws(100_000)[0]
    assert kstest(double.ravel(), "norm").pvalue > 1e-3
    assert np.abs(single - double).max() < 1e-3, "both float widths draw the same numbers"
    correlation = np.corrcoef(np.concatenate([double, np.roll(double, 1, axis=0)], axis=1).T)
    assert np.abs(correlation - np.eye(8)).max() < 4.5 / np.sqrt(100_000)


@pytest.mark.parametrize("other", [{"key": 2}, {"resets": 1}, {"step": 2}, {"step": 1 + 2**32}, {"high": 0}])
def test_streams_and_steps_are_independent(other):
    a, b = draws(100_000)[0], draws(100_000, **other)[0]
    assert abs(np.corrcoef(a.ravel(), b.ravel())[0, 1]) < 4.5 / np.sqrt(a.size)


def test_uniform_is_open_at_both_ends():
    unit = draws(100_000)[1]
    assert 0.0 < unit.min() and unit.max() < 1.0
    assert unit.mean() == pytest.approx(0.5, abs=4.5 / np.sqrt(12 * unit.size))
