"""Consoles for the messages of long commands: a terminal gets lines that fit, a pipe or a file gets whole lines."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table
from rich.text import Text

from tactemu.cli.fitting import breaks_lines


def message_console() -> Console:
    """Return a console on stderr that breaks lines only where :func:`~tactemu.cli.fitting.breaks_lines` says so."""
    console = Console(stderr=True, highlight=False)
    console.soft_wrap = not breaks_lines(console.file)
    return console


def print_row(console: Console, head: Text, text: str, style: str = "") -> None:
    """Print a row of two columns; if its text is too long for the line, it goes on below itself.

    Args:
        console: from :func:`message_console`.
        head: the first column.
        text: the second column, without markup.
        style: the style of the text.
    """
    line = Text.assemble(head, " ", (text, style))
    if console.soft_wrap:
        console.print(line)
        return
    grid = Table.grid(padding=(0, 1))
    grid.add_column(no_wrap=True)
    grid.add_column(overflow="fold")
    grid.add_row(head, Text(text, style))
    console.print(grid)
