"""A smoke test: the benchmark of the wire runs and names every stage. The figures are the machine's business."""

from tactemu.tune.speed.wire import run


def test_every_stage_is_measured():
    lines = []
    figures = run(lines.append, repeats=1)
    assert {"can bits", "wire serial", "wire can", "pty write and read", "whole serial on a pty"} <= set(figures)
    assert all(figure > 0 for figure in figures.values()) and len(lines) == len(figures)
