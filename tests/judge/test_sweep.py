"""Tests of sweeps: plans, the journal, lost runs that are repeated, and two workers of Dask."""

import json
import os
import signal

import pytest

from tactemu.base.errors import TactemuError
from tactemu.base.jobs import Journal
from tactemu.judge import sweep as sweeping
from tactemu.judge.sweep import Job, read_plan, seeds_of, sweep
from tests.judge.test_judge import NO_SUM

PLAN = """
[[driver]]
name = "mine"
devices = ["anyskin", "optoforce"]
command = ["./reader", "{port}"]
seeds = "3-5"
[[driver]]
name = "theirs"
devices = ["anyskin"]
command = ["./other", "{port}"]
options = ["--budget", "30s"]
"""


def report(fails=()):
    trial = {"name": "flipped", "verdict": "right", "fails": list(fails), "findings": [], "rows": 3, "right": 3,
             "wrong": 0, "lost": 0, "p50_ms": None, "p99_ms": 1.0, "seconds": 0.5}  # fmt: skip
    return {"trials": [trial]}


def test_a_plan(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(PLAN)
    jobs = read_plan(path)
    assert [(job.name, job.device, job.seed) for job in jobs[:4]] == [
        ("mine", "anyskin", 3), ("mine", "anyskin", 4), ("mine", "anyskin", 5), ("mine", "optoforce", 3),
    ]  # fmt: skip
    assert len(jobs) == 7 and jobs[-1].words == ("--budget", "30s") and len({job.key for job in jobs}) == 7
    assert seeds_of([1, 9]) == [1, 9]
    for wrong in ("", "driver = 3", "[[driver]]\nname = 'x'", PLAN.replace('"3-5"', '"a-b"'), "["):
        path.write_text(wrong)
        with pytest.raises(TactemuError, match="plan"):
            read_plan(path)


def test_a_plan_goes_on_where_it_was_interrupted(tmp_path, monkeypatch):
    pytest.importorskip("pyarrow")
    jobs, ran = [Job("d", "optoforce", ("x",), seed) for seed in range(4)], []

    def run_job(job):
        if job.seed == 2 and len(ran) < 3:
            raise KeyboardInterrupt
        ran.append(job.seed)
        return report(["wrong"] if job.seed == 1 else [])

    monkeypatch.setattr(sweeping, "run_job", run_job)
    out = tmp_path / "out.parquet"
    with pytest.raises(KeyboardInterrupt):
        sweep(jobs, out, at_once=1)
    journal = out.with_suffix(".jsonl")
    with journal.open("a") as file:
        file.write('{"key": "cut o')
    before = len(ran)
    rows = sweep(jobs, out, at_once=1)
    assert [row["seed"] for row in rows] == [0, 1, 2, 3] and [row["fails"] for row in rows] == ["", "wrong", "", ""]
    assert len(ran) <= before + 4 and before >= 2 and ran[:2] == [0, 1]
    import pyarrow.parquet as pq

    assert pq.read_table(out).column("seed").to_pylist().count(1) == 1 and len(Journal(journal, "rows").results) == 4


def test_a_run_that_gives_nothing_is_trouble_not_silence(tmp_path):
    pytest.importorskip("pyarrow")
    job = Job("none", "no_such_device", ("true", "{port}"))
    (row,) = sweep([job], tmp_path / "x.parquet", at_once=1)
    assert row["fails"] == "trouble" and "no_such_device" in row["verdict"]


@pytest.mark.nightly
@pytest.mark.timeout(600)
def test_workers_of_dask_lose_no_run_and_say_the_same(tmp_path):
    distributed = pytest.importorskip("distributed")
    command = tuple(NO_SUM)
    jobs = [Job("nosum", "optoforce", command, seed, ("--only=flipped",)) for seed in range(4)]
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster:
        killed = []

        def report_progress(text):
            if not killed:  # one is killed in the midst of its second run
                killed.append(next(iter(cluster.workers.values())).pid)
                os.kill(killed[0], signal.SIGKILL)

        rows = sweep(jobs, tmp_path / "d.parquet", cluster=cluster.scheduler_address, report_progress=report_progress)
        assert killed[0] not in {worker.pid for worker in cluster.workers.values()}, "it was killed, and another began"
    assert sorted({row["seed"] for row in rows}) == [0, 1, 2, 3]
    assert {(row["trial"], row["fails"]) for row in rows} == {("clean", ""), ("flipped", "wrong")}
    assert json.loads(json.dumps(rows))
