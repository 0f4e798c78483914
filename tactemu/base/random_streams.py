"""Same seed, same bytes: every stage draws from its own stream, named after the stage.

The streams are counter-based. A draw is a function of (root seed, stage name, environment, index, step), so that
switching one imperfection on changes no other, and an environment reads the same alone or among 4096.
"""

from __future__ import annotations

import hashlib

import numpy as np


def stream_key(seed: int, name: str) -> int:
    """Return a 31-bit key for the stream ``name`` under a root seed: the same on every machine and in every process."""
    digest = hashlib.blake2b(f"{seed}/{name}".encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little") & 0x7FFF_FFFF


def generator(seed: int, name: str) -> np.random.Generator:
    """Return a host-side generator for the stream ``name`` (faults on the wire, sampling of meshes ...)."""
    return np.random.Generator(np.random.Philox(key=stream_key(seed, name)))
