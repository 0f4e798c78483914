"""The formats of truth logs, recordings and conversions, by suffix: what reads, writes and converts to each.

A format is a file of code and a line of :data:`FORMATS`: `tactemu truth --to`, `record`, `replay` and their help texts
follow from it. Its parts are named as ``module:name`` and imported on first use, because some need a library of an
extra, and because the command line shows its help without NumPy.
"""

from __future__ import annotations

import importlib
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from tactemu.base.errors import TactemuError, nearest

CAN_FRAMES = "CAN frames"
PARQUET = "PAR1"
"""The first bytes of every Parquet file; those of other programs have them too."""
_CAN = "tactemu.truth.can_formats"
_CSV = "samples, one a row; read: CAN frames of python-can"
_VIEW = "tactemu.view.conversions"


@dataclass(frozen=True)
class Format:
    """A format of files."""

    name: str
    """The suffix of its files, without the first dot."""
    about: str
    """A description of the content."""
    holds: str = ""
    """The entries that it holds, ``samples`` or :data:`CAN_FRAMES`; empty: all."""
    reader: str = ""
    """The function that yields the entries of a file, given its path."""
    log_writer: str = ""
    """The class that writes a truth log while it happens, piece by piece (``tactemu/truth/writer.py``)."""
    converter: str = ""
    """The class that writes entries one by one (:class:`tactemu.truth.conversion.Converter`)."""
    sign: str = ""
    """A text among the first bytes of each file of this format that tactemu writes, and of few others."""
    extra: str = ""
    """The extra of this package that installs its library."""

    @property
    def suffix(self) -> str:
        """The suffix of its files, with the dot."""
        return f".{self.name}"

    @property
    def install(self) -> str:
        """The command that installs its library."""
        return f"pip install 'tactemu[{self.extra}]'"

    def load(self, part: Literal["reader", "log_writer", "converter"]) -> Any:
        """Return a part.

        Raises:
            TactemuError: its library is not installed.
        """
        module, _, name = getattr(self, part).partition(":")
        try:
            return getattr(importlib.import_module(module), name)
        except ModuleNotFoundError as error:
            if not self.extra:
                raise
            raise TactemuError(f"{self.name} needs the package {error.name}: {self.install}") from None


def _log(name: str, about: str, sign: str) -> Format:
    module = f"tactemu.truth.{name}_format"
    log_writer = f"{module}:{name.capitalize()}Writer"
    return Format(name, about, "", f"{module}:read", log_writer, "tactemu.truth.conversion:LogFile", sign)


def _view(name: str, about: str, converter: str, sign: str) -> Format:
    return Format(name, about, converter=f"{_VIEW}.{converter}", sign=sign, extra="convert")


def _can(name: str, about: str, converter: str = "", reader: str = "read_can", sign: str = "") -> Format:
    return Format(name, about, CAN_FRAMES, f"{_CAN}:{reader}", "", converter and f"{_CAN}:{converter}", sign)


FORMATS = {
    each.name: each
    for each in (
        _view("foxglove.mcap", "Foxglove's schemas", "foxglove:FoxgloveFile", "foxglove-sdk"),
        _view("ros2.mcap", "ROS 2's message types: ros2 bag play, RViz, PlotJuggler", "ros2:Ros2File", "tactemu"),
        _view("rrd", "a recording for Rerun, with a layout", "rerun:RerunFile", "tactemu"),
        _view("parquet", "samples for data frames", "parquet:ParquetFiles", PARQUET),
        Format("csv", _CSV, "samples", f"{_CAN}:read_can", "", "tactemu.truth.csv_format:CsvFile", "t_ns,sample,"),
        _can("log", "CAN frames in candump's format", "CandumpFile", "read_candump", ") can0 "),
        _can("asc", "CAN frames in Vector's text format", "PythonCanFile", sign="timestamps absolute"),
        _can("blf", "CAN frames in Vector's binary format", "PythonCanFile", sign="LOGG"),
        _log("mcap", "a truth log as messages of ROS 2, in the container format of robotics", "tactemu"),
        _log("jsonl", "a truth log as JSON lines", '"kind"'),
        _can("dump", "CAN frames in candump's format", reader="read_candump"),
        _can("candump", "CAN frames in candump's format", reader="read_candump"),
        _can("trc", "CAN frames in PEAK's format"),
        _can("mf4", "CAN frames in ASAM's format"),
    )
}
"""All formats; `--to` and messages list them in this order. As ``.csv``, CAN frames of python-can are read."""

LOGS = tuple(each for each in FORMATS.values() if each.log_writer)
"""The formats of a truth log; recordings have them, too."""
READABLE = (*LOGS, *(each for each in FORMATS.values() if each.reader and each not in LOGS))
"""The formats that `tactemu replay` reads."""
CONVERTIBLE = tuple(each for each in FORMATS.values() if each.converter)
"""The formats that `tactemu truth --to` writes."""
RECORDABLE = (*LOGS, *(each for each in CONVERTIBLE if each.holds == CAN_FRAMES))
"""The formats that `tactemu record` writes."""


def format_of(path: Path, formats: Collection[Format], refusal: str) -> Format:
    """Return the format of a file among these, by the last part of its name.

    Raises:
        TactemuError: it has none of them.
    """
    form = FORMATS.get(path.suffix[1:])
    if form is None or form not in formats:
        near = nearest(path.suffix, [each.suffix for each in formats])
        raise TactemuError(f"{path}: {refusal}{near}; expected {names(formats, dot='.')}")
    return form


def names(formats: Iterable[Format], last: str = "or", dot: str = "") -> str:
    """Return the names of formats for a sentence: ``asc, blf or log``."""
    *first, end = [f"{dot}{each.name}" for each in formats]
    return f"{', '.join(first)} {last} {end}" if first else end
