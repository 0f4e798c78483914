"""A USB/IP server: lists devices and gives each to one host; several ports of one process may share it.

USB/IP knows no passwords: whoever reaches the port can attach the devices. It listens on loopback unless asked.

The devices may belong to several emulators, each with a loop in a thread of its own. Whichever loop wakes first serves;
the server's one file descriptor, an epoll, stays valid for all of them.
"""

from __future__ import annotations

import contextlib
import select
import socket
import threading
from dataclasses import dataclass, field

from tactemu.transports import inet
from tactemu.transports.forks import close_in_children
from tactemu.transports.usb import usbip_protocol as protocol
from tactemu.transports.usb.chip import Chip
from tactemu.transports.usb.shared_device import SharedDevice

MAX_GREETINGS = 16
"""Maximum number of clients that have connected and not asked for anything yet; further ones are closed."""


@dataclass(eq=False)
class Export:
    """A device that a server offers."""

    busid: str
    number: int
    shared: SharedDevice

    def about(self) -> bytes:
        """Return what a list says of it."""
        own = self.shared.chip.descriptors()
        return protocol.about(self.busid, self.number, own.device(), len(own.interfaces))

    def interfaces(self) -> bytes:
        """Return the class codes of its interfaces."""
        return b"".join(bytes((*each.code, 0)) for each in self.shared.chip.descriptors().interfaces)


@dataclass(eq=False)
class UsbIpServer:
    """A server of all devices on one address.

    Raises:
        TransportError: the address is not of this machine, or the port is taken.
    """

    host: str
    port: int
    exports: dict[str, Export] = field(default_factory=dict)

    def __post_init__(self):
        try:
            family, where = inet.resolve(self.host, self.port, socket.SOCK_STREAM)
            self._socket = socket.create_server(where, family=family, backlog=MAX_GREETINGS)
        except OSError as error:
            raise inet.cannot_listen("usbip", self.host, self.port, error) from None
        self._socket.setblocking(False)
        self._ready = select.epoll()
        self._ready.register(self._socket, select.EPOLLIN)
        self._lock = threading.Lock()
        self.port = self._socket.getsockname()[1]
        self._greetings: list[socket.socket] = []
        """Connections that have not asked for a list or a device yet."""
        self.is_open = True
        close_in_children(self)
        inet.warn_if_reachable(f"usbip:{inet.join(self.host, self.port)}", where[0])

    def plug_in(self, shared: SharedDevice, channel: Chip) -> str:
        """Offer a device with a channel of it, on the first free port of the hub, and return the port's name."""
        with self._lock:
            if shared.open(channel):
                number = next(n for n in range(1, 128) if f"1-{n}" not in self.exports)
                self.exports[f"1-{number}"] = Export(f"1-{number}", number + 1, shared)
            return next(each.busid for each in self.exports.values() if each.shared is shared)

    def unplug(self, shared: SharedDevice, channel: Chip) -> None:
        """Close a channel of a device, which is withdrawn with its last one; the server closes with the last device."""
        with self._lock:
            if shared.close(channel):
                self.exports = {busid: each for busid, each in self.exports.items() if each.shared is not shared}
        if not self.exports:
            self.close()

    def shared(self, chip: Chip, number: int | None) -> tuple[SharedDevice, Chip] | None:
        """Return a device of the same kind and identity that has this channel free, and the channel.

        Args:
            chip: what is wanted.
            number: the number of the channel; None: any.
        """
        with self._lock:
            for each in self.exports.values():
                other = each.shared.chip
                if type(other) is type(chip) and other.is_same_device(chip) and (channel := each.shared.take(number)):
                    return each.shared, channel
        return None

    def close(self) -> None:
        """Stop listening. Safe to call twice."""
        self.is_open = False
        for each in (*self._greetings, self._socket, self._ready):
            each.close()
        self._greetings.clear()

    def fileno(self) -> int:
        """Return the file descriptor that is readable when there is something to serve."""
        return self._ready.fileno()

    def serve(self) -> None:
        """Accept connections and answer their first requests. Never blocks; one thread at a time serves."""
        if not self._lock.acquire(blocking=False):
            return
        try:
            if self.is_open and self._ready.poll(0):
                self._accept()
                self._greetings = [client for client in self._greetings if not self._is_done(client)]
        finally:
            self._lock.release()

    def _accept(self) -> None:
        with contextlib.suppress(BlockingIOError):
            while True:
                client, _ = self._socket.accept()
                client.setblocking(False)
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._ready.register(client, select.EPOLLIN)
                self._greetings.append(client)
                if len(self._greetings) > MAX_GREETINGS:
                    self._greetings.pop(0).close()

    def _is_done(self, client: socket.socket) -> bool:
        """Answer the first request of a connection; return False if it has not come whole."""
        try:
            return self._greet(client)
        except OSError:
            client.close()
            return True

    def _greet(self, client: socket.socket) -> bool:
        """Answer the first request of a connection; return False if it has not come whole."""
        try:
            head = client.recv(protocol.OP.size + protocol.BUSID_BYTES, socket.MSG_PEEK)
        except BlockingIOError:
            return False
        if 0 < len(head) < protocol.OP.size:
            return False
        version, code, _ = protocol.OP.unpack_from(head) if head else (0, 0, 0)
        if code == protocol.OP_REQ_IMPORT and len(head) < protocol.OP.size + protocol.BUSID_BYTES:
            return False
        if version >> 8 == protocol.VERSION >> 8 and code == protocol.OP_REQ_IMPORT:
            client.recv(len(head))
            return self._import(client, head[protocol.OP.size :].rstrip(b"\0").decode(errors="replace"))
        if version >> 8 == protocol.VERSION >> 8 and code == protocol.OP_REQ_DEVLIST:
            client.recv(protocol.OP.size)
            devices = b"".join(export.about() + export.interfaces() for export in self.exports.values())
            count = len(self.exports).to_bytes(4, "big")
            client.sendall(protocol.OP.pack(protocol.VERSION, protocol.OP_REP_DEVLIST, 0) + count + devices)
        client.close()
        return True

    def _import(self, client: socket.socket, busid: str) -> bool:
        self._ready.unregister(client)
        export = self.exports.get(busid)
        is_given = export is not None and export.shared.is_free
        client.sendall(
            protocol.OP.pack(protocol.VERSION, protocol.OP_REP_IMPORT, 0 if is_given else 1)
            + (export.about() if is_given and export else b"")
        )
        if is_given and export:
            export.shared.give(client)
        return is_given or client.close() is None


_servers: dict[tuple[str, int], UsbIpServer] = {}
_servers_lock = threading.Lock()


def shared_server(host: str, port: int) -> UsbIpServer:
    """Return this process's server on an address; port 0 makes a new one on a free port.

    Raises:
        TransportError: it cannot listen there.
    """
    with _servers_lock:
        server = _servers.get((host, port)) if port else None
        if server is None or not server.is_open:
            server = UsbIpServer(host, port)
            _servers[host, server.port] = server
        return server
