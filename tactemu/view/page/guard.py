"""Who may look: viser's server behind a token, on hosts and from origins that we know.

viser serves whoever finds its port: it checks neither path nor origin, listens everywhere, takes the next port when one
is taken, and any client may ask it for a public address. :func:`guarded` replaces, while viser makes its server, the
one function that it listens with; what it is asked, page and WebSocket alike, goes through a :class:`Gate` first.
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

MOST_VIEWERS = 16
LARGEST = 65_536
"""Bytes of a message of a viewer."""
HEARD = frozenset(
    {
        "CommandTriggerMessage", "GuiButtonHoldMessage", "GuiFormDirtyMessage", "GuiFormSubmitMessage",
        "GuiUpdateMessage", "LocalStorageGetItemResponseMessage",
        "SceneNodeClickMessage", "SceneNodeDragMessage", "ViewerCameraMessage",
    }
)  # fmt: skip
"""What viewers may say. Not among it: uploads, renders, and the wish for a public address."""
SCHEME = "tactemu.scheme"
"""Under which a browser keeps whether its user likes it dark."""
_PREFIX = "viser-user:"
"""With which viser's page keeps them apart."""
_SCRIPT = f"""<script>
localStorage.setItem("{_PREFIX}{SCHEME}", matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
const listen = EventTarget.prototype.addEventListener;
EventTarget.prototype.addEventListener = function (type, heard, how) {{
  const stops = type.startsWith("pointer") && how && how.passive;
  return listen.call(this, type, heard, stops ? {{...how, passive: false}} : how);
}};
</script>"""
"""The page drags by listeners that it declares passive, and that then stop the event: an error in the console."""
_POLICY = (
    "default-src 'self' data: blob: 'unsafe-inline' 'unsafe-eval'; connect-src 'self' data: blob: ws://{host}; "
    "form-action 'none'; base-uri 'none'; frame-ancestors 'none'"
)
_SAY_EVERY_S = 1.0


class BadMessage(Exception):
    """A viewer said what is none."""


