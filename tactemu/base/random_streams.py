"""The random streams: every stage draws from a stream of its own, named after the stage. Same seed, same bytes.

The streams are counter-based. A draw is a function of (root seed, stage name, environment, index, step), so that
switching one imperfection on changes no other, and an environment has the same readings alone or among 4096. Once an
environment was reset with a seed, the seed takes the place of root seed and environment.
"""

from __future__ import annotations

import hashlib

import numpy as np

_MASK_64 = 2**64 - 1


def stream_key(seed: int | None, name: str) -> int:
    """Return a 31-bit key for the stream ``name`` under a root seed (``None``: under none): the same on every machine
    and in every process."""
    text = name if seed is None else f"{seed}/{name}"
    digest = hashlib.blake2b(text.encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little") & 0x7FFF_FFFF


def generator(seed: int, name: str) -> np.random.Generator:
    """Return a host-side generator for the stream ``name`` (faults on the wire, sampling of meshes ...)."""
    return np.random.Generator(np.random.Philox(key=stream_key(seed, name)))


def uniform_64(key: int, k: int) -> int:
    """Return draw ``k`` of the stream with this key: uniform in ``[0, 2**64)``, the SplitMix64 hash of a counter."""
    z = (((key << 32) ^ k) * 0x9E3779B97F4A7C15) & _MASK_64
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & _MASK_64
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & _MASK_64
    return z ^ (z >> 31)
