"""Dipoles and places of taxels, found back from recordings of skins that do not exist."""

from pathlib import Path

import numpy as np
import pytest

import firmware_protocols as fp
from tactemu.fit import fitting
from tactemu.fit.estimates import Findings
from tactemu.fit.magnets import axes_of, find_magnets
from tactemu.fit.places import find_places
from tactemu.fit.recording import Recorded, read
from tactemu.scene.file import parse
from tests.fit.synthetic import with_gaps
from tests.transducers.dipoles import dipole_field


def pressed_magnets(seed, *, placed=True):
    """A probe that presses an AnySkin here and there: ``(recording, truth, column that is something else)``."""
    rng = np.random.default_rng([seed, 77])
    device = fp.create("anyskin", sees="field")
    chips, turns = device.layout.positions, axes_of(device)
    height, reach = rng.uniform(4e-3, 8e-3), rng.uniform(4e-3, 7e-3)
    moments = np.array([0, 0, 4e-3]) + rng.normal(0, 5e-4, (5, 3))
    t = np.arange(0.0, 120.0, 0.1)
    number = (t // 3).astype(int)
    depth = rng.uniform(0.5e-3, 2e-3, number.max() + 1)[number] * np.sin(np.pi * t / 3) ** 2
    place = rng.uniform(-8e-3, 8e-3, (number.max() + 1, 2))[number]
    share = np.exp(-0.5 * ((chips[None, :, :2] - place[:, None]) ** 2).sum(-1) / reach**2) if placed else 1.0
    up = height - depth[:, None] * share
    rows = [dipole_field(chips, chips + z[:, None] * device.layout.normals, moments) for z in up * np.ones((1, 5))]
    field = np.einsum("kab,tkb->tka", turns, np.array(rows)).reshape(len(t), 15) + rng.normal(0, 3e-5, 15)
    field += rng.normal(0, 4e-6, field.shape)
    field[rng.random(field.shape) < 5e-4] += 5e-3
    wrong = int(rng.integers(15))
    field[:, wrong] = 1e-4 * np.sin(t / 7) + rng.normal(0, 1e-4, len(t))
    keep = with_gaps(rng, len(t))
    truth = {"depth": depth[keep]} | ({"x": place[keep, 0], "y": place[keep, 1]} if placed else {})
    names = tuple(f"b{k}" for k in range(15))
    values = {"magnet height": height} | ({"press reach": reach} if placed else {})
    values |= {f"moment {k} {axis}": moments[k, a] for k in range(5) for a, axis in enumerate("xyz")}
    return Recorded(Path("a"), "0", t[keep], field[keep], names, "field", "T", truth), values, names[wrong]


def found_back(seeds, **options):
    hits = {}
    for seed in seeds:
        recording, truth, wrong = pressed_magnets(seed, **options)
        found = Findings()
        find_magnets(recording, fp.create("anyskin", sees="field"), found)
        assert f"{wrong} does not follow the magnets: left out" in found.notes
        for name, value in truth.items():
            hits.setdefault(name, []).append(found.estimates[name].contains(value))
        assert found.estimates["magnet height"].value == pytest.approx(truth["magnet height"], rel=0.05)
    return hits


def test_magnets_are_found_back():
    for name, inside in found_back(range(5)).items():
        assert sum(inside) >= 3, name


@pytest.mark.nightly
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("placed", [True, False])
def test_intervals_of_magnets_hold_the_truth_in_ninety_of_a_hundred(placed):
    for name, inside in found_back(range(100), placed=placed).items():
        assert sum(inside) >= 90, f"{name}: {sum(inside)} of 100"


def pressed_taxels(name, seed=0, *, order=None, turn_deg=0.0, axes=1, everywhere=True):
    """Presses on a grid of places; ``order``: which of the device's taxels each column is."""
    rng = np.random.default_rng(seed)
    layout = fp.create(name).layout
    n = len(layout)
    flat = (layout.positions - layout.positions.mean(axis=0))[:, :2]
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    taxels = flat @ np.array([[c, s], [-s, c]]) + [0.004, -0.002]
    spots = rng.uniform(taxels.min(axis=0) - 3e-3, taxels.max(axis=0) + 3e-3, (300 if everywhere else 3, 2))
    phase = np.linspace(0, np.pi, 20)
    place, load = np.repeat(spots, 20, axis=0), np.tile(3.0 * np.sin(phase) ** 2, len(spots))
    near = np.exp(-0.5 * ((place[:, None] - taxels[None]) ** 2).sum(-1) / 3e-3**2) * load[:, None] * 200
    columns = near[:, np.arange(n) if order is None else order] * rng.uniform(0.6, 1.4, n)
    if axes == 3:
        columns = (columns[..., None] * [0.3, 0.4, 1.0] * 1e-6).reshape(len(load), -1)
    columns = columns + rng.normal(0, 1.0 if axes == 1 else 2e-6, columns.shape)
    kind, unit = ("counts", "1") if axes == 1 else ("field", "T")
    truth = {"force": load, "x": place[:, 0], "y": place[:, 1]}
    t = np.arange(len(load)) * 0.02
    return Recorded(Path("a"), "0", t, columns, tuple(map(str, range(columns.shape[1]))), kind, unit, truth)


@pytest.mark.parametrize(("name", "axes"), [("cyskin_cpm_finger", 1), ("anyskin", 3)])
def test_order_and_turn_of_taxels_are_found(name, axes):
    device = fp.create(name)
    n = len(device.layout)
    exchanged = np.arange(n)
    exchanged[[1, 4]] = [4, 1]
    for order, turn in ((None, 0.0), (None, 30.0), (exchanged, -20.0)):
        found = Findings()
        find_places(pressed_taxels(name, order=order, turn_deg=turn, axes=axes), device, found)
        assert found.value("turn") == pytest.approx(turn, abs=2.0)
        assert found.estimates["turn"].contains(turn)
        said = "as of the device" if order is None else "not as the device's: 1 is the device's 4, 4 is the device's 1"
        assert f"order of the taxels: {said}" in found.notes
    few = Findings()
    find_places(pressed_taxels(name, axes=axes, everywhere=False), device, few)
    assert any("press beside each from all sides" in text for text in few.unknown)


def test_a_scene_has_the_magnets_that_were_found(tmp_path):
    recording, truth, _ = pressed_magnets(3)
    path, out = tmp_path / "skin.npz", tmp_path / "skin.toml"
    np.savez(path, t=recording.t, field=recording.readings, **recording.truth)
    fitting.run_fit([read(path)], device="anyskin", out=out, say=lambda _: None)
    (table,) = parse(out.read_text()).tables.skin[0].transducer
    assert table["chip_depth"] == pytest.approx(truth["magnet height"], rel=0.05)
    assert len(table["magnets"]) == len(table["moments"]) == 5
    bare = Recorded(Path("a"), "0", recording.t, recording.readings, recording.names, "field", "T", {})
    found = Findings()
    find_magnets(bare, fp.create("anyskin", sees="field"), found)
    assert any("a force alone leaves a common factor open" in text for text in found.unknown)
