"""Access control of the page: viser's server behind a token, for known hosts and origins only.

viser serves every client that finds its port: it checks neither path nor origin, listens on all addresses, takes the
next port when one is taken, and any client may ask it for a public address. :func:`behind_gate` replaces, while viser
creates its server, the one function that it listens with; each request, for the page or a WebSocket, then passes a
:class:`Gate` first.
"""

from __future__ import annotations

import asyncio
import contextlib
import gzip
import hmac
import http
import logging
import math
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec
import viser
import websockets.asyncio.server
import websockets.exceptions
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from tactemu.base.errors import TactemuError
from tactemu.view.page.page_script import SCRIPT
from tactemu.view.page.page_style import STYLE

MAX_VIEWERS = 16
MAX_MESSAGE_BYTES = 65_536
"""Maximum size of a viewer's message."""
ACCEPTED_MESSAGES = frozenset(
    {
        "CommandTriggerMessage", "GuiButtonHoldMessage", "GuiFormDirtyMessage", "GuiFormSubmitMessage",
        "GuiUpdateMessage", "LocalStorageGetItemResponseMessage",
        "SceneNodeClickMessage", "SceneNodeDragMessage", "ViewerCameraMessage",
    }
)  # fmt: skip
"""The types of messages that viewers may send. Uploads, renders and requests for a public address are not among them.
"""
_POLICY = (
    "default-src 'self' data: blob: 'unsafe-inline' 'unsafe-eval'; connect-src 'self' data: blob: ws://{host}; "
    "form-action 'none'; base-uri 'none'; frame-ancestors 'none'"
)
_MIN_LINE_INTERVAL_S = 1.0


class BadMessage(Exception):
    """A viewer sent a message that the page would not send."""


