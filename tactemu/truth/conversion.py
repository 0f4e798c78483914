"""Conversion of a truth log to a file of another format, written completely or not at all."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Protocol

from tactemu.base.errors import TactemuError, nearest, reason_of
from tactemu.base.files import check_overwriting, check_writable, move_into_place
from tactemu.base.formats import CAN_FRAMES, CONVERTIBLE, FORMATS, Format
from tactemu.truth.entries import BodyPose, End, Entry, Header
from tactemu.truth.log_reader import SkinChoice, records
from tactemu.truth.writer import log_format


class Converter(Protocol):
    """A writer of one format, entry by entry."""

    def __init__(self, target: Path): ...

    def begin(self, header: Header) -> None:
        """Write what the format has before the first entry."""
        ...

    def add(self, entry: Entry) -> bool | None:
        """Write the next entry; return False for one that the format does not hold."""
        ...

    def finish(self, end: End) -> None:
        """Close the file; ``end`` is the end of the log, or an empty one after an error."""
        ...


class LogFile:
    """A truth log that is written without a thread."""

    def __init__(self, target: Path):
        self._file = target.open("wb")
        self._writer = log_format(target).load("log_writer")(self._file)

    def begin(self, header: Header) -> None:
        """Write the head."""
        self._writer.begin(header)

    def add(self, entry: Entry) -> None:
        """Write an entry."""
        for _ in self._writer.add(entry):
            pass

    def finish(self, end: End) -> None:
        """Write the summary of the run, and close the file."""
        self._writer.finish(End(summary=end.summary))
        self._file.close()


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
    form, target = _target(path, to)
    if target.exists() and path.exists() and target.samefile(path):
        raise TactemuError(f"{target}: is the log itself; name another file")
    check_writable(target, "it", form.sign)
    maker = form.load("converter")
    choice = SkinChoice(skin, sense)
    try:
        with tempfile.TemporaryDirectory(dir=target.parent, prefix=".tactemu-") as folder:
            count = _written(maker(Path(folder) / target.name), _chosen(watch(records(path)), choice))
            choice.check(path)
            if not count:
                what = f"no {form.holds}" if form.holds else "nothing"
                whose = f" of {skin!r}" if skin else " in it"
                hint = (
                    "; a .csv or .jsonl file holds the frames of every kind of line" if form.holds == CAN_FRAMES else ""
                )
                raise TactemuError(f"{path}: {what}{whose}{hint}")
            made = sorted(Path(folder).iterdir())
            for each in made:
                check_overwriting(target.parent / each.name, form.sign)
            for each in made:
                move_into_place(each, target.parent / each.name)
    except OSError as error:
        raise TactemuError(f"{target}: cannot write it: {reason_of(error, target)}") from None
    return count, [target.parent / each.name for each in made]


def _target(path: Path, to: str) -> tuple[Format, Path]:
    """Return the format and the file that ``to`` names."""
    names = [each.name for each in CONVERTIBLE]
    if to in names:
        return FORMATS[to], path.with_name(f"{path.stem}.{to}")
    if ends := [name for name in names if to.endswith(f".{name}")]:
        return FORMATS[max(ends, key=len)], Path(to)
    raise TactemuError(f"cannot convert to {to!r}{nearest(to, names)}; expected one of {', '.join(names)}")


def _chosen(found: Iterable, choice: SkinChoice) -> Iterator[Header | Entry | End]:
    for record in found:
        if isinstance(record, Header):
            yield record
        elif isinstance(record, End):
            yield record._replace(summary=[each for each in record.summary if choice.skin in (None, each["skin"])])
        elif choice.takes(record):
            yield record


def _written(converter: Converter, found: Iterator[Header | Entry | End]) -> int:
    """Write all entries, and return their number without body poses and those that the format does not hold."""
    count, has_begun, end = 0, False, End()
    try:
        for record in found:
            if isinstance(record, Header) or not has_begun:
                converter.begin(record if isinstance(record, Header) else Header())
                has_begun = True
            if isinstance(record, End):
                end = record
            elif not isinstance(record, Header):
                count += converter.add(record) is not False and not isinstance(record, BodyPose)
    finally:
        converter.finish(end)
    return count
