"""Sweeps: many runs of the judge over drivers, devices and seeds, on this machine's cores or on a cluster.

Each run is a process of its own, so that a crashing driver does not stop the others. Results are appended to a journal
beside the Parquet file; an interrupted plan continues from it, and a run whose worker is lost is repeated.
"""

from __future__ import annotations

import itertools
import json
import os
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from tactemu.base.errors import TactemuError, reason_of
from tactemu.base.files import check_writable
from tactemu.base.formats import PARQUET
from tactemu.base.jobs import Journal, run_on_cluster

RUN_TIMEOUT_S = 3600.0
"""Time after which a run is ended [s]."""


@dataclass(frozen=True)
class Job:
    """One run of the judge."""

    name: str
    """The name of the driver or of its version."""
    device: str
    command: tuple[str, ...]
    seed: int = 0
    words: tuple[str, ...] = ()
    """More options of ``tactemu judge``."""

    @property
    def key(self) -> str:
        """The key of a finished run in the journal."""
        return json.dumps([self.name, self.device, list(self.command), self.seed, list(self.words)])


def read_plan(path: Path) -> list[Job]:
    """Return the runs of a TOML file: ``[[driver]]`` tables with ``name``, ``devices``, ``command``, ``seeds``.

    Raises:
        TactemuError: the file cannot be read or is no plan.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        if "skin" in content and "driver" not in content:
            raise TactemuError(
                f"{path}: this is a scene file, not a plan; a plan has [[driver]] tables, as `tactemu sweep --help` "
                f"shows (one driver: `tactemu judge {path} -- COMMAND`)"
            )
        tables = content.get("driver", [])
        jobs = [
            Job(table["name"], device, tuple(table["command"]), seed, tuple(table.get("options", ())))
            for table in tables
            for device, seed in itertools.product(table["devices"], seeds_of(table.get("seeds", 0)))
        ]
    except OSError as error:
        raise TactemuError(f"{path}: cannot read the plan: {reason_of(error)}") from None
    except KeyError as error:
        raise TactemuError(
            f"{path}: a [[driver]] table lacks the key {error}; expected name, devices, command, seeds"
        ) from None
    except (ValueError, TypeError, AttributeError) as error:
        raise TactemuError(f"{path}: not a plan: {error}; expected [[driver]] name, devices, command, seeds") from None
    if not jobs:
        raise TactemuError(f"{path}: the plan has no runs; add a [[driver]] table with devices and seeds")
    return jobs


def seeds_of(text: str | int | Sequence[int]) -> list[int]:
    """Return the seeds of ``7``, ``"0-9"`` or a list.

    Raises:
        ValueError: the text has another form.
    """
    if isinstance(text, int):
        return [text]
    if not isinstance(text, str):
        return [int(seed) for seed in text]
    first, dash, last = text.partition("-")
    return list(range(int(first), int(last) + 1)) if dash else [int(first)]


def run_job(job: Job) -> dict[str, Any]:
    """Run the judge in a process of its own, and return its report as data; an error is in ``trouble``."""
    with tempfile.TemporaryDirectory(prefix="tactemu-judge-") as folder:
        out = Path(folder) / "report.json"
        command = [
            sys.executable, "-m", "tactemu", "judge", job.device, "--seed", str(job.seed), "--json", str(out),
            *job.words, "--", *job.command,
        ]  # fmt: skip
        try:
            done = subprocess.run(
                command, check=False, capture_output=True, text=True, timeout=RUN_TIMEOUT_S, stdin=subprocess.DEVNULL
            )
        except subprocess.TimeoutExpired:
            return {"trouble": f"took longer than {RUN_TIMEOUT_S:g} s"}
        if out.exists():
            return json.loads(out.read_text())
        return {"trouble": done.stderr.strip()[:500] or f"exit status {done.returncode}"}


def rows_of(job: Job, report: dict[str, Any]) -> list[dict[str, Any]]:
    """Return a row for each trial of a run."""
    same = {"driver": job.name, "device": job.device, "seed": job.seed, "key": job.key}
    if report.get("trouble"):
        return [{**same, "trial": "", "verdict": report["trouble"], "fails": "trouble"}]
    return [
        {
            **same, "trial": trial["name"], "verdict": trial["verdict"], "fails": ",".join(trial["fails"]),
            "findings": ",".join(finding["kind"] for finding in trial["findings"]), "rows": trial["rows"],
            "right": trial["right"], "wrong": trial["wrong"], "lost": trial["lost"], "p50_ms": trial["p50_ms"],
            "p99_ms": trial["p99_ms"], "seconds": trial["seconds"],
        }
        for trial in report["trials"]
    ]  # fmt: skip


def write_parquet(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Write rows to a Parquet file.

    Raises:
        TactemuError: pyarrow is missing.
    """
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        raise TactemuError("Parquet needs pyarrow: pip install 'tactemu[convert]'") from None
    pq.write_table(pa.Table.from_pylist(list(rows)), path)


def sweep(
    jobs: Sequence[Job],
    results: Path,
    *,
    at_once: int | None = None,
    cluster: str | None = None,
    report_progress: Callable[[str], object] = lambda text: None,
) -> list[dict[str, Any]]:
    """Run the jobs that are not in the journal yet; write all rows to a Parquet file and return them.

    Args:
        jobs: the runs.
        results: path of the Parquet file; the journal is beside it.
        at_once: parallel runs on this machine; default: one for each core, so that each can keep real time.
        cluster: address of a Dask scheduler, whose workers run one job at a time each.
        report_progress: called when a run is finished.

    Raises:
        TactemuError: a library is missing, or the cluster cannot be reached.
    """
    check_writable(results, "the results", PARQUET)
    journal = Journal(results.with_suffix(".jsonl"), "rows")
    left = [job for job in jobs if job.key not in journal.results]
    if len(left) < len(jobs):
        report_progress(f"{len(jobs) - len(left)} of {len(jobs)} runs are in the journal already")
    finished = _on_cluster(left, cluster) if cluster else _on_this_machine(left, at_once or os.cpu_count() or 1)
    for job, report in finished:
        rows = rows_of(job, report)
        journal.add(job.key, rows)
        failed = [row["trial"] or row["verdict"] for row in rows if row["fails"]]
        report_progress(f"{job.name} {job.device} seed {job.seed}: {', '.join(failed) or 'nothing fails'}")
    write_parquet([row for rows in journal.results.values() for row in rows], results)
    return [row for job in jobs for row in journal.results.get(job.key, [])]


def _on_this_machine(jobs: Sequence[Job], at_once: int) -> Iterator[tuple[Job, dict[str, Any]]]:
    with ThreadPoolExecutor(max_workers=at_once) as pool:
        running = {pool.submit(run_job, job): job for job in jobs}
        try:
            while running:
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    yield running.pop(future), future.result()
        finally:
            for future in running:
                future.cancel()


def _on_cluster(jobs: Sequence[Job], address: str) -> Iterator[tuple[Job, dict[str, Any]]]:
    """Yield the jobs with their reports as the workers of a cluster finish them."""
    for job, result in run_on_cluster({job: partial(run_job, job) for job in jobs}, address):
        try:
            yield job, result()
        except Exception as error:  # such as a driver that ends every worker
            yield job, {"trouble": f"{type(error).__name__}: {error}"}
