"""The thread behind the loop: bounded, never in the way, and honest about what it lost."""

import logging
import resource
import threading
import time

import numpy as np
import pytest

import tactemu as tt
from tactemu.truth import Sample, Truth, entries, mcap_format, writer
from tactemu.truth.jsonl_format import JsonlWriter
from tactemu.truth.mcap_format import McapWriter

SUFFIXES = [".mcap", ".jsonl"]


def log_samples(log: Truth, n: int, start: int = 0) -> None:
    """Log samples that cannot be compressed."""
    for k in range(start, start + n):
        log.sample(k, "a", *np.random.default_rng(k).normal(size=(3, 100, 3)))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_full_disk_is_said_at_once_and_the_run_goes_on(tmp_path, suffix, caplog):
    """Write to the kernel's own full disk."""
    (tmp_path / f"t{suffix}").symlink_to("/dev/full")
    log = Truth(tmp_path / f"t{suffix}", keep="10MB")
    log_samples(log, 100)
    deadline = time.monotonic() + 10
    while not caplog.records and time.monotonic() < deadline:
        time.sleep(0.01)
    assert "cannot write the log: No space left on device" in caplog.records[0].getMessage()
    log_samples(log, 50)
    log.close()
    assert log.lost == 150 and len(log.samples) == 150 and len(caplog.records) == 1


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_is_in_the_file_and_what_is_lost_is_all(tmp_path, suffix, caplog):
    """Write to a disk with room for a part of the log."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    log = Truth(tmp_path / f"t{suffix}")
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, limits[1]))
        log_samples(log, 400)
        log.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    saved = [entry.t_ns for entry in entries(tmp_path / f"t{suffix}")]
    assert saved == list(range(len(saved))) and 20 < len(saved) < 400
    assert len(saved) + log.lost == 400
    assert [record.levelno for record in caplog.records] == [logging.ERROR, logging.WARNING], "not written; cut off"


class Slow(McapWriter):
    """A disk that takes its time."""

    gate = threading.Event()

    def add(self, entry):
        self.gate.wait()
        return super().add(entry)


def test_a_slow_disk_loses_entries_which_the_log_counts(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(writer, "MAX_WAITING_BYTES", 100_000)
    monkeypatch.setattr(mcap_format, "McapWriter", Slow)
    monkeypatch.setattr(Slow, "gate", threading.Event())
    log = Truth(tmp_path / "t.mcap")
    log_samples(log, 100)
    Slow.gate.set()
    while log._writers[0].waiting:
        time.sleep(0.01)
    log_samples(log, 3, start=100)
    log.close()
    back = tt.read_log(tmp_path / "t.mcap")
    assert 50 < log.lost == back.lost == 103 - len(back["a"].t_ns) < 100
    assert back["a"].sample[-3:].tolist() == [100, 101, 102], "a gap in the numbers shows what is missing"
    assert len(caplog.records) == 1 and "entries are lost from" in caplog.text


class BusyMachine:
    """A clock on which work costs 10 us a look, and each rest lasts 10 ms longer than it should."""

    def __init__(self):
        self.now_s = self.rested_s = 0.0

    def perf_counter(self):
        self.now_s += 1e-5
        return self.now_s

    def sleep(self, seconds):
        self.now_s += seconds + 0.01
        self.rested_s += seconds + 0.01


def test_the_thread_has_its_share_of_a_busy_machine(tmp_path, monkeypatch):
    """Pause too long, as on a busy machine; the thread must not fall behind by the length of the run."""
    log = writer.LogWriter(tmp_path / "t.jsonl")
    log._format = JsonlWriter(log._file)
    for k in range(100):
        log.put(Sample(k, "a", *np.zeros((2, 1000, 3), np.float32), np.zeros(1000, int), k), 32_000)
    clock = BusyMachine()
    monkeypatch.setattr(writer, "time", clock)
    log._write_waiting()
    worked_s = clock.now_s - clock.rested_s
    assert worked_s > 0.1 and clock.rested_s < 15 * worked_s
    log.close()


def test_where_time_is_virtual_the_loop_waits_instead(tmp_path, monkeypatch):
    monkeypatch.setattr(writer, "MAX_WAITING_BYTES", 10_000)
    log = Truth(tmp_path / "t.jsonl")
    log.begin(block_when_full=True)
    log_samples(log, 100)
    log.close()
    assert log.lost == 0 and len(tt.read_log(tmp_path / "t.jsonl")["a"].t_ns) == 100


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_log_whose_process_is_killed_has_all_but_the_last_moments(tmp_path, suffix, monkeypatch):
    monkeypatch.setattr(writer, "_MAX_UNSAVED_S", 0.0)
    path, copy = tmp_path / f"t{suffix}", tmp_path / f"copy{suffix}"
    log = Truth(path)
    log_samples(log, 10)
    deadline, found = time.monotonic() + 10, 0
    while found < 10 and time.monotonic() < deadline:
        time.sleep(0.02)
        copy.write_bytes(path.read_bytes())
        found = len(list(entries(copy))) if copy.stat().st_size > 200 else 0
    log.close()
    assert found == 10


def test_an_entry_that_cannot_be_written_ends_the_log_not_the_run(tmp_path, caplog):
    log = Truth(tmp_path / "t.jsonl")
    log_samples(log, 2)
    log.event(2, "a", object())
    log_samples(log, 2)
    log.close()
    assert log.lost >= 3 and "cannot write the log: TypeError" in caplog.text


def test_the_thread_ends_with_the_log(tmp_path):
    before = set(threading.enumerate())
    log = Truth(tmp_path / "t.mcap")
    log_samples(log, 1)
    assert len(set(threading.enumerate()) - before) == 1
    log.close()
    log.close()
    assert set(threading.enumerate()) == before
