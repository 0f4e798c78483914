"""The view's own process: makes the namespaces and the view in them, and changes it as the emulator says.

Started by :mod:`tactemu.exec.environment`; needs nothing but the standard library. When the emulator goes, however it
goes, everything is unplugged and the keeper ends; the namespaces end with the last process in them.

Messages are JSON, one a packet: ``{"do": "plug", ...}`` is answered by ``{...}`` with descriptors beside it, or by
``{"error": text}``.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import shutil
import signal
import socket
from typing import Any

from tactemu.exec import system
from tactemu.exec.enter import PRELOAD
from tactemu.exec.network import Network
from tactemu.exec.view import ROOM, View

_LONGEST = 65_536


def main(descriptor: int, emulator: int, preload: str) -> None:
    """Serve the emulator with process id ``emulator`` at the other end of the socket ``descriptor``.

    ``preload`` is the path of the preload library, or empty.
    """
    for number in (signal.SIGINT, signal.SIGQUIT, signal.SIGHUP, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # it ends with the emulator, and not before
    wire = socket.socket(fileno=descriptor)
    emulator_fd = os.pidfd_open(emulator)
    try:
        enter_namespaces()
        view = View()
        if preload:
            shutil.copyfile(preload, PRELOAD)
    except OSError as error:
        _say(wire, {"error": f"{error.filename or 'user namespace'}: {error.strerror}", "number": error.errno})
        return
    network = Network(ROOM)
    _say(wire, {})
    while message := _next(wire, emulator_fd):
        answer, descriptors = {}, []
        try:
            answer, descriptors = _do(view, network, **message)
        except (OSError, ValueError) as error:
            answer = {"error": str(error)}
        _say(wire, answer, descriptors)
        for each in descriptors:
            os.close(each)
    network.unplug_all()
    view.unplug_all()


def enter_namespaces() -> None:
    """A mount namespace, whose owner this process is: root's own, else one in a user namespace.

    Raises:
        OSError: the kernel does not allow it.
    """
    uid, gid = os.getuid(), os.getgid()
    try:
        system.unshare(system.CLONE_NEWNS)
    except PermissionError:
        system.unshare(system.CLONE_NEWUSER | system.CLONE_NEWNS)
        for name, text in (("setgroups", "deny"), ("uid_map", f"{uid} {uid} 1"), ("gid_map", f"{gid} {gid} 1")):
            with open(f"/proc/self/{name}", "w") as file:
                file.write(text)
    system.mount("", "/", flags=system.MS_REC | system.MS_SLAVE)  # ours stay here, the machine's still come in


def _do(view: View, network: Network, do: str, **given: Any) -> tuple[dict[str, Any], list[int]]:
    match do:
        case "plug":
            node, descriptors = view.plug(**given)
            return {"node": node}, descriptors
        case "replace":
            return {}, view.replace(**given)
        case "unplug":
            view.unplug(**given)
            return {}, []
        case "bus":
            way, descriptors = network.plug(**given)
            return {"way": way}, descriptors
        case "no bus":
            network.unplug(**given)
            return {}, []
        case "socket":
            return {}, network.socket()
        case "listen":
            return {}, network.listen(**given)
    raise ValueError(f"nobody knows how to {do}")


def _next(wire: socket.socket, emulator_fd: int) -> dict[str, Any] | None:
    """Return the next message; ``None``: the emulator has gone."""
    poll = select.poll()
    poll.register(wire, select.POLLIN)
    poll.register(emulator_fd, select.POLLIN)
    ready = dict(poll.poll())
    if wire.fileno() not in ready:
        return None
    try:
        data = wire.recv(_LONGEST)
    except ConnectionResetError:  # it has gone without reading our last answer
        return None
    return json.loads(data) if data else None


def _say(wire: socket.socket, answer: dict[str, Any], descriptors: list[int] | None = None) -> None:
    with contextlib.suppress(OSError):
        socket.send_fds(wire, [json.dumps(answer).encode()], descriptors or [])
