"""scripts/vcan-run hands a command's output and exit status through, wherever it finds CAN."""

import os
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "scripts" / "vcan-run"


def vcan_run(*arguments):
    done = subprocess.run([SCRIPT, *arguments], capture_output=True, text=True, timeout=60, check=False)
    if done.returncode == 125:
        pytest.skip(done.stderr.strip())
    return done


pytestmark = pytest.mark.skipif("VCAN_GUEST" in os.environ, reason="we are in the guest")


def test_output_status_interfaces_and_arguments():
    command = 'echo "$VCAN_GUEST|$*"; ls /sys/class/net; echo trouble >&2; exit 7'
    done = vcan_run("-i", "vcan0 can7", "--", "bash", "-c", command, "_", "two words", "$HOME")
    assert done.returncode == 7, done.stderr
    guest, *interfaces = done.stdout.splitlines()
    assert guest in ("native|two words $HOME", "uml|two words $HOME")
    assert {"vcan0", "can7"} <= set(interfaces)
    assert done.stderr == "trouble\n"


def test_time_limit_and_wrong_use():
    assert vcan_run("-t", "3", "--", "sleep", "60").returncode == 124
    assert vcan_run().returncode == 2
    assert vcan_run("-x").returncode == 2
    assert "-o DIR" in vcan_run("-h").stdout


def test_only_what_is_to_be_kept_is_kept(tmp_path):
    kept = tmp_path / "kept here"
    done = vcan_run("-u", "-o", str(kept), "--", "bash", "-c", f"echo 1 >'{kept}/file'; echo 2 >'{tmp_path}/lost'")
    assert done.returncode == 0, done.stderr
    assert (kept / "file").read_text() == "1\n" and not (tmp_path / "lost").exists()
