"""The keeper: the process that makes the namespaces and the view in them, and changes it on request of the emulator.

:mod:`tactemu.exec.environment` starts it; it needs nothing but the standard library. When the emulator ends,
however it does, everything is unplugged and the keeper ends; the namespaces end with the last process in them.

Messages are JSON, one in a packet: the answer to ``{"do": "plug", ...}`` is ``{...}`` with descriptors beside it, or
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

_MAX_MESSAGE_BYTES = 65_536


def main(descriptor: int, emulator: int, preload: str) -> None:
    """Serve the emulator, process id ``emulator``, at the other end of the socket ``descriptor``.

    ``preload`` is the path of the preload library, or empty.
    """
    for number in (signal.SIGINT, signal.SIGQUIT, signal.SIGHUP, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # the keeper must not end before the emulator
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
    """Move this process into a mount namespace that it owns; without root, inside a new user namespace.

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
    system.mount(
        "", "/", flags=system.MS_REC | system.MS_SLAVE
    )  # new mounts stay in the view; those of the machine still appear in it


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
    raise ValueError(f"the keeper has no request {do!r}")


def _next(wire: socket.socket, emulator_fd: int) -> dict[str, Any] | None:
    """Return the next message, or None if the emulator has ended."""
    poll = select.poll()
    poll.register(wire, select.POLLIN)
    poll.register(emulator_fd, select.POLLIN)
    ready = dict(poll.poll())
    if wire.fileno() not in ready:
        return None
    try:
        data = wire.recv(_MAX_MESSAGE_BYTES)
    except ConnectionResetError:  # the emulator has ended without reading the last answer
        return None
    return json.loads(data) if data else None


def _say(wire: socket.socket, answer: dict[str, Any], descriptors: list[int] | None = None) -> None:
    with contextlib.suppress(OSError):
        socket.send_fds(wire, [json.dumps(answer).encode()], descriptors or [])
