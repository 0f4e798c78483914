"""A log that stops without its end is cut, and every reader says so."""

import os
import subprocess
import sys

import pytest

import tactemu as tt
from tests.cli.command import environment, here, tactemu


@pytest.fixture(params=[".mcap", ".jsonl"])
def log(request, tmp_path):
    path = tmp_path / f"log{request.param}"
    with tt.serve("anyskin", "memory:", truth=path, clock="lockstep") as dev:
        dev.step(seconds=2)
    return path


def test_a_whole_log_says_nothing(log, caplog):
    assert not tt.read_log(log).is_cut and not caplog.records
    assert here("truth", str(log)).stderr == ""


@pytest.mark.parametrize("cut", [9, 100, "half"])
def test_a_log_that_was_cut_is_said_to_be(log, cut, caplog):
    size = log.stat().st_size
    os.truncate(log, size // 2 if cut == "half" else size - cut)
    assert tt.read_log(log).is_cut
    assert f"{log}: cut off: the end of the log is missing" in caplog.text
    done = here("truth", str(log), "--json")
    assert done.returncode == 0 and '"cut": true' in done.stdout


def test_a_user_sees_that_a_log_was_cut(log):
    os.truncate(log, log.stat().st_size // 2)
    assert "cut off" in tactemu("truth", str(log), "--json").stderr
    assert "cut off" in tactemu("truth", str(log), "--to", str(log.with_suffix(".csv"))).stderr


@pytest.mark.skipif(os.getuid() != 0, reason="only root mounts a small file system")
def test_a_run_whose_log_does_not_fit_ends_with_4(tmp_path):
    script = (
        f"mount -t tmpfs -o size=300k none {tmp_path} && exec {sys.executable} -m tactemu run linker_hand_l6 "
        f"--truth {tmp_path}/t.mcap --port memory: --clock virtual --seconds 60"
    )
    done = subprocess.run(
        ["unshare", "-m", "sh", "-c", script],
        capture_output=True,
        text=True,
        env=environment(),
        timeout=100,
        check=False,
    )
    assert done.returncode == 4 and "entries are missing" in done.stdout + done.stderr, done.stderr
