"""``tactemu plot``: the pictures are of the log's numbers, and labels lie on nothing."""

import html

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from tactemu.base.errors import TactemuError
from tactemu.base.style import plot_style
from tactemu.truth import Truth
from tactemu.view.conversions import plots


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A skin of which one taxel lags behind and hums at 50 Hz; each frame takes 2 ms to the wire."""
    path = tmp_path_factory.mktemp("plots") / "t.mcap"
    truth = Truth(path)
    for k in range(1024):
        push = max(0.0, np.sin(k / 80))
        ideal = np.array([0, push, push / 2])
        measured = ideal + np.array([0, 0, 0.1 * np.sin(2 * np.pi * 50 * k * 1e-3) + 0.2])
        truth.sample(k * 1_000_000, "skin", ideal, measured, np.arange(3), number=k)
        truth.wrote(k * 1_000_000 + 2_000_000, "skin", b"\x00", sample=k)
    truth.close()
    return path


def test_the_numbers(log):
    series = plots.series_of(log)
    assert len(series.ideal) == 1024 and max(series.ideal) == pytest.approx(1.5, abs=1e-3)
    assert series.patch == pytest.approx([0, 1, 0.5], abs=1e-3) and set(series.to_wire_ms) == {2.0}
    figure = plots.Figure()
    axes = figure.add_subplot()
    plots._spectrum(axes, series)
    hz, density = axes.lines[0].get_data()
    assert hz[np.argmax(density)] == pytest.approx(50, abs=1.5)


@pytest.mark.parametrize("suffix", plots.SIGNS)
def test_files(log, tmp_path, suffix):
    target = tmp_path / f"a{suffix}"
    plots.plot(log, target)
    first = target.read_bytes()
    plots.plot(log, target)
    assert first == target.read_bytes() and len(first) > 10_000
    if suffix != ".png":
        assert f"tactemu plot {log} --to {target}" in html.unescape(first.decode())
    if suffix == ".html":
        assert first.count(b"<svg") == len(plots.PANELS) and b"http" not in first.replace(b"http://www.w3.org", b"")


def test_labels_lie_on_nothing(log):
    series = plots.series_of(log)
    with plots.matplotlib.rc_context(plot_style()):
        for draw in plots.PANELS.values():
            figure = plots.Figure(figsize=(5, 3.4), layout="constrained")
            axes = figure.add_subplot()
            draw(axes, series)
            axes.set_title("over time", loc="left")
            figure.draw_without_rendering()
            texts = [axes.xaxis.label, axes.yaxis.label, axes._left_title]
            texts += axes.get_legend().get_texts() if axes.get_legend() else []
            boxes = [text.get_window_extent() for text in texts]
            plot = axes.get_window_extent()
            for k, box in enumerate(boxes):
                assert not any(box.overlaps(other) for other in boxes[k + 1 :]) and not box.overlaps(plot)


def test_mistakes(log, tmp_path):
    with pytest.raises(TactemuError, match=r"'\.pngg'; did you mean '\.png'\?; expected \.png, \.svg, \.html"):
        plots.plot(log, tmp_path / "x.pngg")
    with pytest.raises(TactemuError, match=r"cannot write the plot: there is no folder .*none; make it first"):
        plots.plot(log, tmp_path / "none" / "x.png")
    with pytest.raises(TactemuError, match="no skin 'ring' "):
        plots.plot(log, tmp_path / "x.png", skin="ring")
