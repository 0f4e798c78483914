"""The check of bytes that are no request: one before, amid and behind each documented request, in one chunk."""

from __future__ import annotations

from collections.abc import Iterator

from firmware_protocols.check.host import SECOND_NS, Host, Subject, carries_bytes
from firmware_protocols.check.report import Fault
from firmware_protocols.commands import Command
from firmware_protocols.connectors import Serial

PLACES = ("before", "amid", "behind")
RECOVERY_NS = 2 * SECOND_NS
"""The silence after the garbage, longer than any firmware waits for the end of a request."""
REQUESTS = 200
"""The number of requests after which a device must answer again: a length that garbage has changed asks for more."""


def faults(subject: Subject) -> Iterator[Fault]:
    """Yield commands that are never answered again after a byte of garbage."""
    for command in _askable(subject):
        if not _answers(Host(subject.make(), 0.5), command):
            continue
        for place in PLACES:
            host = Host(subject.make(), 0.5)
            host.prepare(command)
            host.send(_spoilt(command.frame, place), command.port)
            host.wait(RECOVERY_NS)
            if host.restarts or any(_answers(host, command) for _ in range(REQUESTS)):
                continue
            text = (
                f"{command.name!r}: one byte of garbage {place} it, and no request is answered any more, {REQUESTS} "
                "times, 2 s apart: skip what is no request (Packets does)"
            )
            yield Fault("garbage", text, data=_spoilt(command.frame, place).hex())
            return


def described(subject: Subject) -> list[str]:
    """Return a line that says what the device does with one byte of garbage in the chunk of a request."""
    commands = [command for command in _askable(subject) if command.stages == [command.frame]]
    counts = dict.fromkeys(PLACES, 0)
    for command in commands:
        for place in PLACES:
            host = Host(subject.make(), 0.5)
            host.prepare(command)
            counts[place] += command.agrees(host.send(_spoilt(command.frame, place), command.port) + host.wait())
    if not commands:
        return []
    answered = ", ".join(f"{place} it {count}" for place, count in counts.items())
    return [f"of {len(commands)} requests with one byte of garbage in the chunk are answered: {answered}"]


def _askable(subject: Subject) -> list[Command]:
    """Return the commands with an answer on a serial line."""
    device = subject.make()
    return [
        command
        for command in subject.commands
        if command.reply is not None
        and carries_bytes(subject, command)
        and isinstance(device.connector(command.port or device.ports[0].name), Serial)
    ]


def _answers(host: Host, command: Command) -> bool:
    host.prepare(command)
    answers = host.ask(command)
    host.wait(RECOVERY_NS)
    return bool(answers)


def _spoilt(request: object, place: str) -> bytes:
    """Return a request with a byte that it does not contain before, amid or behind it."""
    assert isinstance(request, bytes)
    byte = bytes([next(each for each in (0x2E, 0x00, 0x5F, 0x3B, 0x77) if each not in request)])
    at = {"before": 0, "amid": len(request) // 2 + (len(request) == 1), "behind": len(request)}[place]
    return request[:at] + byte + request[at:]
