"""Generation of a dataset: estimate, card, partitions (one after another or on a cluster) and wire logs."""

from __future__ import annotations

import importlib.util
import shutil
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

from tactemu.base.errors import TactemuError
from tactemu.base.files import check_folder
from tactemu.base.jobs import run_on_cluster
from tactemu.datasets.dataset_card import dataset_card
from tactemu.datasets.partition import Partition, load_scene
from tactemu.datasets.spec import DatasetSpec, write_spec
from tactemu.datasets.start_poses import StartPoses
from tactemu.datasets.wire_logs import path_of, write_wire_log

CARD_FILE = "README.md"


@dataclass(frozen=True)
class Estimate:
    """The disk space and time that a dataset needs."""

    data_bytes: int
    """Upper limit of the size of all shards before compression [byte]."""
    seconds: float
    """Time to simulate and buffer all rows here, one partition after another [s]; shards are written in parallel."""
    shards: int

    def __str__(self) -> str:
        return f"{self.shards} shards, at most {size(self.data_bytes)}, about {duration(self.seconds)} of simulation"


def duration(seconds: float) -> str:
    """Return a time as text, in s, min or h."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    hours, minutes = divmod(round(seconds / 60), 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min"


def size(n_bytes: float) -> str:
    """Return a size as text, in B to TB."""
    for unit in ("B", "kB", "MB", "GB"):
        if n_bytes < 1000:
            return f"{n_bytes:.0f} {unit}" if n_bytes >= 100 or unit == "B" else f"{n_bytes:.1f} {unit}"
        n_bytes /= 1000
    return f"{n_bytes:.1f} TB"


def begin(spec: DatasetSpec, folder: Path) -> Estimate:
    """Build the first partition, estimate the whole dataset, and write its spec and its card.

    Raises:
        TactemuError: the scene cannot be loaded, the disk is too small, or the folder holds something else.
    """
    if importlib.util.find_spec("pyarrow") is None:
        raise TactemuError("shards are Parquet, which needs pyarrow: pip install 'tactemu[convert]'")
    check_folder(folder, "the dataset")
    loaded = load_scene(spec)
    varied = StartPoses(loaded, spec).names
    partition = Partition(spec, *spec.ranges[0])
    with partition.simulation:
        row = 16 + sum(column.row_bytes for column in partition.columns)
        n_shards = len(partition.shards) * spec.partitions
        share = (spec.ranges[0][1] - spec.ranges[0][0]) / spec.envs
        estimate = Estimate(row * spec.rows * spec.envs, partition.timed() * spec.rows / share, n_shards)
    place = folder
    while not place.exists():
        place = place.parent
    free, there = shutil.disk_usage(place).free, sum(each.stat().st_size for each in folder.rglob("*.parquet"))
    if estimate.data_bytes > free + there:
        raise TactemuError(
            f"{folder}: {size(free)} are free on that disk, and the dataset takes up to {size(estimate.data_bytes)}; "
            "reduce --envs or --steps, or raise --every to store fewer rows"
        )
    about = {
        "scene": loaded.tables.model_dump(mode="json", by_alias=True, exclude_defaults=True),
        "columns": [asdict(column) for column in partition.columns],
        "dt_s": partition.simulation.dt,
        "row_s": partition.simulation.dt * spec.every,
        "varied": varied,
    }
    write_spec(spec, about, folder)
    card = dataset_card(spec, partition.columns, partition.simulation.dt, varied)
    (folder / CARD_FILE).write_text(card, encoding="utf-8")
    return estimate


def make(spec: DatasetSpec, folder: Path, cluster: str | None = None) -> Iterator[int]:
    """Generate everything that is missing; yield the number of shards finished since the last value.

    Raises:
        TactemuError: the simulation fails, or the cluster does not answer.
        OSError: a file cannot be written.
    """
    missing = [env for env in range(spec.bytes_envs) if not path_of(folder, env).exists()]
    if cluster is not None:
        file, there = Path(spec.target), folder.resolve()
        elsewhere = replace(spec, target=str(file.resolve())) if file.is_file() else spec
        jobs = [partial(_partition, elsewhere, k, there) for k in range(spec.partitions)]
        jobs += [partial(_wire, elsewhere, env, there) for env in missing]
        for _, shards in run_on_cluster(dict(enumerate(jobs)), cluster):
            yield shards()
        return
    for first, end in spec.ranges:
        for _ in Partition(spec, first, end).write(folder):
            yield 1
    for env in missing:
        yield _wire(spec, env, folder)


def _partition(spec: DatasetSpec, k: int, folder: Path) -> int:
    """Generate one partition, on a machine that reaches the folder, and return its number of shards."""
    return sum(1 for _ in Partition(spec, *spec.ranges[k]).write(folder))


def _wire(spec: DatasetSpec, env: int, folder: Path) -> int:
    write_wire_log(spec, env, folder)
    return 0
