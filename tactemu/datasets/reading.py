"""Reading of a dataset's shards as NumPy arrays."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tactemu.base.errors import TactemuError, no_such
from tactemu.datasets.shards import FOLDER
from tactemu.datasets.spec import FILE


def read_dataset(
    folder: str | Path, columns: Sequence[str] | None = None, envs: Sequence[int] | None = None
) -> dict[str, np.ndarray]:
    """Return columns of a dataset as arrays, with a row for each environment at each time.

    Args:
        folder: of the dataset that ``tactemu dataset`` generated.
        columns: names as the dataset card lists them; ``None``: all. ``env``, ``step`` and ``t_ns`` are always there.
        envs: numbers of the environments to read; ``None``: all.

    Returns:
        An array of shape ``(rows, *shape)`` by column name. Within a partition, rows are sorted by time and then by
        environment.

    Raises:
        TactemuError: there is no dataset or no such column, or pyarrow is not installed.
    """
    try:
        import pyarrow.dataset as ds
    except ImportError:
        raise TactemuError("shards are Parquet, which needs pyarrow: pip install 'tactemu[convert]'") from None
    folder = Path(folder)
    paths = sorted((folder / FOLDER).glob("*/*.parquet"))
    if not (folder / FILE).is_file() or not paths:
        raise TactemuError(
            f"{folder}: no dataset is there, or it has no shards yet; generate it with `tactemu dataset`"
        )
    shards = ds.dataset([str(path) for path in paths])
    available = shards.schema.names
    wanted = available if columns is None else list(dict.fromkeys(("env", "step", "t_ns", *columns)))
    if missing := [name for name in wanted if name not in available]:
        raise TactemuError(f"{folder}: {no_such('column', missing[0], available)}")
    chosen = None if envs is None else ds.field("env").isin(list(envs))
    table = shards.to_table(columns=wanted, filter=chosen)
    found = {}
    for name in wanted:
        column, about = table[name], shards.schema.field(name).metadata or {}
        if b"dtype" not in about:
            found[name] = column.to_numpy()
            continue
        dtype, shape = np.dtype(about[b"dtype"].decode()), tuple(map(int, about[b"shape"].split()))
        parts = [_numbers(chunk, dtype, shape) for chunk in column.chunks]
        found[name] = np.concatenate(parts) if parts else np.empty((0, *shape), dtype)
    return found


def _numbers(chunk, dtype: np.dtype, shape: tuple[int, ...]) -> np.ndarray:
    size = int(np.prod(shape))
    flat = np.frombuffer(chunk.buffers()[1], dtype, len(chunk) * size, chunk.offset * size * dtype.itemsize)
    return flat.reshape(-1, *shape)
