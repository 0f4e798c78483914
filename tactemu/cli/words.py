"""Words of the command line that stand for tables: ``axes=6``, ``thumb=pty:/tmp/a``, ``imu=1000``."""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Sequence

from tactemu.base.errors import DeviceError, SceneError, TactemuError, TransportError

_OWNER = re.compile(r"[^:=]+=")
"""The name of a skin or a connector in front of a port."""
_BUDGET = re.compile(r"(\d+(?:\.\d+)?)\s*(s|m|h|)")


def typed_command() -> str:
    """Return the command line as the user typed it, for what it writes."""
    return f"tactemu {shlex.join(sys.argv[1:])}"


def options_of(words: Sequence[str]) -> dict[str, str]:
    """Return ``["axes=6"]`` as a dictionary.

    Raises:
        DeviceError: a word is no ``NAME=VALUE``.
    """
    from firmware_protocols.options import from_words

    try:
        return from_words(words)
    except ValueError as error:
        raise DeviceError(str(error)) from None


def rate_of(words: Sequence[str]) -> float | dict[str, float] | None:
    """Return ``["200"]`` as a number, ``["touch=200", "imu=1000"]`` as a dictionary by stream.

    Raises:
        SceneError: a word is no rate, or one of several has no stream.
    """
    rates: dict[str, float] = {}
    for word in words:
        stream, _, hz = word.rpartition("=")
        try:
            rates[stream] = float(hz)
        except ValueError:
            raise SceneError(f"--rate {word}: expected HZ, or STREAM=HZ") from None
    if len(words) > 1 and "" in rates:
        raise SceneError(f"--rate: with several rates, name the stream of each: --rate STREAM={rates['']:g}")
    return rates.get("", rates or None)


def ports_of(words: Sequence[str], thing: str = "port") -> str | dict[str, str] | None:
    """Return ``["pty:/tmp/skin"]`` as one port, ``["thumb=pty:/tmp/a", "palm=pty:/tmp/b"]`` by skin or connector; with
    ``thing`` node, the words are nodes.

    Raises:
        TransportError: one of several ports has no skin, or a skin has two.
    """
    if len(words) == 1 and not _OWNER.match(words[0]):
        return words[0]
    ports = {}
    for word in words:
        owner, given, port = word.partition("=")
        if not given or not _OWNER.match(word):
            raise TransportError(
                f"--{thing} {word}: with several {thing}s, name the skin of each: --{thing} SKIN={word}"
            )
        if owner in ports:
            raise TransportError(f"--{thing} {word}: {owner!r} has a {thing} already, {ports[owner]}")
        ports[owner] = port
    return ports or None


def network_ports_of(words: Sequence[str]) -> str | dict[str, str] | None:
    """Return the ports of ``--port``, as for `tactemu run`.

    Raises:
        TransportError: a port is not on the network; such a device has a node.
    """
    from tactemu.wire.line_models import network_schemes

    ports = ports_of(words)
    for port in ports.values() if isinstance(ports, dict) else filter(None, [ports]):
        if port.partition(":")[0] not in network_schemes():
            can = ", ".join(f"{scheme}:" for scheme in network_schemes())
            raise TransportError(f"--port {port}: only {can} are possible; name a serial port or CAN bus with --node")
    return ports


def pairs_of(option: str, text: str | None) -> dict[str, str] | None:
    """Return ``a=b,c=d`` as a dictionary.

    Raises:
        TactemuError: a part is no ``NAME=VALUE``.
    """
    if text is None:
        return None
    found = {}
    for part in text.split(","):
        name, mark, value = part.partition("=")
        if not (mark and name.strip() and value.strip()):
            raise TactemuError(f"{option}: expected NAME=VALUE, several with commas, got {part!r}")
        found[name.strip()] = value.strip()
    return found


def budget_of(text: str | None) -> float | None:
    """Return ``5m``, ``90s`` or ``90`` in seconds.

    Raises:
        TactemuError: the text is no time.
    """
    if text is None:
        return None
    match = _BUDGET.fullmatch(text.strip())
    if match is None or not float(match[1]):
        raise TactemuError(f"--budget: expected a time such as 90s or 5m, got {text!r}")
    return float(match[1]) * {"": 1, "s": 1, "m": 60, "h": 3600}[match[2]]
