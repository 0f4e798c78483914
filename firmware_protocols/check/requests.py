"""What a driver sends: each documented command in every way that a line can deliver it, and nonsense."""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from firmware_protocols.calls import AuthorError, run, source_line
from firmware_protocols.check.host import SECOND, Host, Subject, carries_bytes, shown
from firmware_protocols.check.nonsense import reframed
from firmware_protocols.check.report import Fault
from firmware_protocols.commands import Command
from firmware_protocols.frames import FD_LENGTHS, CanFrame, text_of

PUSH = 0.5
TRIES = 100
"""Seconds after which a device that got nonsense answers again."""


def faults(subject: Subject, fuzz: int) -> Iterator[Fault]:
    """Answers that are not as documented; requests, whole or spoiled, that a device does not survive."""
    for command in subject.commands:
        for check in (_answered, _in_pieces, _after_half_and_restart, _with_nonsense):
            try:
                found = list(check(subject, command))
            except AuthorError as error:
                found = [Fault.of("commands", error, f"{command.name!r}: ")]
            yield from found
            if found:
                break
    try:
        yield from _fuzzed(subject, fuzz)
    except AuthorError as error:
        yield Fault.of("commands", error, "spoiled requests: ")
    try:
        yield from _around(subject)
    except AuthorError as error:
        yield Fault.of("lines", error)


def _around(subject: Subject) -> Iterator[Fault]:
    """Modem lines in every state, and where the actuators are after each command."""
    host = Host(subject.make(), PUSH)
    for port in [each.name for each in host.device.ports]:
        for dtr, rts in ((True, True), (False, True), (True, False), (False, False)):
            host.modem(dtr, rts, port)
            host.wait()
    for request, port in [(None, ""), *subject.asked()]:
        if request is not None:
            host.send(request, port)
            host.wait()
        angles = run(host.device, "joints", host.t_ns)
        if not isinstance(angles, Mapping) or not all(np.isfinite(float(each)) for each in angles.values()):
            after = f" after {text_of(request)}" if request is not None else ""
            text = f"joints are {angles!r}{after}: return a mapping of names to finite numbers [rad, m]"
            yield Fault("joints", text, *source_line(subject.cls, "joints"))
            return


def _fault(command: Command, text: str) -> Fault:
    return Fault("commands", f"{command.name!r}: {text}", data=text_of(command.frame))


def _said(command: Command, got: list[Any], how: str) -> Fault:
    wanted = command.reply if isinstance(command.reply, list | tuple) else [command.reply]
    if command.reply is None:
        expected = "silence"
    elif callable(command.reply):
        expected = "an answer that the command's own check takes"
    else:
        expected = ", ".join(each if isinstance(each, str) else shown([each]) for each in wanted[:3])
    return _fault(
        command,
        f"{text_of(command.frame).upper()} {how} is answered by {shown(got) or 'silence'}, documented: {expected}",
    )


def _answered(subject: Subject, command: Command) -> Iterator[Fault]:
    host = Host(subject.make(), PUSH)
    host.prepare(command)
    unknown = host.device.counters["unknown_command"]
    if not command.agrees(got := host.send(command.request, command.port) + host.wait()):
        yield _said(command, got, "whole")
    elif not got and host.device.counters["unknown_command"] > unknown:
        yield _fault(command, "it is documented, but not answered, and counted as unknown_command")


def _in_pieces(subject: Subject, command: Command) -> Iterator[Fault]:
    if not carries_bytes(subject, command):
        return
    request = command.frame
    assert isinstance(request, bytes)
    half = len(request) // 2
    ways = {
        "byte by byte": [request[k : k + 1] for k in range(len(request))],
        "in halves": [request[:half], request[half:]],
        "with an empty chunk before it": [b"", request],
    }
    for how, pieces in ways.items():
        host = Host(subject.make(), PUSH)
        host.prepare(command)
        got = [frame for piece in pieces for frame in host.send(piece, command.port)] + host.wait()
        if not command.agrees(got):
            yield _said(command, got, how)
            return
    host = Host(subject.make(), PUSH)
    host.prepare(command)
    first = host.send(request + request[:half], command.port)
    if host.device.wake_ns is not None or host.restarts:
        return  # it takes a silence for the end of a request, or forgets what comes after it
    if not command.agrees(first):
        yield _said(command, first, "with half of the next request behind it")
    elif bool(host.send(request[half:], command.port)) != bool(first):
        yield _fault(command, "the next request, whose first half came in the same chunk, is lost")


