"""The command line. ``tactemu --help`` imports neither warp nor trimesh nor can: each command imports what it runs."""

from __future__ import annotations

import sys


def main() -> None:
    """Entry point of ``tactemu``. A mistake of the user's is one message on stderr and exit code 2."""
    from tactemu.cli.app import app
    from tactemu.errors import TactemuError

    try:
        app()
    except TactemuError as error:
        print(f"tactemu: {error}", file=sys.stderr)
        sys.exit(2)
