"""Shards: Parquet files of some steps of some environments, written beside the simulation."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactemu.base.files import move_into_place
from tactemu.datasets.spec import SHARD_BYTES, DatasetSpec

FOLDER = "readings"


@dataclass(frozen=True)
class Column:
    """A column beside ``env``, ``step`` and ``t_ns``."""

    name: str
    shape: tuple[int, ...]
    """The shape of one row's value."""
    unit: str
    meaning: str
    dtype: str = "float32"

    @property
    def row_bytes(self) -> int:
        """The size of one row's value before compression [byte]."""
        return int(np.prod(self.shape)) * np.dtype(self.dtype).itemsize


@dataclass(frozen=True)
class Shard:
    """Rows ``first_row`` to ``end_row - 1`` of the environments ``first_env`` to ``end_env - 1``."""

    first_env: int
    end_env: int
    first_row: int
    end_row: int

    def path(self, folder: Path) -> Path:
        """Return the path of the shard's file in a dataset's folder."""
        partition = f"envs-{self.first_env:06d}-{self.end_env - 1:06d}"
        return folder / FOLDER / partition / f"rows-{self.first_row:08d}-{self.end_row - 1:08d}.parquet"


def shards_of(spec: DatasetSpec, columns: list[Column], first: int, end: int) -> list[Shard]:
    """Return the shards of the environments ``first`` to ``end - 1``, in the order in which they are written."""
    row_bytes = 16 + sum(column.row_bytes for column in columns)
    rows = max(1, SHARD_BYTES // (row_bytes * (end - first)))
    return [Shard(first, end, k, min(k + rows, spec.rows)) for k in range(0, spec.rows, rows)]


class RowBuffer:
    """A buffer for the rows of a shard, filled during the simulation and then reused for a later shard.

    Args:
        columns: of the dataset.
        shard: the first shard; no later one is larger.
    """

    def __init__(self, columns: list[Column], shard: Shard):
        self.shard, self._columns = shard, columns
        n_envs, n_rows = shard.end_env - shard.first_env, shard.end_row - shard.first_row
        self._values = {each.name: np.empty((n_rows, n_envs, *each.shape), each.dtype) for each in columns}
        self._step, self._t_ns = np.empty((n_rows, n_envs), np.int32), np.empty((n_rows, n_envs), np.int64)

    def put(self, row: int, step: int, t_ns: int, values: Iterator[tuple[str, np.ndarray]]) -> None:
        """Store one row of all environments."""
        k = row - self.shard.first_row
        self._step[k], self._t_ns[k] = step, t_ns
        for name, array in values:
            self._values[name][k] = array

    def write(self, path: Path, compression: str) -> None:
        """Write the shard; the file appears under its name once it is complete."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        shard = self.shard
        mine = slice(0, shard.end_row - shard.first_row)
        envs = np.broadcast_to(np.arange(shard.first_env, shard.end_env, dtype=np.int32), self._step[mine].shape)
        fields = [pa.field("env", pa.int32()), pa.field("step", pa.int32()), pa.field("t_ns", pa.int64())]
        arrays: list[Any] = [pa.array(values.reshape(-1)) for values in (envs, self._step[mine], self._t_ns[mine])]
        for column in self._columns:  # as bytes: a list of numbers in Parquet is written and read ten times slower
            values, size = self._values[column.name][mine], column.row_bytes
            kind = pa.binary(size)
            arrays.append(pa.FixedSizeBinaryArray.from_buffers(kind, envs.size, [None, pa.py_buffer(values)]))
            shape = " ".join(map(str, column.shape))
            about = {"dtype": column.dtype, "shape": shape, "unit": column.unit, "meaning": column.meaning}
            fields.append(pa.field(column.name, kind, nullable=False, metadata=about))
        table = pa.Table.from_arrays(arrays, schema=pa.schema(fields))
        path.parent.mkdir(parents=True, exist_ok=True)
        begun = path.with_name(f".{path.stem}.begun")
        pq.write_table(table, begun, compression=compression, use_dictionary=False, write_statistics=False)
        move_into_place(begun, path)


class Writer:
    """A pool of threads that write shards and, after each shard, the state of the simulation at its end.

    Args:
        folder: of the dataset.
        columns: of the dataset.
        compression: of the shards.
        threads: number of threads.
    """

    def __init__(self, folder: Path, columns: list[Column], compression: str, threads: int):
        self._folder, self._columns, self._compression = folder, columns, compression
        self._pool = ThreadPoolExecutor(max_workers=threads, thread_name_prefix="shards")
        self._max_pending, self._free = threads + 1, []
        self._writing: deque[Future[RowBuffer]] = deque()

    def rows(self, shard: Shard) -> RowBuffer:
        """Return a buffer for a shard, once one is free.

        Raises:
            OSError: an earlier shard could not be written.
        """
        while self._writing and (self._writing[0].done() or len(self._writing) >= self._max_pending):
            self._free.append(self._writing.popleft().result())
        if not self._free:
            return RowBuffer(self._columns, shard)
        rows = self._free.pop()
        rows.shard = shard
        return rows

    def put(self, rows: RowBuffer, state: Mapping[str, Any]) -> None:
        """Write a shard in the background, and the state once this shard and all earlier ones are written."""
        before = self._writing[-1] if self._writing else None
        self._writing.append(self._pool.submit(self._write, rows, state, before))

    def wait(self) -> None:
        """Wait until all shards are written.

        Raises:
            OSError: a shard could not be written.
        """
        while self._writing:
            self._writing.popleft().result()

    def close(self) -> None:
        """Stop the threads once they have written their shards."""
        self._pool.shutdown()

    def _write(self, rows: RowBuffer, state: Mapping[str, Any], before: Future[RowBuffer] | None) -> RowBuffer:
        path = rows.shard.path(self._folder)
        rows.write(path, self._compression)
        if before is not None:
            before.result()
        save(state, path.parent / STATE)
        return rows


STATE = ".state.npz"
"""Hidden by its dot, as incomplete files are, from programs that read every file of a folder as Parquet."""


def save(state: Mapping[str, Any], path: Path) -> None:
    """Write a simulation's state (:meth:`tactemu.Simulation.state`) with its counters; the file is replaced at once."""
    counts = {name: np.int64(value) for name, value in state.items() if name != "memory"}
    arrays = {f"memory{k}": array for k, array in enumerate(state["memory"])}
    begun = path.with_name(f"{path.stem}.begun")
    with begun.open("wb") as file:
        np.savez(file, **counts, **arrays)
        file.flush()
        os.fsync(file.fileno())
    move_into_place(begun, path)


def saved(path: Path) -> dict[str, Any] | None:
    """Return the state that :func:`save` wrote, or None if there is no file."""
    if not path.exists():
        return None
    with np.load(path, allow_pickle=False) as file:
        memory = [file[f"memory{k}"] for k in range(sum(name.startswith("memory") for name in file.files))]
        counts = {name: int(file[name]) for name in file.files if not name.startswith("memory")}
    return counts | {"memory": memory}