class Gate:
    """The check that every request and every message of a viewer passes.

    Args:
        listener: the socket, bound and listening.
        hosts: the host names that a request may name, beside the address that it reaches.
        token: the beginning of the path.
        title: the title of the page.
        say: receives one line for each refusal.
    """

    def __init__(
        self, listener: socket.socket, hosts: Sequence[str], token: str, title: str, say: Callable[[str], None]
    ):
        self.listener, self.token, self._say = listener, token, say
        self.port = listener.getsockname()[1]
        self._hosts = tuple(hosts)
        self.is_installed = False
        self.is_server_ready = False
        """True once viser's server is complete; it listens before that."""
        self.viewers = 0
        self._last_line_s = -math.inf
        page = Path(viser.__file__).parent / "client" / "build" / "index.html"
        head, mark, tail = page.read_text(encoding="utf-8").partition("<title>Viser</title>")
        if not mark:
            raise TactemuError(f"the page of viser {viser.__version__} is not supported; {INSTALL_TESTED}")
        ours = f"<title>{title}</title><script>{SCRIPT}</script><style>{STYLE}</style>"
        self._page = gzip.compress(f"{head}{ours}{tail}".encode())

    def say(self, text: str) -> None:
        """Report a line, at most one a second, so that repeated requests do not fill the terminal."""
        if time.monotonic() - self._last_line_s > _MIN_LINE_INTERVAL_S:
            self._last_line_s = time.monotonic()
            self._say(text)

    # -- a request ---------------------------------------------------------------------------------------------------

    def answer_request(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return the page, a refusal, or None for a WebSocket that may be opened."""
        path = request.path.partition("?")[0]
        is_websocket = "upgrade" in request.headers
        host = request.headers.get_all("Host")
        if why := self._refusal(request, path, is_websocket, connection.local_address[0]):
            self.say(f"refused a request: {why}")
            return _answer(http.HTTPStatus.NOT_FOUND, b"not found")
        if path.rstrip("/") != f"/{self.token}":
            return _answer(http.HTTPStatus.NOT_FOUND, b"not found")
        if is_websocket:
            return None
        return _answer(
            http.HTTPStatus.OK,
            self._page,
            **{
                "Content-Type": "text/html; charset=utf-8",
                "Content-Encoding": "gzip",
                "Content-Security-Policy": _POLICY.format(host=host[0]),
            },
        )

    def _refusal(self, request: Request, path: str, is_websocket: bool, reached: str) -> str | None:
        """Return why a request is refused (host, origin, token), or None; ``reached`` is the address it arrived at."""
        hosts, origins = (request.headers.get_all(name) for name in ("Host", "Origin"))
        ours = [f"[{host}]:{self.port}" if ":" in host else f"{host}:{self.port}" for host in (*self._hosts, reached)]
        if len(hosts) != 1 or hosts[0].lower() not in ours:
            return f"the host {', '.join(hosts)[:100]!r} is not one of this page"
        if (origins or is_websocket) and [each.lower() for each in origins] != [f"http://{hosts[0].lower()}"]:
            return f"the origin {', '.join(origins)[:100]!r} is not this page"
        given = path.strip("/").partition("/")[0]
        if not hmac.compare_digest(given.encode(), self.token.encode()):
            return "the path does not begin with the token"
        return None

    # -- a viewer ----------------------------------------------------------------------------------------------------

    async def serve_viewer(self, handler: Callable[[ServerConnection], Any], connection: ServerConnection) -> None:
        """Let viser serve a viewer as long as all messages pass :func:`check_message`."""
        if self.viewers >= MAX_VIEWERS:
            self.say(f"a viewer was refused: the page has {MAX_VIEWERS} already")
            await connection.close(1013, f"the page has {MAX_VIEWERS} viewers already")
            return
        while not self.is_server_ready:
            await asyncio.sleep(0.02)
        receive = connection.recv

        async def checked(*args: Any, **kwargs: Any) -> Any:
            message = await receive(*args, **kwargs)
            check_message(message)
            return message

        connection.recv = checked  # type: ignore[method-assign]
        self.viewers += 1
        try:
            await handler(connection)
        except websockets.exceptions.ConnectionClosed:
            pass
        except Exception as error:  # an error of one viewer's connection must not reach the others
            self.say(f"a viewer was closed: {str(error) or type(error).__name__:.200}")
            await connection.close(1008, "the message was not valid")
        finally:
            self.viewers -= 1


def check_message(message: Any) -> None:
    """Raise for a message that the page would not send.

    Raises:
        BadMessage: it is no message, or of a type that is not accepted.
    """
    try:
        said = msgspec.msgpack.decode(message) if isinstance(message, bytes) else None
    except (msgspec.MsgspecError, ValueError, RecursionError):
        said = None
    if not isinstance(said, dict) or not isinstance(said.get("type"), str):
        raise BadMessage("it sent bytes that are no message")
    if said["type"] not in ACCEPTED_MESSAGES:
        raise BadMessage(f"messages of type {said['type'][:60]!r} are not accepted")
    if said["type"] == "GuiUpdateMessage" and not _is_value(said.get("updates")):
        raise BadMessage("it set a control to an invalid value")


def _is_value(updates: Any) -> bool:
    """Return True if the update is a finite number, a boolean, a short text, or a short list of these."""
    if not isinstance(updates, dict) or updates.keys() != {"value"}:
        return False
    value = updates["value"]
    few = value if isinstance(value, list) and len(value) <= 16 else [value]
    return all(
        (isinstance(each, str) and len(each) <= 1000) or (isinstance(each, int | float) and math.isfinite(each))
        for each in few
    )


def _answer(status: http.HTTPStatus, body: bytes, **headers: str) -> Response:
    """Return a response that is not cached, and that does not pass the token on as a referrer."""
    fixed = {
        "Content-Length": str(len(body)),
        "Cache-Control": "no-store",
        "Referrer-Policy": "no-referrer",
        "X-Content-Type-Options": "nosniff",
        "Connection": "close",
    }
    return Response(status.value, status.phrase, Headers({"Content-Type": "text/plain"} | fixed | headers), body)


INSTALL_TESTED = 'install the tested version: pip install "tactemu[web]"'


@contextlib.contextmanager
def behind_gate(gate: Gate) -> Iterator[None]:
    """Make the :class:`viser.ViserServer` that is created in this context listen on the gate's socket, behind the gate.

    Raises:
        TactemuError: this version of viser opens its port in another way.
    """
    listen = websockets.asyncio.server.serve
    quiet = logging.getLogger("tactemu.view.page")
    quiet.addHandler(logging.NullHandler())
    quiet.propagate = False

    def serve(handler: Callable[[ServerConnection], Any], *_: Any, **options: Any) -> Any:
        gate.is_installed = True
        wanted = {name: options[name] for name in ("compression", "subprotocols", "select_subprotocol")}
        return listen(
            lambda connection: gate.serve_viewer(handler, connection),
            sock=gate.listener, process_request=gate.answer_request, max_size=MAX_MESSAGE_BYTES, max_queue=16,
            server_header=None, logger=quiet, **wanted,
        )  # fmt: skip

    websockets.asyncio.server.serve = serve  # type: ignore[assignment,misc]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = listen  # type: ignore[misc]
    if not gate.is_installed:
        raise TactemuError(f"viser {viser.__version__} opens its port in an unsupported way; {INSTALL_TESTED}")
