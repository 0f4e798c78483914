"""Exports of a truth log: others read them, and they say what the log says."""

import csv

import can
import numpy as np
import pytest

import tactemu as tt
from firmware_protocols import CanFrame
from tactemu.base.errors import TactemuError
from tactemu.truth import Truth, entries, read
from tactemu.truth.conversion import convert
from tactemu.truth.recording import load
from tests.cli.command import here
from tests.truth.telling import CAN, COUNTS, IDEAL, tell


def export(log, target, **options):
    """Convert a log, and return the number of rows."""
    count, files = convert(log, str(target), **options)
    assert files == [target]
    return count


@pytest.fixture(params=[".mcap", ".jsonl"])
def log(request, tmp_path):
    path = tmp_path / f"truth{request.param}"
    truth = Truth(path)
    truth.begin(55)
    tell(truth)
    truth.close()
    return path


def test_samples_as_csv(log, tmp_path):
    assert export(log, tmp_path / "x.csv", skin="thumb") == 3
    with (tmp_path / "x.csv").open(newline="") as file:
        head, *rows = csv.reader(file)
    assert head[:5] == ["t_ns", "sample", "ideal_0_x", "ideal_0_y", "ideal_0_z"] and head[-1] == "counts_1_1"
    assert [row[:2] for row in rows] == [["0", "0"], ["10", "1"], ["20", "2"]]
    numbers = np.array(rows[2][2:], float)
    assert np.array_equal(numbers[:6], (2 * IDEAL).ravel()) and np.array_equal(numbers[6:12], (IDEAL / 7).ravel())
    assert np.array_equal(np.float32(numbers[12:]), COUNTS.ravel())
    assert export(log, tmp_path / "y.csv", skin="thumb", sense="imu") == 1
    assert (tmp_path / "y.csv").read_text().splitlines()[1].endswith(",0,1,2,3,4,5")


@pytest.mark.parametrize("suffix", [".log", ".asc", ".blf"])
def test_can_frames_as_others_have_them(log, tmp_path, suffix):
    assert export(log, tmp_path / f"bus{suffix}") == 2
    assert [(entry.frame, entry.kind) for entry in load(tmp_path / f"bus{suffix}").entries] == [
        (CAN, "tx"),
        (CanFrame(arbitration_id=0x27, data=b"\xb1\xc6"), "rx"),
    ]
    with can.LogReader(tmp_path / f"bus{suffix}") as messages:
        assert [message.arbitration_id for message in messages] == [0x18FF0001, 0x27]


def test_everything_in_the_other_format(log, tmp_path):
    target = tmp_path / f"other{'.jsonl' if log.suffix == '.mcap' else '.mcap'}"
    assert export(log, target) == 13
    assert tt.read_log(target).origin_ns == 55
    before, after = list(read(log)), list(read(target))
    assert [row.keys() for row in before] == [row.keys() for row in after]
    for one, other in zip(before, after):
        for key, value in one.items():
            if isinstance(value, np.ndarray):
                assert np.array_equal(value, other[key].astype(value.dtype))
            else:
                assert value == other[key]
    assert export(log, tmp_path / "index.mcap", skin="index") == 4
    assert {entry.device for entry in entries(tmp_path / "index.mcap")} == {"index", "thumb+index"}


def test_error_frames_are_those_of_candump(tmp_path):
    truth = Truth(tmp_path / "t.mcap")
    truth.wrote(1_500_000, "a", CanFrame(arbitration_id=0x27, is_error_frame=True))
    truth.close()
    export(tmp_path / "t.mcap", tmp_path / "t.log")
    assert (tmp_path / "t.log").read_text() == "(0.001500) can0 20000008#0000000000000000 R\n"


@pytest.mark.parametrize(
    ("target", "options", "complaint"),
    [
        ("x.csv", {}, "'thumb', 'index' have different columns; choose one with --skin"),
        ("x.csv", {"skin": "thmb"}, r"truth\..*: no skin 'thmb'; did you mean 'thumb'\? \(skins: "),
        ("x.csv", {"skin": "thumb", "sense": "heat"}, "no sense 'heat' "),
        ("x.log", {"skin": "ring"}, "no skin 'ring' "),
        ("x.txt", {}, "expected one of foxglove.mcap, ros2.mcap, rrd, parquet, csv, log"),
        ("none/x.csv", {}, "none/x.csv: cannot write it: there is no folder .*none; make it first"),
        ("truth{suffix}", {}, "is the log itself"),
    ],
)
def test_mistakes(log, tmp_path, target, options, complaint):
    with pytest.raises(TactemuError, match=complaint):
        export(log, tmp_path / target.format(suffix=log.suffix), **options)


def test_the_command(log, tmp_path):
    done = here("truth", str(log), "--export", str(tmp_path / "thumb.csv"), "--skin", "thumb")
    assert done.returncode == 0 and "3 rows written to" in done.stdout, done.stderr
    assert len((tmp_path / "thumb.csv").read_text().splitlines()) == 4


def test_a_log_of_several_lines_is_replayed_one_at_a_time(log):
    with pytest.raises(TactemuError, match=r"bytes of 'thumb' and CAN frames of 'index', 'thumb\+index'.*with --skin"):
        load(log)
    assert [entry.frame for entry in load(log, "index").entries] == [
        CAN,
        CanFrame(arbitration_id=0x27, data=b"\xb1\xc6"),
    ]
