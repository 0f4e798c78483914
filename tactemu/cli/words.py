"""Words of the command line that stand for tables: ``axes=6``, ``thumb=pty:/tmp/a``, ``imu=1000``."""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated

from tactemu.base.errors import DeviceError, SceneError, TactemuError, TransportError

_OWNER = re.compile(r"[^:=]+=")
"""The name of a skin or a connector in front of a port."""
_QUANTITIES = {
    "Seconds": ("DURATIONS_S", "a time such as 90s, 500ms or 5m"),
    "Hertz": ("RATES_HZ", "a rate such as 100 or 100Hz"),
}
"""The table of units of each kind of quantity, and examples for messages."""


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


def quantity(option: str, text: str | float, kind: str, **bounds: float) -> float:
    """Return a duration or a rate that may have a unit: ``90``, ``90s``, ``500ms``, ``5m``; ``100``, ``100Hz``.

    Args:
        option: the option, for the message.
        text: what was typed, or the option's default.
        kind: ``Seconds`` or ``Hertz``, of :mod:`tactemu.base.units`.
        bounds: the option's own bounds, where they are narrower.

    Raises:
        SceneError: it is neither, or out of bounds.
    """
    from tactemu.base import units
    from tactemu.base.options import number

    table, such = _QUANTITIES[kind]
    try:
        given = float(text)
    except ValueError:
        given = units.scaled(str(text).replace(" ", ""), getattr(units, table))
    if given is None:
        raise SceneError(f"{option}: expected {such}, got {text!r}")
    base, limits = getattr(units, kind).__origin__, getattr(units, kind).__metadata__[0]
    return number("command line", option, given, Annotated[base, replace(limits, **bounds)])


def rate_of(words: Sequence[str]) -> float | dict[str, float] | None:
    """Return ``["200"]`` as a number, ``["touch=200", "imu=1000"]`` as a dictionary by stream.

    Raises:
        SceneError: a word is no rate, or one of several has no stream.
    """
    rates: dict[str, float] = {}
    for word in words:
        stream, _, hz = word.rpartition("=")
        rates[stream] = quantity(f"--rate {stream}=" if stream else "--rate", hz, "Hertz")
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
