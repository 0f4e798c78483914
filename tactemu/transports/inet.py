"""Addresses ``HOST:PORT`` of this machine's network ports."""

from __future__ import annotations

import ipaddress
import logging
import socket

from tactemu.base.errors import TransportError, reason_of

_logger = logging.getLogger(__name__)


def parse(scheme: str, location: str) -> tuple[str, int]:
    """Return host and port of ``PORT`` or ``HOST:PORT``; the default host is loopback.

    Raises:
        TransportError: it is neither.
    """
    host, _, port = location.rpartition(":")
    host = host.removeprefix("[").removesuffix("]") or "127.0.0.1"
    if not port.isdecimal() or int(port) > 65_535:
        raise TransportError(
            f"port '{scheme}:{location}': expected {scheme}:PORT or {scheme}:HOST:PORT, PORT 0 to 65535"
        )
    return host, int(port)


def join(host: str, port: int) -> str:
    """Return ``HOST:PORT``, with an IPv6 address in brackets."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def resolve(host: str, port: int, kind: socket.SocketKind) -> tuple[socket.AddressFamily, tuple[str, int]]:
    """Return family and address to bind to.

    Raises:
        OSError: no such host.
    """
    family, _, _, _, where = socket.getaddrinfo(host, port, type=kind)[0]
    return family, (str(where[0]), int(where[1]))


def cannot_listen(scheme: str, host: str, port: int, error: OSError) -> TransportError:
    """Return the error of a port that cannot be listened on."""
    return TransportError(
        f"cannot listen on {join(host, port)}: {reason_of(error)}; choose another port ({scheme}:0 takes a free one)"
    )


def warn_if_reachable(address: str, host: str) -> None:
    """Log a warning where other machines can reach a port."""
    if not ipaddress.ip_address(host).is_loopback:
        _logger.warning("%s: everyone on the network may connect and command the device", address)