def _after_half_and_restart(subject: Subject, command: Command) -> Iterator[Fault]:
    host = Host(subject.make(), PUSH)
    request = command.frame
    if isinstance(request, bytes):
        host.prepare(command)
        host.send(request[: len(request) // 2], command.port)
    host.device.flash.clear()
    host.restart()
    if not command.agrees(got := host.ask(command)):
        yield _said(command, got, "after half of itself and a restart")


def _with_nonsense(subject: Subject, command: Command) -> Iterator[Fault]:
    host = Host(subject.make(), PUSH)
    host.prepare(command)
    for n, request in reframed(subject.cls, command.frame):
        try:
            host.send(request, command.port)
        except AuthorError as error:
            yield Fault.of("commands", error, f"{command.name!r} with {n} bytes of data: ")
            return


def _fuzzed(subject: Subject, count: int) -> Iterator[Fault]:
    requests = subject.asked()
    rng, host = random.Random(subject.cls.__name__), Host(subject.make(), PUSH)
    ports = [port.name for port in host.device.ports]
    for _ in range(count):
        request, port = rng.choice(requests) if requests else (rng.randbytes(8), rng.choice(ports))
        connects = host.device.connector(port) if port else host.device.ports[0]
        if not requests and type(connects).__name__ == "Can":
            request = CanFrame(arbitration_id=rng.getrandbits(11), data=request)
        host.wait(2 * SECOND // 1000)
        if isinstance(request, CanFrame):
            host.send(spoil_frame(request, rng), port)
        else:
            spoiled = spoil(request, rng)
            cut = rng.randrange(len(spoiled) + 1)
            host.send(spoiled[:cut], port)
            host.send(spoiled[cut:], port)
        if rng.random() < 0.02:
            host.pushes = rng.uniform(-1.0, 30.0)
            host.convert()
    if count and not sum(host.device.counters.values()):
        yield Fault("commands", "what came was not counted: use self.counters")
    if mute := _mute(host, subject):
        yield mute
    host.pushes = PUSH
    for command in subject.commands:
        host.device.flash.clear()
        host.restart()
        host.wait(10 * SECOND)
        if not command.agrees(got := host.ask(command)):
            yield _said(command, got, f"after {count} spoiled requests and a restart")


def _mute(host: Host, subject: Subject) -> Fault | None:
    """What awaits an answer gets one without a restart, at the latest when what was half received is over."""
    asked = [command for command in subject.commands if command.reply is not None]
    for _ in range(TRIES if asked else 0):
        host.wait(SECOND)
        if any(host.ask(command) for command in asked):
            return None
    if asked:
        return _fault(asked[0], f"spoiled requests made it mute for more than {TRIES} s")
    return None


def spoil(data: bytes, rng: random.Random) -> bytes:
    """Return one to four random changes: bits flipped, bytes dropped, put in, or replaced by noise; or cut, or
    doubled.
    """
    out = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(out) + 1)
        match rng.randrange(6):
            case 0 if at < len(out):
                out[at] ^= 1 << rng.randrange(8)
            case 1 if at < len(out):
                del out[at]
            case 2:
                out.insert(at, rng.randrange(256))
            case 3:
                del out[at:]
            case 4:
                out += out[at:]
            case _:
                out[at : at + 1] = rng.randbytes(rng.randint(0, 6))
    return bytes(out[:4096])


def spoil_frame(frame: CanFrame, rng: random.Random) -> CanFrame:
    """Other data; now and then another identifier, an extended one, or a remote frame."""
    longest = 64 if frame.is_fd else 8
    data = b"" if (remote := rng.random() < 0.05) else spoil(frame.data, rng)[:longest]
    if frame.is_fd and not remote:
        data = data.ljust(next(size for size in FD_LENGTHS if size >= len(data)), b"\0")
    extended = frame.is_extended_id or rng.random() < 0.05
    ident = rng.getrandbits(29 if extended else 11) if rng.random() < 0.2 else frame.arbitration_id
    return replace(
        frame, arbitration_id=ident, data=data, is_extended_id=extended, is_remote_frame=remote,
        is_fd=frame.is_fd and not remote, bitrate_switch=frame.bitrate_switch and not remote,
    )  # fmt: skip
