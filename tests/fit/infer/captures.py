"""Captures for tests: slow values with noise, in frames of which every byte is known."""

import numpy as np

from tactemu.fit.infer.captures import Chunk

RATE_NS = 10_000_000


def slow(n, seed, low=0, high=4095, noise=3.0):
    """Return slow integers that go through their whole range and back several times, with noise."""
    rng = np.random.default_rng(seed)
    phase = np.linspace(0, 2 * np.pi * (3 + seed % 3), n) + seed
    values = (low + high) / 2 + (high - low) / 2 * np.sin(phase) + noise * rng.standard_normal(n)
    return np.clip(np.rint(values), low, high).astype(int)


def stream(frames, times=True):
    """Return frames as chunks of a sensor that sends by itself."""
    return [Chunk(k * RATE_NS if times else None, "tx", frame) for k, frame in enumerate(frames)]


def dialogue(pairs):
    """Return questions with their answers as chunks."""
    chunks = []
    for k, (question, answer) in enumerate(pairs):
        chunks += [Chunk(k * RATE_NS, "rx", question), Chunk(k * RATE_NS + 1_000_000, "tx", answer)]
    return chunks


def fields_at(draft, at):
    """Return the fields that begin at a byte, in every group."""
    return [each for group in draft.groups for each in group.fields if each.at == at]
