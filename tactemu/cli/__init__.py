"""The command line. Each command imports what it runs; the help and the list of devices do without the parser.

``python tests/test_readme.py --write`` writes the files that they are read from, and a test holds these true.
"""

from __future__ import annotations

import os
import shutil
import sys
from contextlib import nullcontext

HELP = os.path.join(os.path.dirname(__file__), "help.txt")
HELP_COLUMNS = 80
"""From this width of the terminal on the help is as the file has it."""
INTERRUPTED = 130
"""What a shell gives a command that Ctrl-C has ended: 128 + SIGINT."""
OUTPUT_CLOSED = 141
"""What a shell gives a command whose output nobody reads any more: 128 + SIGPIPE."""
EXEC_FAILED = 125
"""What ``tactemu exec`` ends with when something of its own fails."""


def main() -> None:
    """Entry point of ``tactemu``. A mistake of the user's is one message on stderr and exit code 2."""
    try:
        try:
            if _answered(sys.argv[1:]):
                return
            if sys.argv[1:2] in (["run"], ["exec"]):
                from tactemu.base.gc_tuning import leave_quickly
                from tactemu.cli.forwarding import forwarded_signals
                from tactemu.cli.signals import starting

                leave_quickly()
                with starting(), forwarded_signals() if sys.argv[1] == "exec" else nullcontext():
                    _run()
            else:
                _run()
        finally:
            sys.stdout.flush()
    except BrokenPipeError:  # whoever read the output has gone, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(OUTPUT_CLOSED)
    except OSError as error:  # of the machine: a full disk, a folder that is not there, no permission
        where = f"{error.filename}: " if error.filename else ""
        print(f"tactemu: {where}{error.strerror or error}", file=sys.stderr)
        if error.filename is None:  # the output itself
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(EXEC_FAILED if sys.argv[1:2] == ["exec"] else 2)
    except KeyboardInterrupt:  # while things are imported, or compiled; a loop that runs takes it as its end
        sys.exit(INTERRUPTED)


def _run() -> None:
    """Do the command."""
    from tactemu.base.errors import TactemuError
    from tactemu.cli.app import app

    try:
        words, command = _split(sys.argv[1:])
        app(words, prog_name="tactemu", obj=command)
    except TactemuError as error:
        print(f"tactemu: {error}", file=sys.stderr)
        sys.exit(2)


def _split(words: list[str]) -> tuple[list[str], list[str]]:
    """What is for the parser, and the command that ``tactemu exec`` or ``judge`` shall run."""
    at = words.index("--") if words[:1] in (["exec"], ["judge"]) and "--" in words else len(words)
    return words[:at], words[at + 1 :]


def _answered(words: list[str]) -> bool:
    """What is asked most often, and takes less time than the parser takes to be imported."""
    if words in (["--help"], ["-h"]) and shutil.get_terminal_size().columns >= HELP_COLUMNS:
        with open(HELP, encoding="utf-8") as file:
            print(file.read(), end="")
        return True
    if words in (["devices"], ["devices", "--json"]):
        from tactemu.cli.listing import print_table

        print_table(json="--json" in words)
        return True
    return False
