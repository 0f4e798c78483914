"""Every device: a run that goes on from a saved state sends, feels and counts what the uninterrupted one does."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import firmware_protocols as fp
from tests.emulator.saving import story

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("states")


@pytest.fixture(scope="module")
def ends():
    """How the stories end, by device: filled by the tests, for the one of another process."""
    return {}


@pytest.mark.each_device
@pytest.mark.parametrize("name", fp.names())
def test_goes_on_as_if_never_interrupted(name, folder, ends):
    data = story.of_device(name)
    whole, states, marks = story.build(data), [], []
    story.ask(whole)

    def save() -> None:
        marks.append((len(whole.truth.frames), len(whole.truth.samples)))
        states.append(whole.snapshot())
        if len(states) == 1:
            whole.save(folder / f"{name}.npz")

    with whole:
        for at_s in story.SAVES_S:
            whole.call(save, round(at_s * 1e9))
        whole.run(story.SECONDS)
    told, counted = story.heard(whole), story.counted(whole)
    assert len(told[1]) > 3 or whole.channels[0].device.boot_s > 0.1
    rests = [[*(part[k:] for part, k in zip(told, mark)), counted] for mark in marks]
    ends[name] = story.digest(rests[0])
    other = story.build(data)
    for k in (1, 0):  # in a fresh emulator, then in one that has been on
        other.restore(states[k])
        assert story.told_on(other, story.SAVES_S[k]) == rests[k], f"from {story.SAVES_S[k]} s on"


@pytest.mark.timeout(400)
def test_all_go_on_in_another_process(folder, ends):
    if not ends:
        pytest.skip("looks at what the tests of each device left")
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "tests.emulator.saving.story", str(folder)]
    done = subprocess.run(command, check=False, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=380)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[-1]) == ends
