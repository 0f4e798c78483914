"""The command line. ``tactemu --help`` imports neither warp nor trimesh nor can: each command imports what it runs."""

from __future__ import annotations

import sys

INTERRUPTED = 130
"""What a shell gives a command that Ctrl-C has ended: 128 + SIGINT."""


def main() -> None:
    """Entry point of ``tactemu``. A mistake of the user's is one message on stderr and exit code 2."""
    try:
        from tactemu.cli.app import app
        from tactemu.errors import TactemuError

        try:
            app(prog_name="tactemu")
        except TactemuError as error:
            print(f"tactemu: {error}", file=sys.stderr)
            sys.exit(2)
    except KeyboardInterrupt:  # while things are imported, or compiled; a loop that runs takes it as its end
        sys.exit(INTERRUPTED)
