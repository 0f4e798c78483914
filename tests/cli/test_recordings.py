"""`tactemu replay`, `record` and `faults` as commands, with pyserial as the driver."""

import signal
import subprocess
import time

import pytest
import serial

from tactemu.base.errors import TactemuError
from tactemu.control.client import connect
from tactemu.truth.recorder import Recorder
from tactemu.truth.recording import load
from tactemu.wire.faults import FAULTS
from tests.cli.command import here, start, tactemu
from tests.truth.telling import passed


@pytest.fixture
def recording(tmp_path):
    with Recorder(tmp_path / "in.jsonl") as recorder:
        for k in range(1, 11):
            recorder.add(passed(k * 10_000_000, bytes([k]) * 8))
    return tmp_path / "in.jsonl"


def wait_for(path):
    for _ in range(2500):
        if path.is_symlink():
            return str(path)
        time.sleep(0.02)
    raise AssertionError(f"{path} never appeared")


def test_replay_to_record(recording, tmp_path):
    player = start("replay", str(recording), "--port", f"pty:{tmp_path / 'tty'}", "--loop")
    port = wait_for(tmp_path / "tty")
    result = tactemu("record", str(tmp_path / "out.jsonl"), "--from", port, "--seconds", "0.5")
    assert result.returncode == 0 and "entries in" in result.stdout, result.stderr
    player.send_signal(signal.SIGTERM)
    out, _ = player.communicate(timeout=20)
    assert player.returncode == 0 and "frames played" in out and not (tmp_path / "tty").is_symlink()
    got = b"".join(entry.frame for entry in load(tmp_path / "out.jsonl").entries)
    whole = b"".join(entry.frame for entry in load(recording).entries)
    assert len(got) > 100 and got in whole * 20


def test_what_befalls_a_replay_is_poked(recording, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    player = start("replay", str(recording), "--port", f"pty:{tmp_path / 'tty'}", "--loop")
    assert player.stdout is not None
    player.stdout.readline()
    with connect() as playing, serial.Serial(str(tmp_path / "tty"), timeout=5) as driver:
        assert len(driver.read(8)) == 8
        with pytest.raises(TactemuError, match="press: a recording is replayed here, nothing is simulated"):
            playing.press(1e-3)
        playing.fault("drop 100%")
        playing.wait(0.1)
        driver.reset_input_buffer()
        playing.wait(0.1)
        assert driver.in_waiting == 0 and playing.stats()["wire"]["drop"] > 5
        playing.mend("drop")
        assert len(driver.read(80)) == 80
        playing.unplug(0.1)
        wait_for(tmp_path / "tty")
    assert "drop" in here("poke", "stats").stdout
    player.send_signal(signal.SIGTERM)
    assert player.wait(20) == 0


def test_replay_stepwise(recording, tmp_path):
    player = start("replay", str(recording), "--port", f"pty:{tmp_path / 'tty'}", "--step", stdin=subprocess.PIPE)
    with serial.Serial(wait_for(tmp_path / "tty"), timeout=5) as driver:
        for k in (1, 2, 3):
            player.stdin.write("\n")
            player.stdin.flush()
            assert driver.read(8) == bytes([k]) * 8
            assert driver.in_waiting == 0
    out, _ = player.communicate(timeout=20)
    assert player.returncode == 0 and "3 of 10 frames played" in out


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["replay", "missing.jsonl", "--port", "memory:"], "No such file"),
        (["replay", "{recording}", "--port", "can:virtual:x"], "holds a serial stream"),
        (["replay", "{recording}", "--port", "nope:"], "unknown scheme"),
        (["replay", "{recording}", "--port", "memory:", "--skin", "ring"], "no skin 'ring' "),
        (["replay", "{recording}", "--port", "memory:", "--speed", "0"], "more than 0"),
        (["replay", "{recording}", "--port", "memory:", "--fault", "dropp"], "did you mean 'drop'"),
        (["record", "{tmp}/x.txt", "--from", "/dev/null"], "expected .mcap"),
        (["record", "{tmp}/x.jsonl", "--from", "/dev/no-such-tty"], "check its name"),
    ],
)
def test_mistakes_are_one_line_and_exit_code_2(arguments, complaint, recording, tmp_path):
    result = here(*(each.format(recording=recording, tmp=tmp_path) for each in arguments))
    assert result.returncode == 2
    assert complaint in result.stderr and len(result.stderr.splitlines()) == 1


def test_every_kind_of_fault_is_listed():
    result = here("faults")
    assert result.returncode == 0
    assert set(FAULTS) <= set(result.stdout.split())
