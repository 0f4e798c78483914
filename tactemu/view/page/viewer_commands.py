"""The commands of viewers, sent over the control channel by a thread of their own."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from tactemu.base.errors import TactemuError
from tactemu.control.client import Connection

MAX_DRAG_SPEED_M_S = 0.2
"""Maximum speed of a dragged body: the mouse cannot carry it through a skin in one step."""
_MAX_WAITING_COMMANDS = 32
"""Maximum number of queued commands; where viewers click faster than they are done, the oldest are dropped."""

Report = Callable[[str], None]
"""Reports an error to the viewer whose command failed."""


class ViewerCommands:
    """A queue of all viewers' commands; of a dragged body only the latest target is kept.

    Args:
        connection: to the emulator, used by this queue only.
        on_statistics: called about once a second with the statistics of the skin that :attr:`skin` names.
    """

    def __init__(self, connection: Connection, on_statistics: Callable[[Mapping[str, Any]], None]):
        self._connection, self._on_statistics = connection, on_statistics
        self.skin: str | None = None
        self.holders: dict[str, int] = {}
        """The number of the viewer who holds each body."""
        self._grab_offsets: dict[str, np.ndarray] = {}
        """The vector from the origin of each held body to the point where it was grabbed [m]."""
        self._targets: dict[str, list[float] | None] = {}
        """The positions that bodies shall move to [m]; None: stay at the present position."""
        self._waiting: deque[tuple[str, dict[str, Any], Report]] = deque(maxlen=_MAX_WAITING_COMMANDS)
        self._changed = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._work, name="tactemu-viewer-commands", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop the thread and close the connection."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join(5.0)
        self._connection.close()

    # -- from viewers --------------------------------------------------------------------------------------------------

    def submit(self, verb: str, say: Report, **arguments: Any) -> None:
        """Queue a command; ``say`` receives its error."""
        with self._changed:
            self._waiting.append((verb, {k: v for k, v in arguments.items() if v is not None}, say))
            self._changed.notify()

    def grab(self, viewer: int, body: str, where: Any, origin: Any) -> None:
        """Let a viewer hold a body at the point ``where``; another viewer who held it loses it."""
        self.holders[body] = viewer
        self._grab_offsets[body] = np.array(where, float) - np.array(origin, float)

    def drag(self, viewer: int, body: str, where: Any) -> None:
        """Move the grabbed point of the body to ``where``, unless another viewer holds the body."""
        target = np.array(where, float)
        if self.holders.get(body) == viewer and body in self._grab_offsets and np.isfinite(target).all():
            self._set_target(body, (target - self._grab_offsets[body]).tolist())

    def release(self, viewer: int, body: str) -> None:
        """Stop the body where it is when its viewer ends the drag; the viewer still holds it."""
        if self.holders.get(body) == viewer:
            self._grab_offsets.pop(body, None)
            self._set_target(body, None)

    def give_back(self, viewer: int | None, say: Report) -> None:
        """Let the bodies that a viewer holds follow their own motion again; None: the bodies of all viewers."""
        if viewer is None:
            self.submit("give_back", say)
        for each in [each for each, by in self.holders.items() if viewer in (None, by)]:
            self.holders.pop(each, None)
            self._grab_offsets.pop(each, None)
            with self._changed:
                self._targets.pop(each, None)
            if viewer is not None:
                self.submit("give_back", say, body=each)

    def _set_target(self, body: str, target: list[float] | None) -> None:
        with self._changed:
            self._targets[body] = target
            self._changed.notify()

    # -- the thread ----------------------------------------------------------------------------------------------------

    def _work(self) -> None:
        last_statistics_s = 0.0
        while not self._closed:
            with self._changed:
                if not (self._waiting or self._targets or self._closed):
                    self._changed.wait(0.2)
                waiting, targets = list(self._waiting), self._targets
                self._waiting.clear()
                self._targets = {}
            for body, target in targets.items():
                where = {"by": (0.0, 0.0, 0.0)} if target is None else {"position": target, "speed": MAX_DRAG_SPEED_M_S}
                self._ask("move", {**where, "body": body, "wait": False}, _ignore)
            for verb, arguments, say in waiting:
                self._ask(verb, arguments, say)
            if self.skin is not None and time.monotonic() - last_statistics_s > 1.0:
                last_statistics_s = time.monotonic()
                stats = self._ask("stats", {"skin": self.skin}, _ignore)
                if stats is not None:
                    self._on_statistics(stats)

    def _ask(self, verb: str, arguments: dict[str, Any], say: Report) -> Any:
        """Send a command and return its answer, or None after an error, which ``say`` receives."""
        try:
            return getattr(self._connection, NAMES.get(verb, verb))(**arguments)
        except (TactemuError, TypeError, ValueError) as error:
            say(str(error))
            return None


NAMES = {"pose": "set_pose", "lines": "set_lines"}


def _ignore(text: str) -> None:
    """Drop the error of a command that no viewer gave."""
