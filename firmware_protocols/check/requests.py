"""The check of requests: each documented command, whole and in pieces, malformed and corrupted."""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from firmware_protocols.calls import AuthorError, run, source_line
from firmware_protocols.check.host import SECOND_NS, Host, Subject, carries_bytes, frames_text
from firmware_protocols.check.malformed import malformed_requests
from firmware_protocols.check.report import Fault
from firmware_protocols.commands import Command
from firmware_protocols.frames import FD_LENGTHS, CanFrame, text_of

PUSH_N = 0.5
"""The push on every taxel."""
MUTE_TIMEOUT_S = 100
"""The time after which a device must answer again after corrupted requests."""


def faults(subject: Subject, fuzz: int) -> Iterator[Fault]:
    """Yield answers that are not as documented, and requests, whole or corrupted, that a device does not survive."""
    for command in subject.commands:
        for check in (_check_answer, _check_pieces, _check_restart, _check_malformed):
            try:
                found = list(check(subject, command))
            except AuthorError as error:
                found = [Fault.of("commands", error, f"{command.name!r}: ")]
            yield from found
            if found:
                break
    try:
        yield from _check_corrupted(subject, fuzz)
    except AuthorError as error:
        yield Fault.of("commands", error, "corrupted requests: ")
    try:
        yield from _check_lines_and_joints(subject)
    except AuthorError as error:
        yield Fault.of("lines", error)


def _check_lines_and_joints(subject: Subject) -> Iterator[Fault]:
    """Set the modem lines to every state, and yield joints that are no finite numbers after a command."""
    host = Host(subject.make(), PUSH_N)
    for port in [each.name for each in host.device.ports]:
        for dtr, rts in ((True, True), (False, True), (True, False), (False, False)):
            host.modem(dtr, rts, port)
            host.wait()
    for request, port in [(None, ""), *subject.requests()]:
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


def _answer_fault(command: Command, got: list[Any], how: str) -> Fault:
    wanted = command.reply if isinstance(command.reply, list | tuple) else [command.reply]
    if command.reply is None:
        expected = "silence"
    elif callable(command.reply):
        expected = "an answer that the command's own check accepts"
    else:
        expected = ", ".join(each if isinstance(each, str) else frames_text([each]) for each in wanted[:3])
    answer = frames_text(got) or "silence"
    return _fault(command, f"{text_of(command.frame).upper()} {how} is answered by {answer}, documented: {expected}")


def _check_answer(subject: Subject, command: Command) -> Iterator[Fault]:
    host = Host(subject.make(), PUSH_N)
    host.prepare(command)
    unknown = host.device.counters["unknown_command"]
    if not command.agrees(got := host.send_stages(command) + host.wait()):
        yield _answer_fault(command, got, "whole")
    elif not got and host.device.counters["unknown_command"] > unknown:
        yield _fault(command, "it is documented, but counted as unknown_command and not answered")


def _check_pieces(subject: Subject, command: Command) -> Iterator[Fault]:
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
        host = Host(subject.make(), PUSH_N)
        host.prepare(command)
        got = [frame for piece in pieces for frame in host.send(piece, command.port)] + host.wait()
        if not command.agrees(got):
            yield _answer_fault(command, got, how)
            return
    host = Host(subject.make(), PUSH_N)
    host.prepare(command)
    first_stage = command.stages[0]
    assert isinstance(first_stage, bytes)
    half = len(first_stage) // 2
    first = host.send(request + first_stage[:half], command.port)
    if host.device.wake_ns is not None or host.restarts:
        return  # a silence ends its requests, or it restarts and forgets the bytes after the request
    if not command.agrees(first):
        yield _answer_fault(command, first, "with half of the next request behind it")
    elif bool(host.send(request[half:], command.port)) != bool(first):
        yield _fault(command, "the next request, whose first half came in the same chunk, is lost")


def _check_restart(subject: Subject, command: Command) -> Iterator[Fault]:
    host = Host(subject.make(), PUSH_N)
    request = command.frame
    if isinstance(request, bytes):
        host.prepare(command)
        host.send(request[: len(request) // 2], command.port)
    host.device.flash.clear()
    host.restart()
    if not command.agrees(got := host.ask(command)):
        yield _answer_fault(command, got, "after half of itself and a restart")


def _check_malformed(subject: Subject, command: Command) -> Iterator[Fault]:
    host = Host(subject.make(), PUSH_N)
    host.prepare(command)
    for n, request in malformed_requests(subject.cls, command.frame):
        try:
            host.send(request, command.port)
        except AuthorError as error:
            yield Fault.of("commands", error, f"{command.name!r} with {n} bytes of data: ")
            return


def _check_corrupted(subject: Subject, count: int) -> Iterator[Fault]:
    requests = subject.requests()
    rng, host = random.Random(subject.cls.__name__), Host(subject.make(), PUSH_N)
    ports = [port.name for port in host.device.ports]
    for _ in range(count):
        request, port = rng.choice(requests) if requests else (rng.randbytes(8), rng.choice(ports))
        connects = host.device.connector(port) if port else host.device.ports[0]
        if not requests and type(connects).__name__ == "Can":
            request = CanFrame(arbitration_id=rng.getrandbits(11), data=request)
        host.wait(2 * SECOND_NS // 1000)
        if isinstance(request, CanFrame):
            host.send(corrupt_frame(request, rng), port)
        else:
            corrupted = corrupt(request, rng)
            cut = rng.randrange(len(corrupted) + 1)
            host.send(corrupted[:cut], port)
            host.send(corrupted[cut:], port)
        if rng.random() < 0.02:
            host.pushes = rng.uniform(-1.0, 30.0)
            host.convert()
    if count and not sum(host.device.counters.values()):
        yield Fault("commands", "received requests are not counted: use self.counters")
    if mute := _mute(host, subject):
        yield mute
    host.pushes = PUSH_N
    for command in subject.commands:
        host.device.flash.clear()
        host.restart()
        host.wait(10 * SECOND_NS)
        if not command.agrees(got := host.ask(command)):
            yield _answer_fault(command, got, f"after {count} corrupted requests and a restart")


def _mute(host: Host, subject: Subject) -> Fault | None:
    """Return a fault if no command is answered again, without a restart, after corrupted requests."""
    answered = [command for command in subject.commands if command.reply is not None]
    for _ in range(MUTE_TIMEOUT_S if answered else 0):
        host.wait(SECOND_NS)
        if any(host.ask(command) for command in answered):
            return None
    if answered:
        return _fault(answered[0], f"it is mute for more than {MUTE_TIMEOUT_S} s after corrupted requests")
    return None


def corrupt(data: bytes, rng: random.Random) -> bytes:
    """Return the data with one to four random changes: bits flipped, bytes dropped, inserted, replaced, doubled."""
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


def corrupt_frame(frame: CanFrame, rng: random.Random) -> CanFrame:
    """Return the frame with other data; now and then with another or extended identifier, or as a remote frame."""
    longest = 64 if frame.is_fd else 8
    data = b"" if (remote := rng.random() < 0.05) else corrupt(frame.data, rng)[:longest]
    if frame.is_fd and not remote:
        data = data.ljust(next(size for size in FD_LENGTHS if size >= len(data)), b"\0")
    extended = frame.is_extended_id or rng.random() < 0.05
    ident = rng.getrandbits(29 if extended else 11) if rng.random() < 0.2 else frame.arbitration_id
    return replace(
        frame, arbitration_id=ident, data=data, is_extended_id=extended, is_remote_frame=remote,
        is_fd=frame.is_fd and not remote, bitrate_switch=frame.bitrate_switch and not remote,
    )  # fmt: skip
