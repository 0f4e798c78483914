"""``tactemu explain``: everything that a scene asks for, and nothing that it does not."""

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
    plan = here("explain", "anyskin", "--no-cost").stdout.partition("Plan: ")[2]
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
