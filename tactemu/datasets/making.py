"""A whole dataset: what it will take, its strands one after another or on a cluster, the wire, and the data sheet."""

from __future__ import annotations

import importlib.util
import shutil
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

from tactemu.base.errors import TactemuError
from tactemu.datasets.dataset_card import data_sheet
from tactemu.datasets.partition import Partition, whole_scene
from tactemu.datasets.spec import DatasetSpec, remember
from tactemu.datasets.variety import Starts
from tactemu.datasets.wire import path_of, write_wire

SHEET = "README.md"
RETRIES = 3
"""Of a job whose worker is lost."""


@dataclass(frozen=True)
class Estimate:
    """What a dataset will take."""

    data_bytes: int
    """Of all shards before compression: at most so much."""
    seconds: float
    """To simulate and fill them in here, one strand after another; writing goes on beside it."""
    shards: int

    def __str__(self) -> str:
        return f"{self.shards} shards, at most {size(self.data_bytes)}, about {duration(self.seconds)} of simulation"


def duration(seconds: float) -> str:
    """Return seconds in words."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    hours, minutes = divmod(round(seconds / 60), 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min"


def size(n_bytes: float) -> str:
    """Return bytes in words."""
    for unit in ("B", "kB", "MB", "GB"):
        if n_bytes < 1000:
            return f"{n_bytes:.0f} {unit}" if n_bytes >= 100 or unit == "B" else f"{n_bytes:.1f} {unit}"
        n_bytes /= 1000
    return f"{n_bytes:.1f} TB"


def begin(order: DatasetSpec, folder: Path) -> Estimate:
    """Build the first strand, estimate what all takes, and write down what is made, with its data sheet.

    Raises:
        TactemuError: the scene cannot be had, the disk cannot hold it, or the folder holds something else.
    """
    if importlib.util.find_spec("pyarrow") is None:
        raise TactemuError("shards are Parquet, which needs pyarrow: pip install 'tactemu[convert]'")
    loaded = whole_scene(order)
    varied = Starts(loaded, order).names
    partition = Partition(order, *order.ranges[0])
    with partition.simulation:
        row = 16 + sum(column.row_bytes for column in partition.columns)
        n_shards = len(partition.shards) * order.strands
        share = (order.ranges[0][1] - order.ranges[0][0]) / order.envs
        estimate = Estimate(row * order.rows * order.envs, partition.timed() * order.rows / share, n_shards)
    place = folder
    while not place.exists():
        place = place.parent
    free, there = shutil.disk_usage(place).free, sum(each.stat().st_size for each in folder.rglob("*.parquet"))
    if estimate.data_bytes > free + there:
        raise TactemuError(
            f"{folder}: {size(free)} are free on that disk, and the dataset takes up to {size(estimate.data_bytes)}: "
            "fewer --envs or --steps, or a row only --every few steps"
        )
    about = {
        "scene": loaded.tables.model_dump(mode="json", by_alias=True, exclude_defaults=True),
        "columns": [asdict(column) for column in partition.columns],
        "dt_s": partition.simulation.dt,
        "row_s": partition.simulation.dt * order.every,
        "varied": varied,
    }
    remember(order, about, folder)
    (folder / SHEET).write_text(data_sheet(order, partition.columns, partition.simulation.dt, varied), encoding="utf-8")
    return estimate


def make(order: DatasetSpec, folder: Path, cluster: str | None = None) -> Iterator[int]:
    """Make all that is not there yet; says how many more shards are done each time.

    Raises:
        TactemuError: the simulation went wrong, or no cluster answers.
        OSError: the disk.
    """
    missing = [env for env in range(order.bytes_envs) if not path_of(folder, env).exists()]
    if cluster is not None:
        file, there = Path(order.target), folder.resolve()
        elsewhere = replace(order, target=str(file.resolve())) if file.is_file() else order
        jobs = [partial(_partition, elsewhere, k, there) for k in range(order.strands)]
        yield from _on_cluster([*jobs, *(partial(_wire, elsewhere, env, there) for env in missing)], cluster)
        return
    for first, end in order.ranges:
        for _ in Partition(order, first, end).write(folder):
            yield 1
    for env in missing:
        yield _wire(order, env, folder)


def _partition(order: DatasetSpec, k: int, folder: Path) -> int:
    """Return one strand, on a machine that reaches the folder; returns how many shards it has."""
    return sum(1 for _ in Partition(order, *order.ranges[k]).write(folder))


def _wire(order: DatasetSpec, env: int, folder: Path) -> int:
    write_wire(order, env, folder)
    return 0


def _on_cluster(jobs: list[Callable[[], int]], address: str) -> Iterator[int]:
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise TactemuError("a cluster needs Dask: pip install 'tactemu[cluster]'") from None
    try:
        client = Client(address, timeout=10)
    except (OSError, TimeoutError, ValueError) as error:
        raise TactemuError(f"--cluster {address}: no scheduler answers: {error}") from None
    with client:
        for future in as_completed([client.submit(job, pure=False, retries=RETRIES) for job in jobs]):
            yield future.result()
