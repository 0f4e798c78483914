"""The client of a control socket: the commands of ``tactemu.serve()`` for an emulator in another process."""

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

from tactemu.base.errors import TactemuError, TransportError, reason_of
from tactemu.control.control_commands import DEFAULT_WATCH_RATE_HZ, ControlCommands
from tactemu.control.endpoints import PROTOCOL, chosen, uid_of_peer
from tactemu.truth.entries import Sample

_ARRAY = {"dtype", "shape", "base64"}
"""The keys of an array that is sent as bytes."""


def connect(name: str | None = None) -> Connection:
    """Return a connection to the emulator of this name, or to the only one that runs; use it in a ``with`` statement.

    ::

        with tactemu.connect() as skin:
            skin.press(depth=1e-3, dwell=0.5)
            print(skin.sample().measured)

    Raises:
        TactemuError: none runs, or several run and no name is given; the message lists them.
    """
    return Connection(str(chosen(name)))


class Connection(ControlCommands):
    """A connection to a running emulator, from :func:`connect`. Use it in one thread at a time."""

    def __init__(self, path: str):
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._numbers = itertools.count(1)
        try:
            self._socket.connect(path)
            if uid_of_peer(self._socket) != os.getuid():
                raise TransportError(f"{path}: the socket belongs to another user")
            self._file = self._socket.makefile("rb")
            self.about = self._read()
        except OSError as error:
            self._socket.close()
            raise TransportError(f"{path}: cannot connect to the emulator: {reason_of(error)}") from None
        except BaseException:
            self._socket.close()
            raise
        if self.about.get("protocol") != PROTOCOL:
            self.close()
            raise TransportError(
                f"{path}: the emulator has version {self.about.get('protocol')} of the protocol, this client version "
                f"{PROTOCOL}; use the same tactemu at both ends"
            )

    def close(self) -> None:
        """Close the connection; commands that have begun continue. Safe to call twice."""
        self._file.close()
        self._socket.close()

    def __enter__(self) -> Connection:
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def sample(self, skin: str | None = None) -> Sample:
        """Return the latest sample of a skin (default: the only one): ideal and measured reading, and counts.

        Raises:
            TactemuError: it has not been sampled yet.
        """
        table = self._do("sample", {"skin": skin} if skin is not None else {})
        arrays = {name: np.asarray(table[name]) for name in ("ideal", "measured", "counts")}
        return Sample(table["t_ns"], table["device"], number=table["number"], sense=table["sense"], **arrays)

    def watch(
        self, rate: float = DEFAULT_WATCH_RATE_HZ, *, arrays: bool = False, wire: int = 0, skin: str | None = None
    ) -> Iterator[dict[str, Any]]:
        """Yield the states of :meth:`state` at a rate [Hz]; a slow reader gets fewer, and never an old one.

        Args:
            rate: maximum number of states per second.
            arrays: return readings as NumPy arrays rather than lists, which costs both ends far less.
            wire: number of the latest frames, faults and events since the last state, at most, that come with each
                state as ``wire``, in the form of lines of the truth log; ``wire_missing`` counts the others.
            skin: the skin of the frames; default: all.

        Raises:
            TactemuError: the rate or the skin is not valid, or the emulator has stopped.
        """
        arguments: dict[str, Any] = {"rate": rate}
        arguments |= {"arrays": "base64"} if arrays else {}
        arguments |= {"wire": wire, "skin": skin} if wire else {}
        number = self._request("watch", arguments)
        self._answer_to(number)
        try:
            while True:
                message = self._read()
                if message.get("watch") == number:
                    yield _result_of(message)
        finally:
            with contextlib.suppress(TactemuError, ValueError):
                self._answer_to(self._request("unwatch", {}))

    def _do(self, verb: str, arguments: dict[str, Any]) -> Any:
        return _result_of(self._answer_to(self._request(verb, arguments)))

    def _request(self, verb: str, arguments: dict[str, Any]) -> int:
        number = next(self._numbers)
        request = {"id": number, "protocol": PROTOCOL, "verb": verb, "args": arguments}
        try:
            self._socket.sendall(json.dumps(request).encode() + b"\n")
        except OSError:
            raise _stopped() from None
        return number

    def _answer_to(self, number: int) -> dict[str, Any]:
        while True:
            message = self._read()
            if message.get("id") == number:
                if not message["ok"]:
                    raise TactemuError(message["error"])
                return message

    def _read(self) -> dict[str, Any]:
        try:
            line = self._file.readline()
            message = json.loads(line, object_hook=_as_array) if line else None
        except (OSError, ValueError):
            message = None
        if not isinstance(message, dict):
            raise _stopped()
        if "ok" in message and not message["ok"] and "id" not in message and "watch" not in message:
            raise TactemuError(message["error"])
        return message


def _as_array(table: dict[str, Any]) -> Any:
    """Return the array of a table with an array's bytes; other tables unchanged."""
    if table.keys() != _ARRAY:
        return table
    values = np.frombuffer(base64.b64decode(table["base64"]), np.dtype(table["dtype"]))
    return values.reshape(table["shape"])


def _result_of(message: dict[str, Any]) -> Any:
    if not message["ok"]:
        raise TactemuError(message["error"])
    return message["result"]


def _stopped() -> TactemuError:
    return TransportError("the emulator has stopped")
