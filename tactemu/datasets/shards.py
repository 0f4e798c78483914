"""Shards: Parquet files of some steps of some environments, written beside the simulation."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactemu.datasets.order import SHARD_BYTES, Order

FOLDER = "readings"


@dataclass(frozen=True)
class Column:
    """A column beside ``env``, ``step`` and ``t_ns``."""

    name: str
    shape: tuple[int, ...]
    """Of one row."""
    unit: str
    meaning: str
    dtype: str = "float32"

    @property
    def row_bytes(self) -> int:
        """Of one row, before compression."""
        return int(np.prod(self.shape)) * np.dtype(self.dtype).itemsize


@dataclass(frozen=True)
class Shard:
    """Rows ``first_row`` to ``end_row`` of environments ``first_env`` to ``end_env``."""

    first_env: int
    end_env: int
    first_row: int
    end_row: int

    def path(self, folder: Path) -> Path:
        """Where it is."""
        strand = f"envs-{self.first_env:06d}-{self.end_env - 1:06d}"
        return folder / FOLDER / strand / f"rows-{self.first_row:08d}-{self.end_row - 1:08d}.parquet"


def shards_of(order: Order, columns: list[Column], first: int, end: int) -> list[Shard]:
    """The shards of the environments ``first`` to ``end``, in the order in which they are written."""
    row_bytes = 16 + sum(column.row_bytes for column in columns)
    rows = max(1, SHARD_BYTES // (row_bytes * (end - first)))
    return [Shard(first, end, k, min(k + rows, order.rows)) for k in range(0, order.rows, rows)]


class Rows:
    """Room for the rows of a shard, filled while it is simulated."""

    def __init__(self, columns: list[Column], shard: Shard):
        self.shard, self._columns = shard, columns
        n_envs, n_rows = shard.end_env - shard.first_env, shard.end_row - shard.first_row
        self._values = {each.name: np.empty((n_rows, n_envs, *each.shape), each.dtype) for each in columns}
        self._step, self._t_ns = np.empty((n_rows, n_envs), np.int32), np.empty((n_rows, n_envs), np.int64)

    def put(self, row: int, step: int, t_ns: int, values: Iterator[tuple[str, np.ndarray]]) -> None:
        """The readings of one row of all environments."""
        k = row - self.shard.first_row
        self._step[k], self._t_ns[k] = step, t_ns
        for name, array in values:
            self._values[name][k] = array

    def write(self, path: Path, compression: str) -> None:
        """Write all of it; the file is there once it is whole."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        shard = self.shard
        envs = np.broadcast_to(np.arange(shard.first_env, shard.end_env, dtype=np.int32), self._step.shape)
        fields = [pa.field("env", pa.int32()), pa.field("step", pa.int32()), pa.field("t_ns", pa.int64())]
        arrays: list[Any] = [pa.array(values.reshape(-1)) for values in (envs, self._step, self._t_ns)]
        for column in self._columns:
            flat = pa.array(self._values[column.name].reshape(-1))
            size = int(np.prod(column.shape))
            about = {"shape": " ".join(map(str, column.shape)), "unit": column.unit, "meaning": column.meaning}
            field = pa.field(column.name, pa.list_(flat.type, size), metadata=about)
            arrays.append(pa.FixedSizeListArray.from_arrays(flat, type=field.type))
            fields.append(field)
        table = pa.Table.from_arrays(arrays, schema=pa.schema(fields))
        path.parent.mkdir(parents=True, exist_ok=True)
        begun = path.with_suffix(".begun")
        pq.write_table(table, begun, compression=compression, use_dictionary=False)
        begun.replace(path)


class Writer:
    """Writes shards, and after each what the simulation was then, by a thread of its own.

    Args:
        folder: of the dataset.
        compression: of the shards.
    """

    def __init__(self, folder: Path, compression: str):
        self._folder, self._compression = folder, compression
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="shards")
        self._writing: Future[None] | None = None

    def put(self, rows: Rows, state: Mapping[str, Any]) -> None:
        """Write a shard; waits for the one before.

        Raises:
            OSError: that could not be written.
        """
        self.wait()
        self._writing = self._pool.submit(self._write, rows, state)

    def wait(self) -> None:
        """Until all is written."""
        if self._writing is not None:
            self._writing.result()
            self._writing = None

    def close(self) -> None:
        """End the thread, once it has written what it has."""
        self._pool.shutdown()

    def _write(self, rows: Rows, state: Mapping[str, Any]) -> None:
        path = rows.shard.path(self._folder)
        rows.write(path, self._compression)
        save(state, path.parent / STATE)


STATE = "state.npz"


def save(state: Mapping[str, Any], path: Path) -> None:
    """Keep a simulation's state (:meth:`tactemu.Simulation.state`) and the row it is at; whole, or as it was."""
    counts = {name: np.int64(value) for name, value in state.items() if name != "memory"}
    arrays = {f"memory{k}": array for k, array in enumerate(state["memory"])}
    begun = path.with_suffix(".begun")
    with begun.open("wb") as file:
        np.savez(file, **counts, **arrays)
        file.flush()
        os.fsync(file.fileno())
    begun.replace(path)


def saved(path: Path) -> dict[str, Any] | None:
    """What :func:`save` kept; ``None``: nothing is there."""
    if not path.exists():
        return None
    with np.load(path, allow_pickle=False) as file:
        memory = [file[f"memory{k}"] for k in range(sum(name.startswith("memory") for name in file.files))]
        counts = {name: int(file[name]) for name in file.files if not name.startswith("memory")}
    return counts | {"memory": memory}
