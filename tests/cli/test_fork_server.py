"""A command that the fork server has forked, against ``python -m tactemu``."""

import os
import signal
import subprocess
import sys

import pytest

from tests.cli.command import environment, start, tactemu


@pytest.mark.parametrize(
    "words",
    [
        ("devices", "anyskin"),
        ("faults", "--no-such-option"),
        ("run", "anyskn"),
        ("run", "anyskin", "--port", "memory:", "--clock", "virtual", "--seconds", "0.2"),
        ("exec", "-q", "anyskin", "--", "sh", "-c", "pwd; echo $NO_COLOR >&2; exit 3"),
    ],
    ids=" ".join,
)
def test_it_writes_the_same_and_exits_with_the_same_status(words, tmp_path):
    command = [sys.executable, "-m", "tactemu", *words]
    true = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=environment(), check=False)
    forked = tactemu(*words, cwd=tmp_path)
    assert (forked.stdout, forked.stderr, forked.returncode) == (true.stdout, true.stderr, true.returncode)


def test_it_is_a_child_of_this_process_with_its_own_folder_and_files(tmp_path):
    with start("replay", "-", stdin=subprocess.PIPE, cwd=tmp_path) as run:
        process = f"/proc/{run.pid}"
        assert os.readlink(f"{process}/cwd") == str(tmp_path)
        with open(f"{process}/status") as status:
            assert f"PPid:\t{os.getpid()}\n" in status.readlines()
        os.kill(run.pid, signal.SIGKILL)
        assert run.wait(10) == -signal.SIGKILL
    assert not os.path.exists(process), "no descendant has it as a zombie"
