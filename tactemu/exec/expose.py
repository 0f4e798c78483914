"""TCP ports that are forwarded between the machine's network and that of a view with CAN buses.

If a program of the machine serves on the port when the view starts, the view can reach it; else the port of the machine
leads into the view.
"""

from __future__ import annotations

import asyncio
import contextlib
import re
import socket
import threading
from collections.abc import Callable
from typing import Any

from tactemu.base.errors import TransportError, reason_of

_HERE = "127.0.0.1"
_CHUNK = 65_536


def parsed(text: str) -> int:
    """Return the port of ``tcp:PORT``.

    Raises:
        TransportError: the text is not a port.
    """
    match = re.fullmatch(r"tcp:(\d{1,5})", text)
    if match is None or not 0 < int(match[1]) < 65_536:
        raise TransportError(f"--expose {text}: expected tcp:PORT, such as tcp:11311")
    return int(match[1])


class Exposed:
    """A forwarded port, with a thread of its own.

    Args:
        ask: sends a request to the keeper.
        port: the port on the loopback of both networks.

    Raises:
        TransportError: the port is taken.
    """

    def __init__(self, ask: Callable[..., tuple[dict[str, Any], list[int]]], port: int):
        self._ask, self.port = ask, port
        self.to_machine = _has_server(port)
        """True if a program of the machine serves on the port; else a program in the view may."""
        listener = self._socket_in_view("listen", port=port) if self.to_machine else _listen(port)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, args=(listener,), name=f"tcp:{port}", daemon=True)
        self._thread.start()

    def __str__(self) -> str:
        there = "the machine's, from the view" if self.to_machine else "the view's, from the machine"
        return f"tcp:{self.port} is {there}"

    def close(self) -> None:
        """Close every connection. Safe to call twice."""
        if not self._loop.is_closed():
            with contextlib.suppress(RuntimeError):  # the loop has just ended
                self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join()

    def _socket_in_view(self, do: str, **given: Any) -> socket.socket:
        (descriptor,) = self._ask(do, **given)[1]
        return socket.socket(fileno=descriptor)

    def _run(self, listener: socket.socket) -> None:
        asyncio.set_event_loop(self._loop)
        with contextlib.closing(self._loop), listener:
            self._loop.run_until_complete(asyncio.start_server(self._carry, sock=listener))
            self._loop.run_forever()
            for task in asyncio.all_tasks(self._loop):
                task.cancel()
            self._loop.run_until_complete(self._loop.shutdown_asyncgens())

    async def _carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Forward bytes between a client and the server until one of them closes."""
        other = socket.socket() if self.to_machine else self._socket_in_view("socket")
        other.setblocking(False)
        try:
            await self._loop.sock_connect(other, (_HERE, self.port))
        except OSError:  # no server yet: the client finds the connection closed
            other.close()
            writer.close()
            return
        back, forth = await asyncio.open_connection(sock=other)
        await asyncio.gather(_copy(reader, forth), _copy(back, writer))
        for each in (writer, forth):
            each.close()


async def _copy(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with contextlib.suppress(OSError):
        while data := await reader.read(_CHUNK):
            writer.write(data)
            await writer.drain()
        writer.write_eof()


def _has_server(port: int) -> bool:
    with socket.socket() as tried:
        tried.settimeout(1.0)
        return tried.connect_ex((_HERE, port)) == 0


def _listen(port: int) -> socket.socket:
    try:
        return socket.create_server((_HERE, port))
    except OSError as error:
        raise TransportError(f"--expose tcp:{port}: {reason_of(error)}; choose another port") from None
