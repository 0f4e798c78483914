"""``tactemu explain``: everything that a scene asks for, and nothing that it does not."""

import itertools
import json

import pytest

from tests.cli.command import ROOT, here


def test_a_scene_is_explained_with_its_plan():
    done = here("explain", str(ROOT / "examples" / "hand.toml"))
    assert done.returncode == 0, done.stderr
    for words in (
        "pencil           cylinder  roll",
        "Skin 'fingertip': AnySkin",
        "fault     drop 1%",
        "0D 0A; no start byte",
        "taxel  on wire",
        "6 s to 7 s  palm: set = {'noise': 0.02}",
        "relative poses",
        "fingertip: electronics",
    ):
        assert words in done.stdout, words


def test_only_what_the_scene_requires_is_in_the_plan():
    plan = here("explain", "anyskin", "--no-cost", columns=200).stdout.partition("Plan: ")[2]
    *stages, threads = plan.splitlines()
    assert len(stages) == 5, plan
    assert threads == "threads: 1 (one environment)"


def test_the_schema_is_json():
    schema = json.loads(here("explain", "--schema").stdout)
    assert schema["properties"]["skin"]


@pytest.mark.parametrize("target", ["nosuch", "none.toml"])
def test_mistakes_exit_with_2(target):
    done = here("explain", target)
    assert done.returncode == 2
    assert done.stderr.startswith("tactemu: ")


def test_a_band_is_announced_before_it_is_built_and_found_again(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr("tactemu.geometry.shapes.band_building._KEPT_AFTER_S", 0.0)
    corners = itertools.product((-0.01, 0.01), repeat=3)
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in corners)
    sides = ((1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4))
    text += "".join(f"f {a} {b} {c}\nf {a} {c} {d}\n" for a, b, c, d in sides)
    (tmp_path / "box.obj").write_text(text)
    scene = tmp_path / "scene.toml"
    scene.write_text(
        '[[body]]\nname = "pad"\nshape = "frame"\nfixed = true\n'
        '[[body]]\nname = "tool"\nshape = "mesh"\npath = "box.obj"\nposition = [0.0, 0.0, 0.0098]\n'
        '[[skin]]\ndevice = "xela_uskin"\nlink = "pad"\nmodel = "kinematic_taxel"\nport = "memory:"\n'
        'options = { depth_query = "band", voxel_size = 1e-3 }\n'
    )
    first, again = (here("explain", str(scene), "--no-cost") for _ in range(2))
    assert first.returncode == 0, first.stderr
    before, plan = first.stdout.split("Plan: ")
    assert "body 'tool': comparing a band with its 12 faces takes about 1 s here" in before and plan
    assert "its band is kept in" in again.stdout and "(1 bands" in again.stdout
