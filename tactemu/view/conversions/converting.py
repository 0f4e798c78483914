"""Conversion of a truth log to a file of another format, written completely or not at all."""

from __future__ import annotations

import importlib
import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Protocol

from tactemu.base.errors import TactemuError, nearest
from tactemu.base.files import move_into_place
from tactemu.truth.entries import BodyPose, End, Entry, Header, Sample, belongs_to
from tactemu.truth.export import EXPORT_SUFFIXES, export
from tactemu.truth.log_reader import records

CONVERTERS = {
    "foxglove.mcap": "tactemu.view.conversions.foxglove:FoxgloveFile",
    "ros2.mcap": "tactemu.view.conversions.ros2:Ros2File",
    "rrd": "tactemu.view.conversions.rerun:RerunFile",
    "parquet": "tactemu.view.conversions.parquet:ParquetFiles",
}
"""The class of each format of other tools, by the suffix of its files."""
FORMATS = (*CONVERTERS, *(suffix.removeprefix(".") for suffix in EXPORT_SUFFIXES))
"""All formats that a log can be converted to; :mod:`tactemu.truth.export` writes those that are no converter's."""
EXTRA = "pip install 'tactemu[convert]'"


class Converter(Protocol):
    """A writer of one format, entry by entry."""

    def __init__(self, target: Path): ...

    def begin(self, header: Header) -> None:
        """Write what the format has before the first entry."""
        ...

    def add(self, entry: Entry) -> None:
        """Write the next entry."""
        ...

    def finish(self) -> None:
        """Close the file."""
        ...


def convert(
    path: str | Path,
    to: str,
    *,
    skin: str | None = None,
    sense: str | None = None,
    watch: Callable[[Iterable], Iterable] = iter,
) -> tuple[int, list[Path]]:
    """Write a log in another format.

    Args:
        path: the log.
        to: a format, for a file beside the log with its name, or a file name that ends in a format.
        skin: a skin; default: all.
        sense: one of its senses; default: all. ``.csv`` has one, by default the first.
        watch: an iterator that the log's records pass through, to show progress.

    Returns:
        The number of entries or rows written, and the files.

    Raises:
        TactemuError: the log or the format does not exist, its library is missing, or the file cannot be written.
    """
    path = Path(path)
    kind, target = _target(path, to)
    if kind not in CONVERTERS:
        return export(path, target, skin=skin, sense=sense), [target]
    if target.exists() and path.exists() and target.samefile(path):
        raise TactemuError(f"{target}: is the log itself; name another file")
    maker = converter_class(kind)
    chosen = _chosen(watch(records(path)), skin, sense)
    try:
        with tempfile.TemporaryDirectory(dir=target.parent, prefix=".tactemu-") as folder:
            count = _written(maker(Path(folder) / target.name), chosen)
            if not count:
                raise TactemuError(
                    f"{path}: nothing{f' of {skin!r}' if skin else ' in it'}{f' and {sense!r}' if sense else ''}"
                )
            made = sorted(Path(folder).iterdir())
            for each in made:
                move_into_place(each, target.parent / each.name)
    except OSError as error:
        raise TactemuError(f"{target}: cannot write it: {error.strerror or error}") from None
    return count, [target.parent / each.name for each in made]


def converter_class(kind: str) -> type[Converter]:
    """Return the class of a format.

    Raises:
        TactemuError: its library is not installed.
    """
    module, _, name = CONVERTERS[kind].partition(":")
    try:
        return getattr(importlib.import_module(module), name)
    except ModuleNotFoundError as error:
        raise TactemuError(f"{kind} needs the package {error.name}: {EXTRA}") from None


def _target(path: Path, to: str) -> tuple[str, Path]:
    """Return the format and the file that ``to`` names."""
    if to in FORMATS:
        return to, path.with_name(f"{path.stem}.{to}")
    for kind in FORMATS:
        if to.endswith(f".{kind}"):
            return kind, Path(to)
    raise TactemuError(f"cannot convert to {to!r}{nearest(to, FORMATS)}; expected one of {', '.join(FORMATS)}")


def _chosen(found: Iterable, skin: str | None, sense: str | None) -> Iterator[Header | Entry]:
    for record in found:
        if isinstance(record, Header):
            yield record
        elif not isinstance(record, End) and belongs_to(record, skin):
            if sense is None or not isinstance(record, Sample) or record.sense == sense:
                yield record


def _written(converter: Converter, found: Iterator[Header | Entry]) -> int:
    """Write all entries, and return their number without body poses."""
    count, begun = 0, False
    try:
        for record in found:
            if isinstance(record, Header) or not begun:
                converter.begin(record if isinstance(record, Header) else Header())
                begun = True
            if not isinstance(record, Header):
                converter.add(record)
                count += not isinstance(record, BodyPose)
    finally:
        converter.finish()
    return count
