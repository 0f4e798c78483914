"""No full collection while the loop runs, and everything as before afterwards."""

import gc

from tactemu.base.gc_tuning import no_full_collections


def full_collections():
    return gc.get_stats()[2]["collections"]


def test_only_the_young_are_collected():
    gc.unfreeze()
    before = gc.get_threshold()
    kept = []
    with no_full_collections():
        start = full_collections()
        for _ in range(200_000):
            kept.append([object()])
        assert full_collections() == start
        assert gc.get_freeze_count() > 0
    assert gc.get_threshold() == before
    assert gc.get_freeze_count() == 0
