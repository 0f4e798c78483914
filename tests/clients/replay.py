"""Do a client recording again, in virtual time and without the driver."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from firmware_protocols import Connector, WebSocket
from tactemu.base.clock import VirtualClock
from tactemu.base.frame_text import text
from tactemu.emulator.assembly import Assembled, assemble
from tactemu.emulator.emulator import Emulator
from tactemu.emulator.options import AssemblyOptions
from tactemu.scene import file
from tactemu.transports.memory import MemoryTransport
from tactemu.transports.transport import Closed, Event, LinesChanged, Opened, SettingChanged
from tactemu.truth import Truth
from tests.clients.recording import Recording, equals, mapped

OF_THE_WIRE = ("misheard", "overrun", "collision")
"""Counters of a wire that stand beside those of a device in a recording."""
AFTER_NS = 50_000_000
"""How long the replay goes on after the last event."""


class PortTap:
    """A transport that notes what the driver did on it and what was written to it."""

    def __init__(self, transport: Any, name: str, now_ns: Callable[[], int], recording: Recording):
        self._transport, self._name, self._now_ns, self._into = transport, name, now_ns, recording

    def __getattr__(self, name: str) -> Any:
        return getattr(self._transport, name)

    def poll(self, reading: bool = True) -> list[Event]:
        """Return what the driver did since the last call, and note it."""
        events = self._transport.poll(reading)
        self._into.events += [(self._now_ns(), self._name, event) for event in events]
        return events

    def write(self, frame: Any) -> bool:
        """Write a frame, and note it."""
        self._into.sent.append((self._now_ns(), self._name, text(frame)))
        return self._transport.write(frame)

    def write_all(self, frames: Any) -> int:
        """Write frames one after another, and note them."""
        self._into.sent += [(self._now_ns(), self._name, text(frame)) for frame in frames]
        return self._transport.write_all(frames)


def tap(emulator: Emulator, recording: Recording) -> None:
    """Have all ports of an emulator noted from now on. Call in its loop, or before it runs."""
    for name, wire in ports_of(emulator).items():
        wire.transport = PortTap(wire.transport, name, lambda: emulator.now_ns, recording)  # type: ignore[assignment]


def ports_of(emulator: Emulator) -> dict[str, Any]:
    """The wires by ``SKIN`` or ``SKIN/CONNECTOR``; one that several skins share has the name of the first."""
    found: dict[str, Any] = {}
    for channel in emulator.channels:
        for port, wire in channel.wires.items():
            if wire not in found.values():
                found[f"{channel.name}/{port}" if port else channel.name] = wire
    return found


def replay(recorded: Recording) -> tuple[Recording, Assembled]:
    """Run the scene again in virtual time with what the driver sent; returns what came of it."""
    about = recorded.about
    loaded = file.parse(about["scene"], source=f"{about['device']}, {about['driver']}")
    names = about["ports"]
    run_options = AssemblyOptions(port=dict.fromkeys(names, "memory:"), seed=about["seed"])
    made = assemble(loaded, run_options, clock=VirtualClock(), truth=Truth(keep="1GB"))
    emulator = made.emulator
    again = Recording(about)
    tap(emulator, again)
    wires = {name: wire for name, wire in ports_of(emulator).items() if name in names}
    for name, wire in wires.items():
        assert isinstance(wire.transport._transport, MemoryTransport)
        wire.transport.driver.is_open = about["ports"][name]
    handshakes = {name for name, connector in _connectors(emulator).items() if isinstance(connector, WebSocket)}
    for t_ns, name, event in recorded.events:
        emulator.at(t_ns, partial(_do, wires[name].transport.driver, event, name in handshakes))
    with emulator:
        for wire in wires.values():
            wire.transport.driver.sent.clear()  # its own greeting: the recording has the driver's
        last = max((t_ns for t_ns, *_ in (*recorded.events, *recorded.sent)), default=0)
        emulator.run((last + AFTER_NS) / 1e9)
    again.sent = [each for each in again.sent if each[0] <= last]
    return again, made


def _connectors(emulator: Emulator) -> dict[str, Connector]:
    return {
        f"{channel.name}/{port}" if port else channel.name: channel.device.connector(port)
        for channel in emulator.channels
        for port in channel.wires
    }


def _do(driver: Any, event: Event, has_handshake: bool) -> None:
    match event:
        case Opened() | Closed():
            driver.is_open = isinstance(event, Opened) and not has_handshake
        case LinesChanged(dtr, _) if has_handshake:
            driver.is_open = dtr
        case SettingChanged(setting):
            driver.setting = setting
    driver.sent.append(event)


def differences(recorded: Recording, again: Recording, made: Assembled) -> list[str]:
    """What the replay did otherwise than the recording, in words; empty: nothing."""
    found = []
    for name in dict.fromkeys(wire for _, wire, _ in (*recorded.sent, *again.sent)):
        before = [(t_ns, frame) for t_ns, wire, frame in recorded.sent if wire == name]
        now = [(t_ns, frame) for t_ns, wire, frame in again.sent if wire == name]
        if [frame for _, frame in before] != [frame for _, frame in now]:
            at = next((k for k, (a, b) in enumerate(zip(before, now)) if a[1] != b[1]), min(len(before), len(now)))
            was, new = (", ".join(f"{t / 1e9:.6f} s {f}" for t, f in each[at : at + 1]) for each in (before, now))
            found.append(
                f"{name}: frame {at} of {len(before)} (now {len(now)}) was {was or 'none'}, is {new or 'none'}"
            )
    for channel in made.emulator.channels:
        now = {name: count for name, count in channel.device.counters.items() if count}
        counted = recorded.about["counters"].get(channel.name, {})
        was = {name: count for name, count in counted.items() if name not in OF_THE_WIRE}
        if now != was:
            found.append(f"{channel.name}: counted {was}, now {now}")
    samples = {(sample.sense, sample.number): sample for sample in made.emulator.truth.samples}
    wrong = 0
    for row in recorded.rows:
        how = recorded.about["maps"][row.name]
        sample = samples.get((how.get("sense", ""), row.sample))
        if sample is None or not equals(mapped(sample.counts, how), row.values, how):
            wrong += 1
            if wrong == 1:
                found.append(f"decoded {row.name} of sample {row.sample}: the truth has other values")
    if wrong > 1:
        found.append(f"{wrong} of {len(recorded.rows)} decoded readings differ from the truth")
    return found
