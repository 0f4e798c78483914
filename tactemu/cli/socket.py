"""The socket for ``tactemu poke``, around whatever runs."""

from __future__ import annotations

import sys
from contextlib import AbstractContextManager, closing, nullcontext
from pathlib import Path

from tactemu.base.errors import TransportError
from tactemu.control.endpoints import Endpoint
from tactemu.control.server import Driven, Server


def control_socket(
    driven: Driven, name: str | None, target: str, *, yield_to_loop: bool = True
) -> AbstractContextManager:
    """Listen under a name, or the target's; where there can be no socket, that is said, unless its name was asked for.

    Raises:
        TactemuError: the name that was asked for cannot be had.
    """
    place = Endpoint(name or Path(target.rpartition(":")[2]).stem, target, exactly=name is not None)
    try:
        return closing(Server(place, driven, yield_to_loop=yield_to_loop))
    except TransportError as error:
        if name is not None:
            raise
        print(f"tactemu: `tactemu poke` will not find this run: {error}", file=sys.stderr)
        return nullcontext()
