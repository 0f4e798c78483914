"""Saved states and the emulators that made them are garbage of hundreds of megabytes."""

import gc

import pytest


@pytest.fixture(scope="package", autouse=True)
def own_garbage():
    """Free it here: a loop in real time of a later test would stand still for seconds while it is freed."""
    yield
    gc.collect()
