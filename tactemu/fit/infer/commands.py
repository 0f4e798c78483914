"""The run of an inference with its report and its files, for the command line."""

from __future__ import annotations

import json as json_module
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tactemu.base.errors import TactemuError, reason_of
from tactemu.base.files import check_writable
from tactemu.fit.infer.catalogue import match_catalogue
from tactemu.fit.infer.channels import PICTURE_SIGN, answers_of, read_shown, shown_fields, svg
from tactemu.fit.infer.dbc import DBC_HEAD, dbc_text
from tactemu.fit.infer.device_file import device_file
from tactemu.fit.infer.report import as_dict, report_lines
from tactemu.fit.infer.running import read_and_infer


@dataclass(frozen=True)
class InferFiles:
    """The files of an inference; None: not wanted."""

    out: Path | None = None
    """The device file."""
    dbc: Path | None = None
    picture: Path | None = None
    """The picture of the channels that answer together."""
    command: str = ""
    """The command line, which the picture shows."""


def run_infer(
    captures: Sequence[Path],
    *,
    catalogue: bool,
    shown: Path | None,
    files: InferFiles,
    json: bool,
    say: Callable[[str], None],
) -> None:
    """Infer, report and write the files that are asked for.

    Raises:
        TactemuError: a capture cannot be read, or a file cannot be written.
    """
    check_writable(files.out, "the device file", "a draft by `tactemu infer`")
    check_writable(files.dbc, "the DBC file", DBC_HEAD)
    check_writable(files.picture, "the picture", PICTURE_SIGN)
    draft, coverage = read_and_infer(captures)
    match = match_catalogue(draft) if catalogue else None
    seen = shown_fields(draft, *read_shown(shown)) if shown is not None else []
    if json:
        say(json_module.dumps({**as_dict(draft, coverage, match), "shown": seen}))
    else:
        say("\n".join(report_lines(draft, coverage, match, seen)))
    if files.dbc is not None:
        if not draft.is_can:
            raise TactemuError(f"{files.dbc}: a DBC file is of CAN frames; the capture is of a serial line")
        _write(files.dbc, dbc_text(draft))
    if files.picture is not None:
        answers = answers_of(draft)
        if answers is None:
            raise TactemuError(f"{files.picture}: nothing moves in the capture: press the taxels one by one")
        _write(files.picture, svg(answers, files.command))
    if files.out is not None:
        _write(files.out, device_file(draft, files.out, captures))
    if not json:
        for path in (files.dbc, files.picture, files.out):
            if path is not None:
                say(f"wrote {path}")
        if files.out is not None:
            named = f"{files.out}:{_class_name(files.out)}"
            say(f"next: `tactemu run {named}`; what the capture does not show is marked as assumed in the file")


def _class_name(path: Path) -> str:
    """Return the name of the device's class in a device file."""
    return re.findall(r"^class (\w+)\(Device\)", path.read_text(encoding="utf-8"), re.MULTILINE)[0]


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise TactemuError(f"{path}: cannot write it: {reason_of(error, path)}") from None
