"""The truth log of a run: all entries in the file, the latest in memory, within its bytes."""

import numpy as np
import pytest

from firmware_protocols.can_frames import CanFrames
from tactemu.base.errors import TactemuError
from tactemu.emulator.assembly import truth_of
from tactemu.scene.file import parse
from tactemu.truth import Truth
from tactemu.truth.memory import Budget, Memory, parse_size
from tests.truth.telling import tell

ZEROS = np.zeros((4, 3), np.float32)


def test_samples_are_copies():
    log = Truth()
    values = np.zeros(2)
    log.sample(0, "a", values, values, values)
    values[:] = 1
    assert not log.samples[0].counts.any()


def test_what_is_kept_may_be_gone_through_while_the_emulator_runs():
    log = Truth()
    log.sample(0, "a", ZEROS, ZEROS, ZEROS)
    log.wrote(0, "a", b"?")
    for sample, (_, device, frame) in zip(log.samples, log.frames):
        log.sample(sample.t_ns + 1, "a", ZEROS, ZEROS, ZEROS)
        log.wrote(1, device, frame)
    assert len(log.samples) == len(log.frames) == 2


def test_arrays_with_gaps_and_without_taxels_are_kept():
    log = Truth()
    grid = np.arange(24.0).reshape(4, 6)
    log.sample(0, "a", grid[:, ::2], grid.T[:3].T, np.zeros((0, 3), np.int16))
    (sample,) = log.samples
    assert np.array_equal(sample.ideal, grid[:, ::2]) and np.array_equal(sample.measured, grid[:, :3])
    assert sample.counts.shape == (0, 3)


def test_counters_and_the_latest():
    log = Truth(keep=0)
    tell(log)
    assert log.injected == {"flip": 2, "set": 1}
    assert log.injected_at("thumb") == {"flip": 2, "set": 1} and log.injected_at("index") == {"flip": 1}
    assert log.counts == {"sample": 5, "tx": 2, "rx": 1, "drop": 1, "inject": 3, "event": 1}
    assert not log.samples and not log.frames and log.forgotten == 7
    assert log.latest("thumb").number == 2 and log.latest("thumb", "imu").number == 2 and log.latest("none") is None
    assert log.latest("thumb").sense == "force" and log.latest_frame("thumb") == b"\x01\xff"


def test_frames_that_leave_together_count_one_by_one():
    log = Truth(keep=0)
    log.wrote(1, "pad", b"?")
    log.wrote_all(2, "pad", CanFrames.of([1, 2, 3], np.zeros((3, 8), np.uint8)))
    assert log.counts["tx"] == 4 and log.forgotten == 4 and log.latest_frame("pad").arbitration_id == 3


def test_faults_belong_to_a_skin_and_its_bus_not_to_names_that_contain_its_own():
    log = Truth()
    for device in ("pad", "pad2", "left_pad", "thumb+pad", "thumb+pad2"):
        log.inject(0, device, "flip")
    assert log.injected_at("pad") == {"flip": 2} and log.injected_at("pad2") == {"flip": 2}
    assert log.injected_at("thumb") == {"flip": 2} and log.injected_at("left_pad") == {"flip": 1}


def test_samples_are_numbered_per_device_unless_the_loop_does():
    log = Truth()
    numbers = [log.sample(t, device, ZEROS, ZEROS, ZEROS) for t, device in enumerate("aabab")]
    assert numbers == [0, 1, 0, 2, 1]
    assert log.sample(9, "a", ZEROS, ZEROS, ZEROS, number=7, sense="imu") == 7
    assert log.sample(9, "a", ZEROS, ZEROS, ZEROS) == 8


@pytest.mark.parametrize(
    ("size", "number"),
    [("256MB", 256_000_000), ("1.5 GB", 1_500_000_000), ("64MiB", 2**26), ("10k", 10_000), ("12", 12), (12, 12)],
)
def test_sizes(size, number):
    assert parse_size(size) == number


