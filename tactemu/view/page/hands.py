"""What viewers do by hand, done through the control channel: in a thread of its own."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from tactemu.base.errors import TactemuError
from tactemu.control.client import Connection

FASTEST = 0.2
"""Of a body that is dragged [m/s]: the mouse cannot carry it through a skin in a step."""
_MOST_WAITING = 32
"""Commands; a viewer who clicks faster than they are done loses the oldest."""

Say = Callable[[str], None]
"""Tells whoever asked what went wrong."""


class Hands:
    """Commands of all viewers, one after the other; of a body that is dragged only where it shall go last.

    Args:
        connection: to the emulator, for nobody else.
        look: called with statistics, of the skin that :attr:`skin` names, about once a second.
    """

    def __init__(self, connection: Connection, look: Callable[[Mapping[str, Any]], None]):
        self._connection, self._look = connection, look
        self.skin: str | None = None
        self.holders: dict[str, int] = {}
        """Who has each body in hand, by the number of the viewer."""
        self._grips: dict[str, np.ndarray] = {}
        """From the origin of a body to where it was grabbed."""
        self._goals: dict[str, list[float] | None] = {}
        """Where bodies shall go; ``None``: stay where they are."""
        self._waiting: deque[tuple[str, dict[str, Any], Say]] = deque(maxlen=_MOST_WAITING)
        self._changed = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._work, name="tactemu-hands", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Do no more."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join(5.0)
        self._connection.close()

    # -- from viewers --------------------------------------------------------------------------------------------------

    def do(self, verb: str, say: Say, **arguments: Any) -> None:
        """Have a command done; what is wrong with it is said."""
        with self._changed:
            self._waiting.append((verb, {k: v for k, v in arguments.items() if v is not None}, say))
            self._changed.notify()

    def grab(self, viewer: int, body: str, where: Any, origin: Any) -> None:
        """A viewer takes a body at a point of it; whoever had it loses it."""
        self.holders[body] = viewer
        self._grips[body] = np.array(where, float) - np.array(origin, float)

    def drag(self, viewer: int, body: str, where: Any) -> None:
        """Take that point of it to a place, unless another viewer has it."""
        goal = np.array(where, float)
        if self.holders.get(body) == viewer and body in self._grips and np.isfinite(goal).all():
            self._go(body, (goal - self._grips[body]).tolist())

    def let_go(self, viewer: int, body: str) -> None:
        """Hold it where it is."""
        if self.holders.get(body) == viewer:
            self._grips.pop(body, None)
            self._go(body, None)

    def give_back(self, viewer: int | None, say: Say) -> None:
        """Bodies go on with their own motion: those that a viewer has taken; ``None``: all, whoever has them."""
        if viewer is None:
            self.do("give_back", say)
        for each in [each for each, by in self.holders.items() if viewer in (None, by)]:
            self.holders.pop(each, None)
            self._grips.pop(each, None)
            with self._changed:
                self._goals.pop(each, None)
            if viewer is not None:
                self.do("give_back", say, body=each)

    def _go(self, body: str, goal: list[float] | None) -> None:
        with self._changed:
            self._goals[body] = goal
            self._changed.notify()

    # -- the thread ----------------------------------------------------------------------------------------------------

    def _work(self) -> None:
        looked_s = 0.0
        while not self._closed:
            with self._changed:
                if not (self._waiting or self._goals or self._closed):
                    self._changed.wait(0.2)
                waiting, goals = list(self._waiting), self._goals
                self._waiting.clear()
                self._goals = {}
            for body, goal in goals.items():
                where = {"by": (0.0, 0.0, 0.0)} if goal is None else {"position": goal, "speed": FASTEST}
                self._ask("move", {**where, "body": body, "wait": False}, _nobody)
            for verb, arguments, say in waiting:
                self._ask(verb, arguments, say)
            if self.skin is not None and time.monotonic() - looked_s > 1.0:
                looked_s = time.monotonic()
                stats = self._ask("stats", {"skin": self.skin}, _nobody)
                if stats is not None:
                    self._look(stats)

    def _ask(self, verb: str, arguments: dict[str, Any], say: Say) -> Any:
        """Return a command, whose answer is waited for."""
        try:
            return getattr(self._connection, NAMES.get(verb, verb))(**arguments)
        except (TactemuError, TypeError, ValueError) as error:
            say(str(error))
            return None


NAMES = {"pose": "set_pose", "lines": "set_lines"}


def _nobody(text: str) -> None:
    """Told what nobody asked for."""
