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
        self._waiting: deque[tuple[str, dict[str, Any], Report, Report]] = deque(maxlen=_MAX_WAITING_COMMANDS)
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

    def submit(self, verb: str, say: Report, done: Report | None = None, **arguments: Any) -> None:
        """Queue a command; ``say`` receives its error, ``done`` the words for what it has done."""
        with self._changed:
            self._waiting.append((verb, {k: v for k, v in arguments.items() if v is not None}, say, done or _ignore))
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

    def give_back(self, viewer: int | None, say: Report, done: Report | None = None) -> None:
        """Let the bodies that a viewer holds follow their own motion again; None: the bodies of all viewers."""
        if viewer is None:
            self.submit("give_back", say, done)
        for each in [each for each, by in self.holders.items() if viewer in (None, by)]:
            self.holders.pop(each, None)
            self._grab_offsets.pop(each, None)
            with self._changed:
                self._targets.pop(each, None)
            if viewer is not None:
                self.submit("give_back", say, done, body=each)

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
            for verb, arguments, say, done in waiting:
                self._ask(verb, arguments, say, done)
            if self.skin is not None and time.monotonic() - last_statistics_s > 1.0:
                last_statistics_s = time.monotonic()
                stats = self._ask("stats", {"skin": self.skin}, _ignore)
                if stats is not None:
                    self._on_statistics(stats)

    def _ask(self, verb: str, arguments: dict[str, Any], say: Report, done: Report | None = None) -> Any:
        """Send a command and return its answer, or None after an error, which ``say`` receives."""
        try:
            answer = getattr(self._connection, NAMES.get(verb, verb))(**arguments)
            if done is not None:
                done(answer_words(verb, arguments))
            return answer
        except (TactemuError, TypeError, ValueError) as error:
            say(str(error))
            return None


def answer_words(verb: str, arguments: Mapping[str, Any]) -> str:
    """Return what a command has done, in words: ``unplugged for 1 s``."""
    duration = f" for {arguments['seconds']:g} s" if "seconds" in arguments else ""
    match verb:
        case "press":
            taxel = f"taxel {arguments['taxel']}" if "taxel" in arguments else "the nearest taxel"
            dwell = f" for {arguments['dwell']:g} s" if "dwell" in arguments else ""
            return f"pressed {taxel} by {arguments['depth'] * 1e3:.1f} mm{dwell}"
        case "unplug":
            return f"unplugged{duration}"
        case "hang":
            return f"hung{duration}: it neither samples nor answers"
        case "reset":
            return "rebooted"
        case "fault":
            return f"fault begun: {arguments['fault']}"
        case "mend":
            return f"fault ended: {arguments['fault']}" if "fault" in arguments else "all faults ended"
        case "set":
            return ", ".join(f"{name} set to {value:g}" for name, value in arguments["options"].items())
        case "dead":
            return f"dead taxels, which return a constant value: {', '.join(str(each) for each in arguments['taxels'])}"
        case "give_back":
            body = arguments.get("body")
            return f"{body} follows its own motion again" if body else "all bodies follow their own motion again"
        case _:
            return f"{verb} " + " ".join(f"{name}={value}" for name, value in arguments.items())


NAMES = {"pose": "set_pose", "lines": "set_lines"}


def _ignore(text: str) -> None:
    """Drop the error of a command that no viewer gave."""