class Gate:
    """What is let through.

    Args:
        listener: the socket, bound and listening.
        hosts: names under which browsers may ask for it, beside the address that they reach.
        token: what the path begins with.
        title: of the page.
        say: told of what is refused, a line each.
    """

    def __init__(
        self, listener: socket.socket, hosts: Sequence[str], token: str, title: str, say: Callable[[str], None]
    ):
        self.listener, self.token, self._say = listener, token, say
        self.port = listener.getsockname()[1]
        self._hosts = tuple(hosts)
        self.fitted = False
        self.made = False
        """Whether viser's server is whole; it listens before it is."""
        self.viewers = 0
        self._said_s = -math.inf
        page = Path(viser.__file__).parent / "client" / "build" / "index.html"
        head, mark, rest = page.read_text(encoding="utf-8").partition("<title>Viser</title>")
        if not mark:
            raise TactemuError(f"viser {viser.__version__} has another page than the one we know; {PINNED}")
        self._page = gzip.compress(f"{head}<title>{title}</title>{_SCRIPT}{rest}".encode())

    def say(self, text: str) -> None:
        """A line, at most one a second: who knocks often does not fill a terminal."""
        if time.monotonic() - self._said_s > _SAY_EVERY_S:
            self._said_s = time.monotonic()
            self._say(text)

    # -- a request ---------------------------------------------------------------------------------------------------

    def asked(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return the page, a refusal, or ``None``: a WebSocket that may be opened."""
        path = request.path.partition("?")[0]
        socket_wished = "upgrade" in request.headers
        host = request.headers.get_all("Host")
        if why := self._refuses(request, path, socket_wished, connection.local_address[0]):
            self.say(f"refused a request: {why}")
            return _answer(http.HTTPStatus.NOT_FOUND, b"not found")
        if path.rstrip("/") != f"/{self.token}":
            return _answer(http.HTTPStatus.NOT_FOUND, b"not found")
        if socket_wished:
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

    def _refuses(self, request: Request, path: str, socket_wished: bool, reached: str) -> str | None:
        """Why a request is refused: host, origin, token. ``reached`` is the address that it came to."""
        hosts, origins = (request.headers.get_all(name) for name in ("Host", "Origin"))
        ours = [f"[{host}]:{self.port}" if ":" in host else f"{host}:{self.port}" for host in (*self._hosts, reached)]
        if len(hosts) != 1 or hosts[0].lower() not in ours:
            return f"host {', '.join(hosts)[:100]!r} is none of ours"
        if (origins or socket_wished) and [each.lower() for each in origins] != [f"http://{hosts[0].lower()}"]:
            return f"origin {', '.join(origins)[:100]!r} is not ours"
        given = path.strip("/").partition("/")[0]
        if not hmac.compare_digest(given.encode(), self.token.encode()):
            return "the path has not the token"
        return None

    # -- a viewer ----------------------------------------------------------------------------------------------------

    async def attended(self, handler: Callable[[ServerConnection], Any], connection: ServerConnection) -> None:
        """Have viser serve a viewer, as long as what it says is what its page says."""
        if self.viewers >= MOST_VIEWERS:
            self.say(f"a viewer was sent away: {MOST_VIEWERS} look already")
            await connection.close(1013, f"{MOST_VIEWERS} look already")
            return
        while not self.made:
            await asyncio.sleep(0.02)
        receive = connection.recv

        async def checked(*args: Any, **kwargs: Any) -> Any:
            message = await receive(*args, **kwargs)
            check(message)
            return message

        connection.recv = checked  # type: ignore[method-assign]
        self.viewers += 1
        try:
            await handler(connection)
        except websockets.exceptions.ConnectionClosed:
            pass
        except Exception as error:  # whatever it was: it is that viewer's, and no other's
            self.say(f"a viewer was closed: {str(error) or type(error).__name__:.200}")
            await connection.close(1008, "that was no message")
        finally:
            self.viewers -= 1


def check(message: Any) -> None:
    """Refuse what the page does not say.

    Raises:
        BadMessage: it is no message, or none that is heard here.
    """
    try:
        said = msgspec.msgpack.decode(message) if isinstance(message, bytes) else None
    except (msgspec.MsgspecError, ValueError, RecursionError):
        said = None
    if not isinstance(said, dict) or not isinstance(said.get("type"), str):
        raise BadMessage("what it sent is no message")
    if said["type"] not in HEARD:
        raise BadMessage(f"{said['type'][:60]!r} is not heard here")
    if said["type"] == "GuiUpdateMessage" and not _is_value(said.get("updates")):
        raise BadMessage("it set what is no value")


def _is_value(updates: Any) -> bool:
    """Return a number that is one, a truth value, a short text, or a few of these."""
    if not isinstance(updates, dict) or updates.keys() != {"value"}:
        return False
    value = updates["value"]
    few = value if isinstance(value, list) and len(value) <= 16 else [value]
    return all(
        (isinstance(each, str) and len(each) <= 1000) or (isinstance(each, int | float) and math.isfinite(each))
        for each in few
    )


def _answer(status: http.HTTPStatus, body: bytes, **headers: str) -> Response:
    """Return a response that is kept nowhere, and that tells nobody else the token."""
    fixed = {
        "Content-Length": str(len(body)),
        "Cache-Control": "no-store",
        "Referrer-Policy": "no-referrer",
        "X-Content-Type-Options": "nosniff",
        "Connection": "close",
    }
    return Response(status.value, status.phrase, Headers({"Content-Type": "text/plain"} | fixed | headers), body)


PINNED = 'install the one that is tested: pip install "tactemu[web]"'


@contextlib.contextmanager
def guarded(gate: Gate) -> Iterator[None]:
    """While a :class:`viser.ViserServer` is made in it, that server listens on the gate's socket and behind it.

    Raises:
        TactemuError: this version of viser listens in another way.
    """
    listen = websockets.asyncio.server.serve
    quiet = logging.getLogger("tactemu.view.page")
    quiet.addHandler(logging.NullHandler())
    quiet.propagate = False

    def serve(handler: Callable[[ServerConnection], Any], *_: Any, **options: Any) -> Any:
        gate.fitted = True
        wanted = {name: options[name] for name in ("compression", "subprotocols", "select_subprotocol")}
        return listen(
            lambda connection: gate.attended(handler, connection),
            sock=gate.listener, process_request=gate.asked, max_size=LARGEST, max_queue=16, server_header=None,
            logger=quiet, **wanted,
        )  # fmt: skip

    websockets.asyncio.server.serve = serve  # type: ignore[assignment,misc]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = listen  # type: ignore[misc]
    if not gate.fitted:
        raise TactemuError(f"viser {viser.__version__} listens in a way that we do not know; {PINNED}")
