"""The smallest runner of a device: it takes the place of skin and driver, on a clock of its own."""

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

SECOND_NS = 1_000_000_000
STEP_NS = SECOND_NS // 10
"""The time between two requests: longer than a firmware waits for the end of an incomplete one."""
MAX_WAKES = 10_000
"""The largest number of calls of ``wake`` in one step; finds a device that sets ``wake_ns`` to a past time."""


@dataclass
class Subject:
    """The subject of a check: a device class with options."""

    target: str
    """The registered name, or ``path/to/file.py:Class``."""
    cls: type[Device]
    options: Mapping[str, Any] = field(default_factory=dict)
    _first: dict[str, tuple[Device, dict[str, Any]]] = field(default_factory=dict)
    """The devices that have just powered up, with their states, by options."""

    @cached_property
    def checked_options(self) -> dict[str, Any]:
        """The options, converted to their declared types."""
        return checked(self.cls, self.options)

    def build(self, options: Mapping[str, Any] | None = None) -> Device:
        """Return a device that has powered up.

        Raises:
            AuthorError: its ``__init__`` raised.
            ValueError: the device has no such option, or its value is invalid.
        """
        given = self.checked_options if options is None or options == self.options else checked(self.cls, options)
        try:
            return self.cls(**given)
        except Exception as error:
            raise calls.error_of_exception(self.cls, self.cls.__name__, "__init__", (), error) from error

    def make(self, options: Mapping[str, Any] | None = None) -> Device:
        """Return a device as :meth:`build`, but restored from a snapshot: some layouts take 10 ms to build."""
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
    def without_snapshots(self) -> Iterator[None]:
        """Build devices without earlier snapshots within this context, while a declared fact is changed."""
        kept, self._first = self._first, {}
        try:
            yield
        finally:
            self._first = kept

    @cached_property
    def commands(self) -> tuple[Command, ...]:
        """The documented commands of the device with these options."""
        device = self.make()
        try:
            return device.commands
        except Exception as error:
            raise calls.error_of_exception(self.cls, device.name, "commands", (), error) from error

    def requests(self) -> list[tuple[Any, str]]:
        """Return every documented request, and the requests to send before it, with their port."""
        return [(frame_of(each), command.port) for command in self.commands for each in (*command.after, command.frame)]


class Host:
    """A host of one device that has powered up, with a push on its skin [N].

    Every method may raise :class:`~firmware_protocols.calls.AuthorError`.
    """

    def __init__(self, device: Device, pushes: Pushes = 0.0, t_ns: int = 0):
        self.device, self.pushes, self.t_ns = device, pushes, t_ns
        self.restarts = 0
        self.latest_ns = t_ns
        """The time at which the latest frame left."""
        self.boot()

    def boot(self) -> list[Any]:
        """Wait for the boot time, convert every stream once, and return the frames at the end of booting."""
        self.t_ns += round(1e9 * self.device.boot_s)
        for stream in self.device.periods:
            self.measure(stream)
        return self._call("boot", self.t_ns)

    def restart(self) -> list[Any]:
        """Power the device off and on, and return the frames at the end of booting."""
        self.restarts += 1
        try:
            self.device.power_cycle()
        except Exception as error:
            raise calls.error_of_exception(type(self.device), self.device.name, "__init__", (), error) from error
        return self.boot()

    def measure(self, stream: str = "", **values: Any) -> Any:
        """Run one conversion of a stream without its frames, and return the counts."""
        return calls.measure(self.device, reading_of(self.device, self.pushes, stream, **values), self.t_ns)

    def streamed(self, stream: str) -> list[Any]:
        """Return the frames after a conversion of one stream."""
        return self._call("stream", self.t_ns, stream)

    def convert(self, **values: Any) -> list[Any]:
        """Run one conversion of every stream that is not off, and return the frames."""
        sent = []
        for stream in [name for name, period in self.device.periods.items() if period]:
            self.measure(stream, **values)
            sent += self.streamed(stream)
        return sent

    def send(self, request: Any, port: str = "") -> list[Any]:
        """Send a request and return the answers, with the frames of conversions that the firmware starts."""
        return self._call("receive", frame_of(request), self.t_ns, port or self.device.ports[0].name)

    def wait(self, span_ns: int = STEP_NS) -> list[Any]:
        """Let time pass, and return the frames that the device sends when it wakes."""
        end_ns, sent, woken = self.t_ns + span_ns, [], 0
        while (wake_ns := self.device.wake_ns) is not None and wake_ns <= end_ns:
            self.t_ns, self.device.wake_ns = max(self.t_ns, wake_ns), None
            sent += self._call("wake", self.t_ns)
            woken += 1
            if woken > MAX_WAKES:
                raise calls.error_of_result(
                    self.device, "wake", f"was called {woken} times: set wake_ns to a later time, or to None"
                )
        self.t_ns = end_ns
        return sent

    def modem(self, dtr: bool, rts: bool, port: str) -> list[Any]:
        """Change the modem lines, or open or close a port, and return the frames that the device sends."""
        return self._call("lines", dtr, rts, self.t_ns, port)

    def ask(self, command: Command) -> list[Any]:
        """Send a documented command and return its answers, late ones included."""
        self.prepare(command)
        return self.send_stages(command) + self.wait()

    def send_stages(self, command: Command) -> list[Any]:
        """Send a command, stage by stage, and return the answers at once."""
        return [answer for stage in command.stages for answer in self.send(stage, command.port)]

    def prepare(self, command: Command) -> None:
        """Send the requests that must go before a command."""
        for request in command.after:
            self.send(request, command.port)
            self.wait()

    def _call(self, method: str, *args: Any) -> list[Any]:
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
                self.latest_ns = max(self.latest_ns, self.t_ns + (out.delay_ns if isinstance(out, Sent) else 0))
                frames.append(out.frame if isinstance(out, Sent) else out)
        return frames + self.restart() if restarted else frames


def exercise(host: Host, subject: Subject, seed: int, rounds: int = 2) -> list[Any]:
    """Use a device with pushes, requests and halves of requests, determined by ``seed``, and return the frames sent."""
    rng, sent = random.Random(seed), []
    for _ in range(rounds):
        for port in [each.name for each in host.device.ports]:
            sent += host.modem(True, rng.random() < 0.5, port)
        for request, port in subject.requests():
            host.pushes = rng.uniform(0.0, 5.0)
            sent += [*host.convert(), *host.send(request, port), *host.wait(rng.randrange(1, STEP_NS)), *host.convert()]
            if isinstance(request, bytes) and rng.random() < 0.3:
                sent += [*host.send(request[: len(request) // 2], port), *host.wait(rng.randrange(1, 3 * STEP_NS))]
        host.pushes = rng.uniform(0.0, 5.0)
        sent += host.convert() + host.convert()
    return sent


def carries_bytes(subject: Subject, command: Command) -> bool:
    """Return True if requests of a command may arrive in chunks of any size."""
    device = subject.make()
    port = command.port or device.ports[0].name
    return not device.connector(port).is_framed


def frames_text(frames: Sequence[Any]) -> str:
    """Return frames as text for a message, long ones cut."""
    texts = [text_of(frame).upper() for frame in frames[:3]]
    return ", ".join(text if len(text) <= 80 else text[:79] + "…" for text in texts) + (" …" if len(frames) > 3 else "")
