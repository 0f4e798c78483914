"""The other end of the socket: a running emulator in another process, with the same commands as one that was served."""

from __future__ import annotations

import base64
import contextlib
import itertools
import json
import os
import socket
from collections.abc import Iterator
from typing import Any

import numpy as np

from tactemu.base.errors import TactemuError, TransportError
from tactemu.control.control_commands import ControlCommands
from tactemu.control.endpoints import PROTOCOL, chosen, uid_of_peer

_ARRAY = {"dtype", "shape", "base64"}
"""Keys of an array that comes as bytes."""


def connect(name: str | None = None) -> Connection:
    """Return a connection to the emulator of that name, or to the only one that runs; use it in a ``with`` statement.

    ::

        with tactemu.connect() as skin:
            skin.press(depth=1e-3, seconds=0.5)
            print(skin.sample()["measured"])

    Raises:
        TactemuError: none runs, or several and nobody said which; the message lists them.
    """
    return Connection(str(chosen(name)))


class Connection(ControlCommands):
    """What :func:`connect` returns. Use it in one thread at a time.

    Samples are tables with the keys of a line of the truth log (``ideal``, ``measured``, ``counts`` as lists).
    """

    def __init__(self, path: str):
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._numbers = itertools.count(1)
        try:
            self._socket.connect(path)
            if uid_of_peer(self._socket) != os.getuid():
                raise TransportError(f"{path}: another user listens there")
            self._file = self._socket.makefile("rb")
            self.about = self._read()
        except OSError as error:
            self._socket.close()
            raise TransportError(f"{path}: nobody listens there: {error.strerror}") from None
        except BaseException:
            self._socket.close()
            raise
        if self.about.get("protocol") != PROTOCOL:
            self.close()
            raise TransportError(
                f"{path}: the emulator speaks version {self.about.get('protocol')} of the protocol, we version "
                f"{PROTOCOL}; use the same tactemu at both ends"
            )

    def close(self) -> None:
        """Go; what was begun goes on. Safe to call twice."""
        self._file.close()
        self._socket.close()

    def __enter__(self) -> Connection:
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def watch(
        self, rate: float = 10.0, *, arrays: bool = False, wire: int = 0, skin: str | None = None
    ) -> Iterator[dict[str, Any]]:
        """States as :meth:`state` gives them, at a rate [Hz], as long as it is iterated; never an old one.

        Args:
            rate: how many come in a second, at most.
            arrays: readings are NumPy arrays rather than lists, which costs both ends far less.
            wire: so many of the latest frames, faults and events since the last state come with each, as ``wire``, in
                the form of lines of the truth log; ``wire_missing`` is how many more there were.
            skin: whose frames; default: everybody's.

        Raises:
            TactemuError: no such rate or skin, or the emulator has stopped.
        """
        wished: dict[str, Any] = {"rate": rate}
        wished |= {"arrays": "base64"} if arrays else {}
        wished |= {"wire": wire, "skin": skin} if wire else {}
        number = self._ask("watch", wished)
        self._answer_to(number)
        try:
            while True:
                said = self._read()
                if said.get("watch") == number:
                    yield _result_of(said)
        finally:
            with contextlib.suppress(TactemuError, ValueError):
                self._answer_to(self._ask("unwatch", {}))

    def _do(self, verb: str, arguments: dict[str, Any]) -> Any:
        return _result_of(self._answer_to(self._ask(verb, arguments)))

    def _ask(self, verb: str, arguments: dict[str, Any]) -> int:
        number = next(self._numbers)
        request = {"id": number, "protocol": PROTOCOL, "verb": verb, "args": arguments}
        try:
            self._socket.sendall(json.dumps(request).encode() + b"\n")
        except OSError:
            raise _stopped() from None
        return number

    def _answer_to(self, number: int) -> dict[str, Any]:
        while True:
            said = self._read()
            if said.get("id") == number:
                if not said["ok"]:
                    raise TactemuError(said["error"])
                return said

    def _read(self) -> dict[str, Any]:
        try:
            line = self._file.readline()
            said = json.loads(line, object_hook=_as_array) if line else None
        except (OSError, ValueError):
            said = None
        if not isinstance(said, dict):
            raise _stopped()
        if "ok" in said and not said["ok"] and "id" not in said and "watch" not in said:
            raise TactemuError(said["error"])
        return said


def _as_array(table: dict[str, Any]) -> Any:
    """Return an array that came as bytes; other tables as they are."""
    if table.keys() != _ARRAY:
        return table
    values = np.frombuffer(base64.b64decode(table["base64"]), np.dtype(table["dtype"]))
    return values.reshape(table["shape"])


def _result_of(said: dict[str, Any]) -> Any:
    if not said["ok"]:
        raise TactemuError(said["error"])
    return said["result"]


def _stopped() -> TactemuError:
    return TransportError("the emulator has stopped")
