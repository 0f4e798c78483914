"""A recording replayed to an unmodified driver, through the command line."""

import time

import numpy as np
import pytest

from tactemu.truth import read
from tests.cli.command import start, tactemu
from tests.drivers.live import Live, until
from tests.drivers.test_through_the_emulator import SCENE

pytestmark = [pytest.mark.driver, pytest.mark.timeout(120)]

SECONDS = 4


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Four seconds of a noisy AnySkin at 50 Hz, as a truth log."""
    folder = tmp_path_factory.mktemp("recording")
    scene, log = folder / "scene.toml", folder / "anyskin.jsonl"
    scene.write_text(SCENE.format(device="anyskin", rate_hz=50, noise=0.1, device_options=""))
    options = ("--port", "memory:", "--clock=virtual", "--seconds", str(SECONDS), "--truth", str(log))
    done = tactemu("run", str(scene), *options)
    assert done.returncode == 0, done.stderr
    return log


@pytest.mark.parametrize("speed", [1.0, pytest.param(2.0, marks=pytest.mark.nightly)])
def test_the_driver_reads_the_recording_frame_by_frame_at_its_pace(recording, speed, tmp_path):
    counts = [np.array(entry["counts"], np.float32) for entry in read(recording) if entry["kind"] == "sample"]
    recorded = [tuple(each.ravel().tolist()) for each in counts]
    assert len(set(recorded)) == len(recorded) >= 50 * SECONDS - 1
    port = tmp_path / "port"
    replay = start("replay", str(recording), "--port", f"pty:{port}", "--speed", str(speed))
    try:
        assert until(port.is_symlink, 30), "the replay makes its port"
        with Live("anyskin", str(port)) as live:
            began = time.monotonic()
            assert until(lambda: len(live.rows) >= len(recorded) / 2, 30), live.notes
            assert replay.wait(30) == 0, replay.stderr.read()
            assert time.monotonic() - began >= SECONDS / speed - 0.1
            rows = live.rows
    finally:
        replay.kill()
        replay.wait(10)
    places = [recorded.index(tuple(said.row.values())) for said in rows]
    assert np.all(np.diff(places) == 1), "none lost, none twice, none out of order"
    times = np.array([said.t_ns for said in rows]) / 1e9
    assert (times[-1] - times[0]) / (len(times) - 1) == pytest.approx(0.02 / speed, rel=0.2)
