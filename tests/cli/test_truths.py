"""``tactemu truth``: its counts are those of the log."""

import json

import numpy as np
import pytest

from tactemu.base.errors import TactemuError
from tactemu.cli.truths import summarise
from tactemu.truth import Truth, read_log
from tactemu.truth.conversion import convert
from tests.cli.command import here, tactemu


@pytest.fixture(params=[".mcap", ".jsonl"])
def log(request, tmp_path):
    path = tmp_path / f"truth{request.param}"
    truth = Truth(path)
    for k in range(11):
        t = k * 10_000_000
        truth.sample(t, "skin", np.array([0.0, -k]), np.array([0.5, -k]), np.array([0, k]))
        truth.wrote(t, "skin", bytes([k]))
    truth.inject(5, "skin", "flip", "byte 3 bit 1")
    truth.inject(6, "skin", "flip", "byte 3 bit 2")
    truth.dropped(7, "skin", b"\x00", "line full")
    truth.event(8, "other", "opened")
    truth.close()
    return path


def test_summary_counts_the_entries(log):
    summary = summarise(log)
    skin = summary["skin"]
    assert (skin["samples"], skin["rate_hz"], skin["seconds"]) == (11, 100.0, 0.1)
    assert skin["frames_to_driver"] == 11
    assert skin["injected"] == {"flip": 2}
    assert skin["dropped"] == {"line full": 1}
    assert (skin["largest_ideal"], skin["largest_error"]) == (10.0, 0.5)
    assert summary["other"]["events"] == {"opened": 1}


def test_command_prints_it(log):
    assert "flip 2" in here("truth", str(log)).stdout
    assert json.loads(here("truth", str(log), "--json").stdout) == summarise(log)


@pytest.mark.parametrize("suffix", [".mcap", ".jsonl"])
def test_a_run_writes_what_it_has_counted(tmp_path, suffix):
    path = tmp_path / f"truth{suffix}"
    run = ("run", "anyskin", "--port", "memory:", "--clock=virtual", "--seconds", "0.5", "--json")
    said = [json.loads(line) for line in here(*run, "--truth", str(path)).stdout.splitlines()]
    last = next(line for line in said if line.pop("event") == "summary")
    assert read_log(path).summary == {"anyskin": last}
    told = summarise(path)["anyskin"]
    assert (told["missed"], told["wire"], told["device"]) == (0, {"sent": 49, "sent_bytes": 4018}, {})
    other = path.with_name("other.mcap" if suffix == ".jsonl" else "other.jsonl")
    convert(path, str(other))
    assert summarise(other) == summarise(path), "and so does a copy of the other format"


@pytest.mark.parametrize("content", [b"{\n", b'{"t_ns": 1}\n', b"\xff\xfe", b"[1]\n", b"3\n"])
def test_what_is_no_log_is_refused(tmp_path, content):
    path = tmp_path / "x.jsonl"
    path.write_bytes(content)
    with pytest.raises(TactemuError, match=r"x\.jsonl"):
        summarise(path)


def test_a_run_on_a_full_disk_goes_on_and_says_so(tmp_path):
    (tmp_path / "t.mcap").symlink_to("/dev/full")
    run = ("run", "anyskin", "--port", "memory:", "--clock=virtual", "--seconds", "0.5", "--json")
    done = tactemu(*run, "--truth", str(tmp_path / "t.mcap"), "--truth-keep", "1MB")
    assert done.returncode == 4, "it ran, but the log that was asked for is not whole"
    assert "t.mcap: cannot write the log: No space left on device; the run goes on" in done.stderr
    said = [json.loads(line) for line in done.stdout.splitlines()]
    (lost,) = (each["text"] for each in said if each["skin"] == "truth log")
    assert int(lost.split()[0]) >= 50
    assert here(*run, "--truth-keep", "much").returncode == 2


def test_names_in_a_log_do_not_command_the_terminal(tmp_path):
    path = tmp_path / "t.jsonl"
    truth = Truth(path)
    truth.event(0, "a\x1b[2Jb", "opened\x07")
    truth.close()
    done = here("truth", str(path))
    assert done.returncode == 0 and "a\\x1b[2Jb" in done.stdout
    assert "\x1b" not in done.stdout and "\x07" not in done.stdout


def test_a_missing_log(tmp_path):
    done = here("truth", str(tmp_path / "none.jsonl"))
    assert done.returncode == 2
    assert "cannot read it: No such file" in done.stderr
