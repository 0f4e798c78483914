"""The page itself: it draws each state of an emulator as it arrives."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import viser

from tactemu.base.errors import TactemuError
from tactemu.control.client import Connection
from tactemu.view.page.boards import Board
from tactemu.view.page.bodies import Scene
from tactemu.view.page.camera import Cameras
from tactemu.view.page.feed import DescribedRun, PageSkin, PageState, page_state
from tactemu.view.page.guard import Gate, behind_gate
from tactemu.view.page.page_script import SCHEME
from tactemu.view.page.panel import Panel, holder_text
from tactemu.view.page.viewer_commands import ViewerCommands

RATE_HZ = 15.0
"""The rate of states that the page asks for while it has viewers."""
IDLE_HZ = 0.5
"""The rate of states that the page asks for without viewers."""
_MAX_WIRE_ENTRIES = 40
"""Maximum number of frames, faults and events that come with a state."""


class Page:
    """A page that shows an emulator to every viewer whom the gate admits.

    Args:
        gate: the gate, with a listening socket.
        title: the title of the page.
        datasheet: returns the lines of a device's datasheet.

    Raises:
        TactemuError: this version of viser is not supported.
    """

    def __init__(self, gate: Gate, title: str, datasheet: Callable[[PageSkin], Sequence[str]]):
        self._gate, self._title, self._datasheet = gate, title, datasheet
        with behind_gate(gate):
            self._server = viser.ViserServer(host="127.0.0.1", port=0, label=title, verbose=False)
        self._closed = threading.Event()
        self._scene: Scene | None = None
        self._panel: Panel | None = None
        self._cameras = Cameras(self._server, self._seen)
        self._is_new = True
        self._legend: Any = None
        self._viewer_commands: ViewerCommands | None = None
        self._run = DescribedRun({})
        self._last = PageState(0.0, {})
        _close_on_error(self._server, gate)

        @self._server.on_client_connect
        def _(client: viser.ClientHandle) -> None:
            self._cameras.admit(client)
            _welcome(client)

        @self._server.on_client_disconnect
        async def _(client: viser.ClientHandle) -> None:
            self._cameras.forget(client)
            for body, viewer in list(self._viewer_commands.holders.items() if self._viewer_commands else ()):
                if viewer == client.client_id and self._viewer_commands:
                    self._viewer_commands.release(viewer, body)

    def show(self, connect: Callable[[], Connection]) -> None:
        """Show an emulator until it ends.

        Args:
            connect: returns a new connection to the emulator.

        Raises:
            TactemuError: the emulator cannot be reached.
        """
        with connect() as connection:
            self._run = DescribedRun(connection.describe() if connection.about.get("skins") else {})
            self._viewer_commands = ViewerCommands(connect(), self._show_statistics)
            try:
                self._make(connection)
                while not self._closed.is_set():
                    self._watch(connection)
            except TactemuError as error:
                if self._panel is not None:
                    self._panel.end(self._last.t_s, str(error))
                    self._server.flush()
            finally:
                self._viewer_commands.close()

    def close(self) -> None:
        """Stop drawing and close the port. Viewers keep the last picture."""
        self._closed.set()
        self._server.flush()
        time.sleep(0.2)
        self._server.stop()

    # -- what is shown -------------------------------------------------------------------------------------------------

    def _make(self, connection: Connection) -> None:
        assert self._viewer_commands is not None
        self._scene = Scene(self._server, self._run, connection.about.get("bodies", ()))
        self._panel = Panel(
            self._server, self._run, self._viewer_commands, self._datasheet, self._title, self._cameras.show,
            self._scene.ranges,
        )  # fmt: skip
        for name, solid in self._scene.solids.items():
            self._enable_drag(name, solid)
        for board in self._scene.boards.values():
            self._enable_click(board)
        self._legend = self._server.gui.add_html("")
        self._cameras.place_first()
        self._is_new = True

    def _watch(self, connection: Connection) -> None:
        """Draw states until the first viewer comes, the last one goes, or another skin is selected."""
        assert self._panel is not None
        subscription = self._subscription()
        rate, skin = subscription
        entries = _MAX_WIRE_ENTRIES if rate == RATE_HZ else 0
        for state in connection.watch(rate, arrays=True, wire=entries, skin=skin):
            self._draw(page_state(state, self._run))
            if self._subscription() != subscription or self._closed.is_set():
                return

    def _subscription(self) -> tuple[float, str | None]:
        looking = self._gate.viewers > 0
        skin = self._panel.skin if self._panel is not None else None
        return RATE_HZ if looking else IDLE_HZ, skin.name if skin is not None else None

    def _draw(self, state: PageState) -> None:
        assert self._scene is not None and self._panel is not None and self._viewer_commands is not None
        self._last = state
        with self._server.atomic():
            self._scene.draw(state)
            if self._legend.content != (legend := self._scene.legend()):
                self._legend.content = legend
            for name, label in self._scene.labels.items():
                body = state.bodies.get(name, {})
                held = bool(body.get("in_hand")) and name in self._viewer_commands.holders
                if label.visible != held:
                    label.visible = held
                if held and label.text != (words := holder_text(self._viewer_commands.holders.get(name))):
                    label.text = words
            self._panel.draw(state, self._viewer_count())
        if self._is_new:  # a physics engine has moved the bodies since they were described
            self._is_new = False
            self._cameras.show_again()
            self._gate.is_server_ready = True

    def _seen(self) -> tuple[np.ndarray, np.ndarray]:
        assert self._scene is not None
        return self._scene.seen()

    def _viewer_count(self) -> str:
        viewers = self._gate.viewers
        return f"{viewers} viewer{'s' * (viewers != 1)}"

    def _show_statistics(self, stats: Any) -> None:
        if self._panel is not None and self._gate.viewers:
            self._panel.numbers(stats)

    # -- what viewers do -----------------------------------------------------------------------------------------------

    def _enable_drag(self, body: str, solid: Any) -> None:
        viewer_commands = self._viewer_commands
        assert viewer_commands is not None

        @solid.on_drag("left")
        async def _(event: Any) -> None:
            if event.phase == "start":
                origin = self._last.bodies.get(body, {}).get("position", (0.0, 0.0, 0.0))
                viewer_commands.grab(event.client_id, body, event.start_position, origin)
            if event.phase in ("start", "update"):
                viewer_commands.drag(event.client_id, body, event.end_position)
            else:
                viewer_commands.release(event.client_id, body)

    def _enable_click(self, board: Board) -> None:
        @board.discs.on_click
        async def _(event: Any) -> None:
            if event.instance_index is not None and 0 <= event.instance_index < len(board.owners):
                assert self._panel is not None
                self._panel.choose_taxel(*board.owners[event.instance_index])


def _welcome(client: viser.ClientHandle) -> None:
    """Tell a viewer their number, and set the colour scheme that their browser prefers."""
    try:
        scheme = client.local_storage.get_item(SCHEME, timeout=30.0)
    except (TimeoutError, RuntimeError):  # the viewer has gone, or their browser stores nothing
        scheme = None
    client.gui.configure_theme(
        dark_mode=scheme == "dark", show_logo=False, show_share_button=False, control_width="medium"
    )
    client.gui.add_html(f'<div style="padding: 0 0.8em"><small>You are viewer {client.client_id + 1}.</small></div>')


def _close_on_error(server: viser.ViserServer, gate: Gate) -> None:
    """Close the connection of a viewer whose message has a valid form but fails, and report it in one line."""
    socket: Any = server._websock_server
    handle = socket._handle_incoming_message

    async def handled(client_id: int, message: Any) -> None:
        try:
            await handle(client_id, message)
        except Exception as error:
            gate.say(f"a viewer was closed: {type(message).__name__}: {error!s:.100}")
            connection = socket._live_connections.get(client_id)
            if connection is not None:
                await connection.close(1008, "the message failed")

    socket._handle_incoming_message = handled
