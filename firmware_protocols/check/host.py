"""The smallest runner: it feeds one device as a skin and a driver would, on a clock of its own."""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from firmware_protocols import calls
from firmware_protocols.check.readings import Pushes, reading_of
from firmware_protocols.commands import Command
from firmware_protocols.device import Convert, Device, Restart, Sent
from firmware_protocols.frames import frame_of, text_of
from firmware_protocols.options import checked
from firmware_protocols.state import NotPlain

SECOND = 1_000_000_000
STEP = SECOND // 10
"""Between two requests: longer than a firmware waits for the rest of one."""
MOST_WAKES = 10_000


@dataclass
class Subject:
    """What is checked: a class with its options."""

    target: str
    """Its name, or ``path/to/file.py:Class``."""
    cls: type[Device]
    options: Mapping[str, Any] = field(default_factory=dict)
    _first: dict[str, tuple[Device, dict[str, Any]]] = field(default_factory=dict)
    """By options: a device that has just powered up, and its state."""

    @cached_property
    def given(self) -> dict[str, Any]:
        """The options as the class declares them."""
        return checked(self.cls, self.options)

    def build(self, options: Mapping[str, Any] | None = None) -> Device:
        """Return a device that has powered up.

        Raises:
            AuthorError: its ``__init__`` raised.
            ValueError: an option that it does not take.
        """
        given = self.given if options is None or options == self.options else checked(self.cls, options)
        try:
            return self.cls(**given)
        except Exception as error:
            raise calls.error_of_exception(self.cls, self.cls.__name__, "__init__", (), error) from error

    def make(self, options: Mapping[str, Any] | None = None) -> Device:
        """As :meth:`build`, from a snapshot of the first: some layouts take 10 ms to build."""
        key = repr(dict(self.options if options is None else options))
        if key not in self._first:
            device = self.build(options)
            try:
                self._first[key] = device, device.snapshot()
            except NotPlain:
                return device
        first, state = self._first[key]
        device = self.cls.__new__(self.cls, **first.options)
        vars(device)["layout"] = first.layout
        device.restore(state)
        return device

    @contextmanager
    def changed(self) -> Iterator[None]:
        """While a declared fact is another one, devices are built anew."""
        kept, self._first = self._first, {}
        try:
            yield
        finally:
            self._first = kept

    @cached_property
    def commands(self) -> tuple[Command, ...]:
        """As the device with these options documents them."""
        device = self.make()
        try:
            return device.commands
        except Exception as error:
            raise calls.error_of_exception(self.cls, device.name, "commands", (), error) from error

    def asked(self) -> list[tuple[Any, str]]:
        """Return every documented request, and what goes before it, with its port."""
        return [
            (frame_of(each), command.port) for command in self.commands for each in (*command.after, command.request)
        ]


