"""The command line. Each command imports what it runs; the help and the list of devices need no parser.

``python tests/test_readme.py --write`` writes the files with the help and the list; a test compares them.
"""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from contextlib import nullcontext
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from typing import Any

HELP = os.path.join(os.path.dirname(__file__), "help.txt")
HELP_COLUMNS = 80
"""Minimum width of a terminal for the help of the file; on a narrower one the parser wraps it."""
INTERRUPTED = 130
"""The exit code of a command that Ctrl-C has ended: 128 + SIGINT."""
OUTPUT_CLOSED = 141
"""The exit code of a command whose output is closed: 128 + SIGPIPE."""
EXEC_FAILED = 125
"""The exit code of ``tactemu exec`` when tactemu itself fails."""


def main() -> None:
    """Run the command line ``tactemu``. An error of the user is one message on stderr and exit code 2."""
    try:
        try:
            if _answer_without_parser(sys.argv[1:]):
                return
            if sys.argv[1:2] in (["run"], ["exec"]):
                from tactemu.base.gc_tuning import command_collections
                from tactemu.cli.forwarding import forwarded_signals
                from tactemu.cli.signals import starting

                with command_collections(), starting(), forwarded_signals() if sys.argv[1] == "exec" else nullcontext():
                    _run()
            else:
                _run()
        finally:
            sys.stdout.flush()
    except BrokenPipeError:  # the reader of the output has ended, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(OUTPUT_CLOSED)
    except OSError as error:  # such as a full disk, a missing folder, no permission
        from tactemu.base.errors import reason_of
        from tactemu.cli.fitting import print_error

        where = error.filename or "cannot write the output"
        print_error(f"tactemu: {where}: {reason_of(error, error.filename)}")
        if error.filename is None:  # the output itself
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(EXEC_FAILED if sys.argv[1:2] == ["exec"] else 2)
    except KeyboardInterrupt:  # during imports or compilation; a running loop handles it as its end
        sys.exit(INTERRUPTED)


def _show_progress(items: Iterable[Any], title: str, total: int) -> Iterable[Any]:
    from tactemu.cli.progress import show_progress

    return show_progress(items, title, total)


def _run() -> None:
    """Parse the command line and run its command."""
    from tactemu.base.errors import TactemuError
    from tactemu.base.long_work import show_long_work

    show_long_work(_show_progress)
    try:
        words, command = _split(sys.argv[1:])
        _application(words)(words, prog_name="tactemu", obj=command)
    except TactemuError as error:
        from tactemu.cli.fitting import print_error

        print_error(f"tactemu: {error}")
        sys.exit(2)


def _application(words: list[str]) -> Callable[..., None]:
    """Return the application; for a command that starts an emulator without the other commands, which take 50 ms."""
    if words[:1] not in (["run"], ["exec"]):
        from tactemu.cli.app import app

        return app
    from tactemu.cli import running
    from tactemu.cli.root import new_application

    app = new_application()
    app.add_typer(running.commands)
    return app


def _split(words: list[str]) -> tuple[list[str], list[str]]:
    """Return the words for the parser, and the command that ``tactemu exec`` or ``judge`` runs."""
    if words[:1] == ["run"] and "--" in words[2:]:
        from tactemu.base.errors import TactemuError

        raise TactemuError(f"run starts no command; write: {shlex.join(['tactemu', 'exec', *words[1:]])}")
    at = words.index("--") if words[:1] in (["exec"], ["judge"]) and "--" in words else len(words)
    return words[:at], words[at + 1 :]


def _answer_without_parser(words: list[str]) -> bool:
    """Answer the help and the list of devices without importing the parser, and return True if it was one of them."""
    if words in (["--help"], ["-h"]) and shutil.get_terminal_size().columns >= HELP_COLUMNS:
        with open(HELP, encoding="utf-8") as file:
            print(file.read(), end="")
        return True
    if words in (["devices"], ["devices", "--json"]):
        from tactemu.cli.listing import print_table

        print_table(json="--json" in words)
        return True
    return False
