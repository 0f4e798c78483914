"""Tests of `tactemu judge --success`: the success rate of a task by the strength of a fault."""

import json
from dataclasses import replace

import pytest

from tactemu.base.errors import TactemuError
from tactemu.cli.judge_output import judge_success
from tactemu.judge.options import JudgeOptions
from tactemu.judge.success import Point, as_text, read_script

SUCCESS = """
import time
from pathlib import Path

def success(dev):
    end = time.monotonic() + 3.0
    while time.monotonic() < end and not (done := Path({done!r}).exists()):
        time.sleep(0.01)
    Path({done!r}).unlink(missing_ok=True)
    return done
"""
TASK = """
import sys, serial
BEGIN = bytes([0xAA])
port, data, sound = serial.Serial(sys.argv[1], 1_000_000, timeout=0.2), b"", 0
while sound < 30:
    data += port.read(16)
    while len(data) >= 16:
        packet, data = data[:16], data[16:]
        if not packet.startswith(bytes.fromhex("aa07080a")):
            data = data[data.find(BEGIN):] if BEGIN in data else b""
            sound = 0
        elif sum(packet[:14]) & 0xFFFF == int.from_bytes(packet[14:], "big"):
            sound += 1
        else:
            sound = 0
open(sys.argv[2], "w").close()
"""


def test_a_point_says_how_sure_it_is():
    low, high = Point("drop", 1.0, tried=3, succeeded=3).interval
    assert 0.4 < low < 0.5 and high == 1.0
    assert Point("drop", 1.0).after(True).after(False) == Point("drop", 1.0, 2, 1)
    text = "\n".join(as_text({("", 0.0): Point("", 0.0, 3, 3), ("drop", 10.0): Point("drop", 10.0, 3, 1)}))
    assert "no fault" in text and "frames lost [%]" in text and "1 of 3" in text


@pytest.mark.parametrize(
    ("script", "message"),
    [
        ("x = 1", "no function success"),
        ("1 / 0", "ZeroDivisionError"),
        (None, "No such file"),
        ("def (", "SyntaxError"),
    ],
)
def test_a_script_that_is_none_is_said(script, message, tmp_path):
    path = tmp_path / "success.py"
    if script is not None:
        path.write_text(script)
    with pytest.raises(TactemuError, match=message):
        read_script(path)


def test_a_task_that_wants_thirty_sound_packets_in_a_row(tmp_path, monkeypatch, capsys):
    """Check that the task succeeds without a fault and with few wrong bits, and not if 60 % of the frames are wrong."""
    monkeypatch.setattr("tactemu.judge.success.STRENGTHS", {"flip": ("frames with a wrong bit [%]", (1, 60))})
    script, task, done = (tmp_path / name for name in ("success.py", "task.py", "done"))
    script.write_text(SUCCESS.format(done=str(done)))
    task.write_text(TASK)
    command = ["python", str(task), "{port}", str(done)]
    options, curve = JudgeOptions(only=("flip",), budget_s=0.1, seed=1), tmp_path / "curve.json"
    assert judge_success("optoforce", command, script, options, curve) == 0
    got = {(each["fault"], each["strength"]): each for each in json.loads(curve.read_text())}
    assert {key: each["succeeded"] for key, each in got.items()} == {("", 0): 1, ("flip", 1): 1, ("flip", 60): 0}
    assert "frames with a wrong bit" in capsys.readouterr().out
    with pytest.raises(TactemuError, match="no fault 'dorp'"):
        judge_success("optoforce", command, script, replace(options, only=("dorp",)), curve)
