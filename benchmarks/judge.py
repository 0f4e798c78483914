"""Trials of the judge a minute, alone and two in parallel: ``python -m benchmarks judge``.

The driver is a correct reader of forty lines, so that the figures are those of the judge.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tactemu.judge.sweep import Job, sweep

READER = """
import json, os, struct, sys, tty, select
line = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
tty.setraw(line)
head, data = bytes.fromhex("aa07080a"), b""
while True:
    if not select.select([line], [], [], 0.4)[0]:
        print("nothing comes", file=sys.stderr, flush=True)
        continue
    try:
        more = os.read(line, 4096)
    except OSError:
        more = b""
    if not more:
        sys.exit("port lost")
    data += more
    while len(data) >= 16:
        if data[:4] != head:
            at = data.find(head, 1)
            data = data[at:] if at > 0 else data[-3:]
            if at < 0:
                break
            continue
        packet, data = data[:16], data[16:]
        if sum(packet[:14]) & 0xFFFF != int.from_bytes(packet[14:], "big"):
            print("bad sum", file=sys.stderr, flush=True)
            data = packet[4:] + data
            continue
        number, status, x, y, z = struct.unpack(">HHhhh", packet[4:14])
        print(json.dumps({"n": number, "status": status, "fx": x, "fy": y, "fz": z}), flush=True)
"""


def run(say: Callable[[str], object], *, runs: int = 4, workers: bool = True) -> dict[str, Any]:
    """Judge the reader alone, then two at once; if Dask is installed, also by its workers."""
    figures: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        script = Path(folder) / "reader.py"
        script.write_text(READER)
        command = (sys.executable, str(script), "{port}")
        jobs = [Job("reader", "optoforce", command, seed) for seed in range(runs)]
        for name, more in {"one": {"at_once": 1}, "two": {"at_once": 2}}.items():
            figures[name] = _measured(
                jobs[: runs // 2 if name == "one" else runs], Path(folder) / f"{name}.parquet", more
            )
            say(f"{name} at once: {figures[name]['trials_per_minute']:.0f} trials/min, {figures[name]['failed']} fail")
        if workers and _has_dask():
            from distributed import LocalCluster

            for count in (1, 2):
                made: Any = LocalCluster(n_workers=count, threads_per_worker=1, dashboard_address=":0")
                with made as cluster:
                    out = Path(folder) / f"dask{count}.parquet"
                    some = jobs[: runs // 2 if count == 1 else runs]
                    figures[f"dask {count}"] = _measured(some, out, {"cluster": cluster.scheduler_address})
                say(f"{count} Dask workers: {figures[f'dask {count}']['trials_per_minute']:.0f} trials/min")
    for name, pair in {"here": ("one", "two"), "Dask": ("dask 1", "dask 2")}.items():
        if pair[1] in figures:
            ratio = figures[pair[1]]["trials_per_minute"] / figures[pair[0]]["trials_per_minute"]
            figures[f"ratio {name}"] = ratio
            say(f"two against one, {name}: {ratio:.2f}")
    return figures


def _measured(jobs: list[Job], out: Path, more: dict[str, Any]) -> dict[str, Any]:
    began = time.monotonic()
    rows = sweep(jobs, out, **more)
    seconds = time.monotonic() - began
    tried = [row for row in rows if not row["verdict"].startswith("not tried")]
    failed = sum(bool(row["fails"]) for row in rows)
    return {"seconds": seconds, "trials": len(tried), "trials_per_minute": 60 * len(tried) / seconds, "failed": failed}


def _has_dask() -> bool:
    import importlib.util

    return importlib.util.find_spec("distributed") is not None
