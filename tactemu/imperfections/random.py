"""Random numbers on the device as a function of (stream, environment or its seed, index, step).

Nothing is stored and the order of draws does not matter. The generator is Philox4x32-10 (Salmon, Moraes, Dror and Shaw,
"Parallel random numbers: as easy as 1, 2, 3", SC 2011). One call returns four independent words. The counter is (step
low, step high, index, environment); the key is that of the stream (:mod:`tactemu.base.random_streams`) and the number
of resets: a new episode has other draws, also where its steps are counted from 0 again. Both float widths use the same
words.

An environment that was reset with a seed has the low half of the seed in place of its number, and another key of the
stream, which does not depend on the root seed, with the high half in it; its steps count from its own reset.
"""

# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false
# pyright: reportGeneralTypeIssues=false

import functools
import math

import warp as wp

from tactemu.base.random_streams import stream_key
from tactemu.plan.clock import Clock

_M0, _M1 = wp.constant(wp.uint64(0xD2511F53)), wp.constant(wp.uint64(0xCD9E8D57))
_W0, _W1 = wp.constant(wp.uint32(0x9E3779B9)), wp.constant(wp.uint32(0xBB67AE85))
_LOW = wp.constant(wp.uint64(0xFFFFFFFF))
_SHIFT = wp.constant(wp.uint64(32))


@wp.func
def philox(counter: wp.vec4ui, key0: wp.uint32, key1: wp.uint32) -> wp.vec4ui:
    """Return four random words for a counter and a key."""
    c0, c1, c2, c3 = counter[0], counter[1], counter[2], counter[3]
    for _ in range(10):
        p0 = _M0 * wp.uint64(c0)
        p1 = _M1 * wp.uint64(c2)
        c0 = wp.uint32(p1 >> _SHIFT) ^ c1 ^ key0
        c2 = wp.uint32(p0 >> _SHIFT) ^ c3 ^ key1
        c1 = wp.uint32(p1 & _LOW)
        c3 = wp.uint32(p0 & _LOW)
        key0 = key0 + _W0
        key1 = key1 + _W1
    return wp.vec4ui(c0, c1, c2, c3)


def stream_keys(seed: int, name: str) -> wp.vec2ui:
    """Return the keys of the stream ``name``: under a root seed, and for environments that have a seed of their own."""
    return wp.vec2ui(stream_key(seed, name), stream_key(None, name))


@wp.func
def draw(keys: wp.vec2ui, stream: wp.vec3i, step: wp.int64, index: int) -> wp.vec4ui:
    """Return four random words of the stream ``keys`` for an environment, a step and an index.

    ``stream`` is that of the environment, :attr:`tactemu.plan.plan.Context.streams`, and ``step`` the result of
    :func:`step_of`, or 0 for a draw at a reset.
    """
    key = wp.where(stream[2] < 0, keys[0], keys[1] ^ wp.uint32(stream[2]))
    words = wp.uint64(step)
    counter = wp.vec4ui(wp.uint32(words & _LOW), wp.uint32(words >> _SHIFT), wp.uint32(index), wp.uint32(stream[0]))
    return philox(counter, key, wp.uint32(stream[1]))


@wp.func
def step_of(clock: Clock, stream: wp.vec3i, row: int) -> wp.int64:
    """Return the step by which the environment of a row draws: of all, or its own after a reset with a seed."""
    step = clock.step[0]
    if stream[2] >= 0:
        step = step - clock.began_step[row]
    return step


@wp.func
def unit_f64(word: wp.uint32) -> wp.float64:
    """Return a number in (0, 1), both ends excluded."""
    return (wp.float64(word) + wp.float64(0.5)) * wp.float64(1.0 / 4294967296.0)


@functools.cache
def normals(real: type):
    """Return the Warp function that makes four independent standard normal numbers from four words (Box-Muller)."""
    four = wp.types.vector(4, real)
    two_pi = 2.0 * math.pi

    @wp.func
    def normals4(words: wp.vec4ui) -> four:
        scale, half = real(1.0 / 4294967296.0), real(0.5)
        r0 = wp.sqrt(real(-2.0) * wp.log((real(words[0]) + half) * scale))
        r1 = wp.sqrt(real(-2.0) * wp.log((real(words[1]) + half) * scale))
        a0 = real(two_pi) * real(words[2]) * scale
        a1 = real(two_pi) * real(words[3]) * scale
        return four(r0 * wp.cos(a0), r0 * wp.sin(a0), r1 * wp.cos(a1), r1 * wp.sin(a1))

    return normals4
