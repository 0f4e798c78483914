"""Lines of output that fit the terminal: paragraphs are filled again, rows of tables go on below their last column."""

from __future__ import annotations

import os
import re
import shutil
import sys
import textwrap
from collections.abc import Iterable, Iterator
from typing import IO

PIPE_WIDTH = 160
"""Width of the output if it is no terminal and ``COLUMNS`` is not set [characters]."""
MIN_WIDTH = 80
"""Minimum width of the output; on a narrower terminal the terminal breaks the lines [characters]."""

FIGURES_INDENT = 4
"""Indent of the rest of a row whose first column takes more than half of the width [characters]."""


def output_width() -> int:
    """Return the width of the output [characters]: that of ``COLUMNS`` or of the terminal."""
    return max(shutil.get_terminal_size((PIPE_WIDTH, 24)).columns, MIN_WIDTH)


def breaks_lines(stream: IO[str]) -> bool:
    """Return True if long lines to a stream are broken: it is a terminal, or ``COLUMNS`` gives the width."""
    return stream.isatty() or "COLUMNS" in os.environ


def print_fitted(*lines: str) -> None:
    """Print lines as :func:`fitted` breaks them, if they are to be broken."""
    text = "\n".join(lines)
    print("\n".join(fitted(text.split("\n"), output_width())) if breaks_lines(sys.stdout) else text, flush=True)


def print_error(text: str) -> None:
    """Print a message on the standard error: on a terminal as :func:`fitted` breaks it, in a pipe whole."""
    lines = text.split("\n")
    print(*(fitted(lines, output_width()) if sys.stderr.isatty() else lines), sep="\n", file=sys.stderr, flush=True)


def fitted(lines: Iterable[str], width: int) -> Iterator[str]:
    """Yield lines of at most ``width`` characters, broken between words; pictures of numbers stay as they are."""
    for line in lines:
        yield from _fit([line], width)


def filled(lines: Iterable[str], width: int) -> Iterator[str]:
    """Yield the lines of a text as :func:`fitted` does, and fill its paragraphs again."""
    block: list[str] = []
    for line in [*lines, ""]:
        if block and not _goes_on(block[-1], line):
            yield from _fit(block, width)
            block = []
        block.append(line)


def cell_lines(text: str, width: int) -> list[str]:
    """Return the lines of a table's cell; a word that is longer than the column is broken behind one of ``/@_-``."""
    words = (part for word in text.split() for part in _word_parts(word, width))
    return textwrap.wrap(" ".join(words), width, break_on_hyphens=False)


def _goes_on(line: str, following: str) -> bool:
    """Return True if ``following`` continues the paragraph of ``line``."""
    is_text = all(text.strip() and not _columns(text) for text in (line, following))
    return is_text and _indent(line) == _indent(following)


def _fit(block: list[str], width: int) -> Iterator[str]:
    """Yield the lines of a paragraph, or of one row of a table, which has at least :data:`MIN_WIDTH`."""
    columns = _columns(block[0])
    width = max(width, MIN_WIDTH) if columns else width
    if all(len(line) <= width for line in block) or not re.search("[A-Za-z]", block[0]):
        yield from block
        return
    starts = [at for at in columns if at <= width // 2]
    hanging = starts[-1] if starts else _indent(block[0]) + (FIGURES_INDENT if columns else 0)
    text = block[0] + "".join(f" {line.strip()}" for line in block[1:])
    yield from textwrap.wrap(
        text, width, subsequent_indent=" " * hanging, break_long_words=False, break_on_hyphens=False
    )


def _columns(line: str) -> list[int]:
    """Return the places at which columns of a table's row start; the first column is not one of them."""
    return [found.end() for found in re.finditer(r"(?<=\S) {2,}(?=\S)", line)]


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip())


def _word_parts(word: str, width: int) -> Iterator[str]:
    """Yield the parts of a word, each as long as the column permits."""
    part = ""
    for piece in re.findall(r"[^/@_-]*[/@_-]?", word) if len(word) > width else [word]:
        if part and len(part + piece) > width:
            yield part
            part = ""
        part += piece
    yield part
