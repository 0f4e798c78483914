"""The check of delays: each answer, on its line, against the time after which its driver gives up."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from firmware_protocols.check.host import Host, Subject
from firmware_protocols.check.report import Fault
from firmware_protocols.commands import Command
from firmware_protocols.connectors import Can, Connector, Serial
from firmware_protocols.frames import payload, text_of

PATIENCE_NS = 10_000_000_000
"""The time for which an answer is awaited."""
LONG_MS = 100.0
"""The delay from which on a report names the slowest answer."""
CAN_BITS_PER_FRAME = 64
"""The bits of a CAN frame beside its data."""


def faults(subject: Subject) -> Iterator[Fault]:
    """Yield commands whose answer comes later than their driver waits."""
    for command in subject.commands:
        if command.within_ms is None or command.reply is None:
            continue
        took = _delay_ms(subject, command)
        if took > command.within_ms:
            text = f"is answered after {took:.4g} ms, line included; its driver gives up after {command.within_ms:g} ms"
            yield Fault("timing", f"{command.name!r}: {text}", data=text_of(command.frame))


def described(subject: Subject) -> list[str]:
    """Return a line that names the slowest answer, if it is slow and no command says how long its driver waits."""
    asked = [command for command in subject.commands if command.reply is not None]
    if not asked or any(command.within_ms is not None for command in asked):
        return []
    slowest, name = max((_delay_ms(subject, command), command.name) for command in asked)
    return [f"the slowest answer, to {name!r}, takes {slowest:.4g} ms: no command has within_ms"] * (slowest > LONG_MS)


def _delay_ms(subject: Subject, command: Command) -> float:
    """Return the time from the first bit of a request to the last of its answer."""
    host = Host(subject.make(), 0.5)
    host.prepare(command)
    start_ns, host.latest_ns = host.t_ns, host.t_ns
    answers = host.send_stages(command)
    if not command.agrees(answers):
        answers += host.wait(PATIENCE_NS)
    device = host.device
    line = device.connector(command.port or device.ports[0].name)
    on_line_s = sum(_seconds(line, frame) for frame in [*command.stages, *answers])
    return (host.latest_ns - start_ns) / 1e6 + 1000 * on_line_s


def _seconds(line: Connector, frame: Any) -> float:
    """Return the time that a frame takes on a line."""
    size = len(payload(frame))
    if isinstance(line, Can):
        return CAN_BITS_PER_FRAME / line.bitrate + 8 * size / (line.data_bitrate or line.bitrate)
    if isinstance(line, Serial) and not line.is_cdc:
        return size * line.bits_per_byte / line.baud
    return 0.0