@pytest.mark.parametrize("size", ["", "MB", "-1", "1 TB", "1e9", True, 1.5, None, -3])
def test_what_is_no_size(size):
    with pytest.raises(TactemuError, match='expected a size such as "256MB"'):
        parse_size(size)


def test_memory_is_bounded_in_bytes_and_lets_the_oldest_go():
    log = Truth(keep="100kB")
    for k in range(1000):
        log.sample(k, "a", ZEROS, ZEROS, ZEROS)
        log.wrote(k, "a", bytes(8))
    kept = len(log.samples) + len(log.frames)
    assert 100 < kept < 200 and log.forgotten == 2000 - kept
    assert log.samples[-1].t_ns == log.frames[-1][0] == 999
    assert abs(log.samples[0].t_ns - log.frames[0][0]) <= 1, "the oldest goes, of either kind"


def test_the_runs_of_a_process_share_what_it_keeps(monkeypatch):
    monkeypatch.setattr("tactemu.truth.memory._PROCESS", Budget(100_000))
    old, new = Truth(), Truth()
    for k in range(200):
        old.sample(k, "a", ZEROS, ZEROS, ZEROS)
    full = len(old.samples)
    for k in range(200):
        new.sample(k, "a", ZEROS, ZEROS, ZEROS)
    assert len(old.samples) + len(new.samples) <= full and len(old.samples) < 0.7 * full < 1.4 * len(new.samples)
    del old
    for k in range(200):
        new.sample(k, "a", ZEROS, ZEROS, ZEROS)
    assert len(new.samples) > 0.6 * full, "what is gone gives its share back"


def test_a_budget_without_room():
    memory = Memory(0)
    memory.add_frame(0, "a", b"frame")
    assert not memory.frames and memory.bytes == 0 and memory.forgotten == 1


SCENE = '[truth]\nkeep = "1kB"\n[[skin]]\ndevice = "anyskin"\nreadings = "{path}"\n'


def test_a_scene_says_what_is_kept_and_whoever_runs_it_is_asked_first():
    scene = parse(SCENE.format(path="none.mcap"))
    for keep, kept in ((None, 0), ("1MB", 5)):
        truth = truth_of(scene, None, keep)
        for k in range(5):
            truth.sample(k, "a", *[np.zeros((100, 3))] * 3)
        assert len(truth.samples) == kept


def test_files_that_are_not_overwritten(tmp_path):
    played, notes, empty = tmp_path / "played.jsonl", tmp_path / "notes.jsonl", tmp_path / "empty.mcap"
    log = Truth(played)
    tell(log)
    log.close()
    notes.write_text("an hour of work")
    empty.touch()
    (tmp_path / "link.jsonl").symlink_to(played)
    scene = parse(SCENE.format(path=played))
    for name in ("played.jsonl", "link.jsonl"):
        with pytest.raises(TactemuError, match="the run reads this file and cannot overwrite it; name another"):
            truth_of(scene, tmp_path / name)
    with pytest.raises(
        TactemuError, match="was not written by tactemu and is not overwritten; remove it first, or name"
    ):
        Truth(notes)
    with pytest.raises(TactemuError, match=r"expected \.mcap or \.jsonl"):
        Truth(tmp_path / "truth.txt")
    with pytest.raises(TactemuError, match="cannot write the truth log: there is no folder"):
        truth_of(scene, tmp_path / "none" / "t.mcap")
    assert notes.read_text() == "an hour of work"
    Truth(empty).close()


def test_a_run_that_never_begins_leaves_the_older_log_alone(tmp_path):
    path = tmp_path / "t.jsonl"
    log = Truth(path)
    tell(log)
    log.close()
    before = path.read_bytes()
    Truth(path).close()
    Truth(tmp_path / "new.mcap").close()
    assert path.read_bytes() == before and [each.name for each in tmp_path.iterdir()] == ["t.jsonl"]
    again = Truth(path)
    again.begin(12)
    again.close()
    assert path.read_text() == '{"kind":"log","version":2,"origin_ns":12,"ends":true}\n{"kind":"end","lost":0}\n'