class Host:
    """One device, powered up, with a push on its skin [N].

    Every method may raise :class:`~firmware_protocols.calls.AuthorError`.
    """

    def __init__(self, device: Device, pushes: Pushes = 0.0, t_ns: int = 0):
        self.device, self.pushes, self.t_ns = device, pushes, t_ns
        self.restarts = 0
        self.boot()

    def boot(self) -> list[Any]:
        """Return the silence after power-up, a first conversion of every stream, the banner."""
        self.t_ns += round(1e9 * self.device.boot_s)
        for stream in self.device.periods:
            self.measure(stream)
        return self._obeyed("boot", self.t_ns)

    def restart(self) -> list[Any]:
        """Power off and on."""
        self.restarts += 1
        try:
            self.device.power_cycle()
        except Exception as error:
            raise calls.error_of_exception(type(self.device), self.device.name, "__init__", (), error) from error
        return self.boot()

    def measure(self, stream: str = "", **values: Any) -> Any:
        """Return one conversion that sends nothing; the counts."""
        return calls.measure(self.device, reading_of(self.device, self.pushes, stream, **values), self.t_ns)

    def streamed(self, stream: str) -> list[Any]:
        """Return the frames after a conversion of one stream."""
        return self._obeyed("stream", self.t_ns, stream)

    def convert(self, **values: Any) -> list[Any]:
        """Return one conversion of every stream that runs; the frames."""
        sent = []
        for stream in [name for name, period in self.device.periods.items() if period]:
            self.measure(stream, **values)
            sent += self.streamed(stream)
        return sent

    def send(self, request: Any, port: str = "") -> list[Any]:
        """Return the frames that answer, those of conversions that it asks for included."""
        return self._obeyed("receive", frame_of(request), self.t_ns, port or self.device.ports[0].name)

    def wait(self, span_ns: int = STEP) -> list[Any]:
        """Time passes; what the device does when it wakes."""
        end_ns, sent, woken = self.t_ns + span_ns, [], 0
        while (wake_ns := self.device.wake_ns) is not None and wake_ns <= end_ns:
            self.t_ns, self.device.wake_ns = max(self.t_ns, wake_ns), None
            sent += self._obeyed("wake", self.t_ns)
            woken += 1
            if woken > MOST_WAKES:
                raise calls.error_of_result(
                    self.device, "wake", f"was called {woken} times: it sets wake_ns to a time past"
                )
        self.t_ns = end_ns
        return sent

    def modem(self, dtr: bool, rts: bool, port: str) -> list[Any]:
        """Return the frames that leave when modem lines move, or a port is opened or closed."""
        return self._obeyed("lines", dtr, rts, self.t_ns, port)

    def ask(self, command: Command) -> list[Any]:
        """Return the frames that answer a documented command, late ones included."""
        self.prepare(command)
        return self.send(command.request, command.port) + self.wait()

    def prepare(self, command: Command) -> None:
        """What goes before a command."""
        for request in command.after:
            self.send(request, command.port)
            self.wait()

    def _obeyed(self, method: str, *args: Any) -> list[Any]:
        port = args[2] if method == "receive" else args[3] if method == "lines" else ""
        frames, restarted = [], False
        for out in calls.transmissions(self.device, method, *args, port=port):
            if isinstance(out, Restart):
                restarted = True
            elif isinstance(out, Convert):
                self.t_ns += out.delay_ns
                self.measure(out.stream)
                frames += self.streamed(out.stream)
            else:
                frames.append(out.frame if isinstance(out, Sent) else out)
        return frames + self.restart() if restarted else frames


def story(host: Host, subject: Subject, seed: int, rounds: int = 2) -> list[Any]:
    """Return a life with pushes, requests and halves of requests, the same for the same seed; the frames sent."""
    rng, sent = random.Random(seed), []
    for _ in range(rounds):
        for port in [each.name for each in host.device.ports]:
            sent += host.modem(True, rng.random() < 0.5, port)
        for request, port in subject.asked():
            host.pushes = rng.uniform(0.0, 5.0)
            sent += [*host.convert(), *host.send(request, port), *host.wait(rng.randrange(1, STEP)), *host.convert()]
            if isinstance(request, bytes) and rng.random() < 0.3:
                sent += [*host.send(request[: len(request) // 2], port), *host.wait(rng.randrange(1, 3 * STEP))]
        host.pushes = rng.uniform(0.0, 5.0)
        sent += host.convert() + host.convert()
    return sent


def carries_bytes(subject: Subject, command: Command) -> bool:
    """Whether requests of a command come in chunks of any size."""
    device = subject.make()
    port = command.port or device.ports[0].name
    return not device.connector(port).is_framed


def shown(frames: Sequence[Any]) -> str:
    """Return frames for a message, long ones cut."""
    texts = [text_of(frame).upper() for frame in frames[:3]]
    return ", ".join(text if len(text) <= 80 else text[:79] + "…" for text in texts) + (" …" if len(frames) > 3 else "")
