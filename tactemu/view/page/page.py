"""The page itself: one emulator after the other of a name, drawn as its states come."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import viser

from tactemu.base.errors import TactemuError
from tactemu.control.client import Connection
from tactemu.view.page.bodies import Board, Scene, paint
from tactemu.view.page.feed import Known, Moment, Skin, moment_of
from tactemu.view.page.guard import SCHEME, Gate, guarded
from tactemu.view.page.hands import Hands
from tactemu.view.page.panel import Panel, whose

RATE_HZ, IDLE_HZ = 15.0, 0.5
"""States that are asked for while somebody looks, and while nobody does."""
_ENTRIES = 40
"""Frames, faults and events that come with a state."""


class Page:
    """Shows an emulator to whoever comes through the gate.

    Args:
        gate: has a socket that listens.
        title: of the page.
        datasheet: the lines of the one of a device.

    Raises:
        TactemuError: this viser is not the one that we know.
    """

    def __init__(self, gate: Gate, title: str, datasheet: Callable[[Skin], Sequence[str]]):
        self._gate, self._title, self._datasheet = gate, title, datasheet
        with guarded(gate):
            self._server = viser.ViserServer(host="127.0.0.1", port=0, label=title, verbose=False)
        self._closed = threading.Event()
        self._scene: Scene | None = None
        self._panel: Panel | None = None
        self._hands: Hands | None = None
        self._known = Known({})
        self._last = Moment(0.0, {})
        _close_those_who_err(self._server, gate)

        @self._server.on_client_connect
        def _(client: viser.ClientHandle) -> None:
            _welcome(client)

        @self._server.on_client_disconnect
        async def _(client: viser.ClientHandle) -> None:
            for body, viewer in list(self._hands.holders.items() if self._hands else ()):
                if viewer == client.client_id and self._hands:
                    self._hands.let_go(viewer, body)

        gate.made = True

    def show(self, connect: Callable[[], Connection]) -> None:
        """Show an emulator until it ends.

        Args:
            connect: gives a connection to it.

        Raises:
            TactemuError: it cannot be reached.
        """
        with connect() as connection:
            self._known = Known(connection.describe() if connection.about.get("skins") else {})
            self._hands = Hands(connect(), self._look_at)
            try:
                self._make(connection)
                while not self._closed.is_set():
                    self._watch(connection)
            except TactemuError as error:
                if self._panel is not None:
                    self._panel.end(self._last.t_s, str(error))
                    self._server.flush()
            finally:
                self._hands.close()

    def close(self) -> None:
        """Show no more, and close the port. Viewers keep the last picture."""
        self._closed.set()
        self._server.flush()
        time.sleep(0.2)
        self._server.stop()

    # -- what is shown -------------------------------------------------------------------------------------------------

    def _make(self, connection: Connection) -> None:
        assert self._hands is not None
        self._scene = Scene(self._server, self._known)
        self._panel = Panel(self._server, self._known, self._hands, self._datasheet, self._title)
        movable = set(connection.about.get("bodies", ()))
        for name, solids in self._scene.solids.items():
            if name in movable:
                paint(solids, movable=True)
                for solid in solids:
                    self._let_drag(name, solid)
        for board in self._scene.boards:
            self._let_click(board)

    def _watch(self, connection: Connection) -> None:
        """States, until somebody comes, the last one goes, or another skin is looked at."""
        assert self._panel is not None
        wish = self._wish()
        rate, skin = wish
        entries = _ENTRIES if rate == RATE_HZ else 0
        for state in connection.watch(rate, arrays=True, wire=entries, skin=skin):
            self._draw(moment_of(state, self._known))
            if self._wish() != wish or self._closed.is_set():
                return

    def _wish(self) -> tuple[float, str | None]:
        looking = self._gate.viewers > 0
        skin = self._panel.skin if self._panel is not None else None
        return RATE_HZ if looking else IDLE_HZ, skin.name if skin is not None else None

    def _draw(self, moment: Moment) -> None:
        assert self._scene is not None and self._panel is not None and self._hands is not None
        self._last = moment
        with self._server.atomic():
            self._scene.draw(moment)
            for name, label in self._scene.labels.items():
                body = moment.bodies.get(name, {})
                held = bool(body.get("in_hand")) and name in self._hands.holders
                if label.visible != held:
                    label.visible = held
                if held and label.text != (words := whose(self._hands.holders.get(name))):
                    label.text = words
            self._panel.draw(moment, self._words())

    def _words(self) -> str:
        viewers = self._gate.viewers
        return f"{viewers} viewer{'s' * (viewers != 1)}"

    def _look_at(self, stats: Any) -> None:
        if self._panel is not None and self._gate.viewers:
            self._panel.numbers(stats)

    # -- what viewers do -----------------------------------------------------------------------------------------------

    def _let_drag(self, body: str, solid: Any) -> None:
        hands = self._hands
        assert hands is not None

        @solid.on_drag("left")
        async def _(event: Any) -> None:
            if event.phase == "start":
                origin = self._last.bodies.get(body, {}).get("position", (0.0, 0.0, 0.0))
                hands.grab(event.client_id, body, event.start_position, origin)
            if event.phase in ("start", "update"):
                hands.drag(event.client_id, body, event.end_position)
            else:
                hands.let_go(event.client_id, body)

    def _let_click(self, board: Board) -> None:
        @board.discs.on_click
        async def _(event: Any) -> None:
            if event.instance_index is not None and 0 <= event.instance_index < len(board.owners):
                assert self._panel is not None
                self._panel.choose_taxel(*board.owners[event.instance_index])


def _welcome(client: viser.ClientHandle) -> None:
    """Say who it is, and give the page the colours that its user likes."""
    try:
        scheme = client.local_storage.get_item(SCHEME, timeout=30.0)
    except (TimeoutError, RuntimeError):  # it has gone, or keeps nothing
        scheme = None
    client.gui.configure_theme(
        dark_mode=scheme == "dark", show_logo=False, show_share_button=False, control_width="medium"
    )
    client.gui.add_html(f'<div style="padding: 0 0.8em"><small>You are viewer {client.client_id + 1}.</small></div>')


def _close_those_who_err(server: viser.ViserServer, gate: Gate) -> None:
    """A viewer whose message has the form of one, and makes no sense, is closed in a line."""
    socket: Any = server._websock_server
    handle = socket._handle_incoming_message

    async def handled(client_id: int, message: Any) -> None:
        try:
            await handle(client_id, message)
        except Exception as error:
            gate.say(f"a viewer was closed: {type(message).__name__}: {error!s:.100}")
            connection = socket._live_connections.get(client_id)
            if connection is not None:
                await connection.close(1008, "that made no sense")

    socket._handle_incoming_message = handled
