"""``.parquet``: samples for data frames, a file for each sense of each skin, arrays in their own types."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tactemu.base.errors import TactemuError
from tactemu.truth.entries import End, Entry, Header, Sample
from tactemu.truth.memory import size_of_sample

_MAX_WAITING_BYTES = 8_000_000
"""Maximum size of the samples in memory, of all files together; they become one row group in each file."""
_ARRAYS = ("ideal", "measured", "counts")


class ParquetFiles:
    """``truth.parquet`` where a log has one sense of one skin, ``truth.thumb.force.parquet`` ... where it has several.

    Columns are ``t_ns``, ``sample``, ``ideal``, ``measured``, ``counts``; the shape of an array is in the metadata of
    its field, and what the log says of the skin in those of the file.
    """

    def __init__(self, target: Path):
        self._target = target
        self._files: dict[tuple[str, str], _File] = {}
        self._waiting = 0
        self._skins: dict[str, Any] = {}

    def begin(self, header: Header) -> None:
        """Keep the descriptions of the skins for the metadata of their files."""
        self._skins = dict((header.scene or {}).get("skins", {}))

    def add(self, entry: Entry) -> None:
        """Add a row for a sample; frames and events have no rows."""
        if not isinstance(entry, Sample):
            return
        key = entry.device, entry.sense
        if key not in self._files:
            path = self._target.with_name(f".{len(self._files)}.{self._target.name}")
            self._files[key] = _File(path, entry, self._skins.get(entry.device))
        self._files[key].add(entry)
        self._waiting += size_of_sample(entry)
        if self._waiting > _MAX_WAITING_BYTES:
            self._flush()

    def finish(self, end: End) -> None:
        """Write the waiting samples, and give the files their names."""
        self._flush()
        for (device, sense), file in self._files.items():
            file.close()
            words = [re.sub(r"[^\w+-]", "_", each) for each in (device, sense) if each and len(self._files) > 1]
            file.path.rename(self._target.with_name(".".join([self._target.stem, *words, "parquet"])))

    def _flush(self) -> None:
        self._waiting = 0
        for file in self._files.values():
            file.flush()


class _File:
    """Samples of one shape."""

    def __init__(self, path: Path, first: Sample, skin: Any):
        self.path, self._first = path, first
        self._samples: list[Sample] = []
        fields = [pa.field("t_ns", pa.int64()), pa.field("sample", pa.int64())]
        for name in _ARRAYS:
            values = np.asarray(getattr(first, name))
            kind = pa.list_(pa.from_numpy_dtype(values.dtype.newbyteorder("=")), values.size)
            fields.append(pa.field(name, kind, metadata={"shape": " ".join(map(str, values.shape))}))
        about = {"device": first.device, "sense": first.sense, "skin": json.dumps(skin)}
        self._schema = pa.schema(fields, metadata={f"tactemu.{key}": value for key, value in about.items()})
        self._writer = pq.ParquetWriter(path, self._schema, use_dictionary=False)

    def add(self, sample: Sample) -> None:
        for name in _ARRAYS:
            shape, before = getattr(sample, name).shape, getattr(self._first, name).shape
            if shape != before:
                raise TactemuError(
                    f"{sample.device}: {name} changed its shape from {before} to {shape} while it ran, "
                    "which a column of fixed size cannot have; convert to csv or mcap"
                )
        self._samples.append(sample)

    def flush(self) -> None:
        if not self._samples:
            return
        columns = [pa.array([each.t_ns for each in self._samples]), pa.array([each.number for each in self._samples])]
        for name, field in zip(_ARRAYS, list(self._schema)[2:]):
            values = np.stack([getattr(each, name) for each in self._samples]).ravel()
            flat = pa.array(values.astype(values.dtype.newbyteorder("="), copy=False))
            columns.append(pa.FixedSizeListArray.from_arrays(flat, type=field.type))
        self._writer.write_table(pa.Table.from_arrays(columns, schema=self._schema))
        self._samples = []

    def close(self) -> None:
        self._writer.close()
