"""From a scene file to an emulator: the simulation, and one channel per skin."""

from __future__ import annotations

import itertools
import os
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from firmware_protocols import CanWire, Device, SerialWire, TcpWire
from tactemu import transports
from tactemu.clock import Clock
from tactemu.emulator import Channel, Emulator
from tactemu.errors import SceneError, TactemuError, TransportError
from tactemu.options import number
from tactemu.recordings.playback import Playback, recorded
from tactemu.recordings.recording import RecordedReadings
from tactemu.sampling import SampleClock
from tactemu.scenario import faults_of, laws_needed, schedule
from tactemu.scene.building import build_scene, make_devices
from tactemu.scene.file import LoadedScene
from tactemu.scene.limits import RATES_HZ
from tactemu.scene.placement import PlacedSensor
from tactemu.scene.schema import EventTable, Skin
from tactemu.truth import Truth
from tactemu.wire.wire import Wire

_FRESH = itertools.count()
MULTICAST = "can:udp_multicast:239.74.163.2"
"""python-can's own default group: a CAN bus for machines whose kernel has none."""


@dataclass(frozen=True)
class Wishes:
    """What the caller asks for beside the scene; ``None`` and empty leave it to the scene."""

    port: str | None = None
    rate_hz: float | None = None
    faults: Sequence[str] = ()
    seed: int | None = None
    compute: str | None = None
    """Where kernels run: ``cpu``, ``cuda:0``."""
    scenario: Sequence[EventTable] = ()
    """Events beside the scene's own."""
    adjustable: Sequence[str] = ()
    """Laws of imperfection that every skin is built with, so that they can be switched on while it runs."""
    usual_port: Callable[[str, Device], str] | None = None
    """Chooses a port by skin and device where nobody names one; default: :func:`usual_port`."""

    def __post_init__(self):
        if not isinstance(self.port, str | None):
            raise SceneError(f"port: expected a text such as 'pty:/tmp/skin', got {self.port!r}")
        if self.rate_hz is not None:
            number("the request", "rate", self.rate_hz, at_least=RATES_HZ[0], at_most=RATES_HZ[1], unit="Hz")
        if not isinstance(self.seed, int | None) or isinstance(self.seed, bool):
            raise SceneError(f"seed: expected a whole number, got {self.seed!r}")
        for name in ("faults", "adjustable"):
            given = getattr(self, name)
            if isinstance(given, str) or not all(isinstance(text, str) for text in given):
                raise SceneError(f"{name}: expected a list of texts, got {given!r}")


@dataclass(frozen=True)
class Assembled:
    """An emulator, not yet open, and what it was made of."""

    emulator: Emulator
    simulation: Any
    scene: Any
    loaded: LoadedScene


def assemble(
    loaded: LoadedScene, wishes: Wishes | None = None, *, clock: Clock | None = None, truth: Truth | None = None
) -> Assembled:
    """Build everything that a scene file asks for; kernels are compiled here, ports opened only by the emulator.

    Raises:
        TactemuError: something in the scene or the wishes cannot be had.
    """
    wishes = wishes or Wishes()
    world = loaded.tables.scene
    seed = world.seed if wishes.seed is None else wishes.seed
    devices = make_devices(loaded)
    events = (*loaded.tables.scenario, *wishes.scenario)
    ports = choose_ports(loaded.tables.skin, devices, wishes)
    truth = truth or Truth()
    wires = _wires(loaded.tables.skin, events, devices, ports, wishes, seed, truth)
    laws = {name: (*wishes.adjustable, *laws_needed(events, name)) for name in devices}
    scene, sensors = build_scene(loaded, devices, laws)
    played = _recordings(loaded, devices)
    simulation = None
    if sensors:
        simulation = scene.build(device=wishes.compute or world.device, seed=seed, dtype=world.dtype)
        simulation.step()  # loads the kernels, so that the first frame is not late
        simulation.reset()
    channels = [
        _channel(
            skin, devices[skin.title], (sensors | played)[skin.title], wires[ports[skin.title]], wishes.rate_hz, seed
        )
        for skin in loaded.tables.skin
    ]
    advanced = Playback(simulation, list(played.values())) if played else simulation
    emulator = Emulator(advanced, channels, clock=clock, truth=truth)
    schedule(emulator, events)
    return Assembled(emulator, simulation, scene, loaded)


def truth_of(loaded: LoadedScene, path: str | Path | None = None, keep: str | int | None = None) -> Truth:
    """The truth of a run of this scene; ``keep`` goes before the scene's own.

    Raises:
        TactemuError: the file cannot be written, or is one that the scene reads.
    """
    reads = [loaded.source, *(loaded.folder / skin.readings for skin in loaded.tables.skin if skin.readings)]
    try:
        return Truth(path, keep=loaded.tables.truth.keep if keep is None else keep, reads=reads)
    except OSError as error:
        raise TactemuError(f"{path}: cannot write the truth log: {error.strerror}") from None


def _recordings(loaded: LoadedScene, devices: dict[str, Device]) -> dict[str, RecordedReadings]:
    """The recordings that skins play in place of physics, by the skin's name."""
    return {
        skin.title: recorded(loaded.folder / skin.readings, skin.readings_of, skin.title, devices[skin.title])
        for skin in loaded.tables.skin
        if skin.readings is not None
    }


def choose_ports(skins: Sequence[Skin], devices: dict[str, Device], wishes: Wishes) -> dict[str, str]:
    """The port of each skin: the wish, the scene's, or the usual one for the device's wire.

    Raises:
        SceneError: two devices would hold one serial port.
    """
    usual = wishes.usual_port or usual_port
    ports = {skin.title: wishes.port or skin.port or usual(skin.title, devices[skin.title]) for skin in skins}
    for name, port in ports.items():
        others = [other for other, taken in ports.items() if taken == port and other != name]
        if port == "memory:" and others:
            ports[name] = f"memory:{name}"
        elif others and not port.startswith("can:"):
            raise SceneError(
                f"skins {name!r} and {others[0]!r} cannot share {port}; only a CAN bus is shared. "
                "Give each skin a `port` of its own in the scene file"
            )
    return ports


def usual_port(name: str, device: Device) -> str:
    """Where a device is put when nobody says: a pty, vcan0 or a multicast CAN bus, or its TCP port."""
    wire = device.wires[0]
    if wire.kind == "can":
        return "can:socketcan:vcan0" if os.path.exists("/sys/class/net/vcan0") else MULTICAST
    if isinstance(wire, TcpWire):
        return f"tcp:127.0.0.1:{wire.port}"
    return f"pty:/tmp/tactemu-{name}"


def fresh_port(name: str, device: Device) -> str:
    """A port that nobody else has, for tests that run side by side.

    On Linux a driver on one multicast group hears all others on its UDP port. Where that matters, give both processes
    a port of their own, ``CAN_CONFIG='{"port": 43200}'`` (python-can reads it).
    """
    number = next(_FRESH)
    wire = device.wires[0]
    if isinstance(wire, SerialWire):
        return f"pty:{Path(tempfile.gettempdir()) / f'tactemu-{os.getpid()}-{number}-{name}'}"
    if isinstance(wire, CanWire):
        group = (os.getpid() * 31 + number) % 65_000
        return f"can:udp_multicast:239.74.{group // 254 + 1}.{group % 254 + 1}"
    return "tcp:127.0.0.1:0"


def _wires(
    skins: Sequence[Skin],
    events: Sequence[EventTable],
    devices: dict[str, Device],
    ports: dict[str, str],
    wishes: Wishes,
    seed: int,
    truth: Truth,
) -> dict[str, Wire]:
    """One wire per port. Skins on one bus add their faults up, and must agree on its speed."""
    wires: dict[str, Wire] = {}
    for port in dict.fromkeys(ports.values()):
        here = [skin for skin in skins if ports[skin.title] == port]
        transport = transports.create(port)
        specs = {skin.title: transports.plug(devices[skin.title], transport) for skin in here}
        first, spec = next(iter(specs.items()))
        for name, other in specs.items():
            if other != spec:
                raise TransportError(f"{port}: {first!r} needs {spec} and {name!r} {other}; put them on two buses")
        faults = [*(fault for skin in here for fault in skin.faults), *wishes.faults]
        faults += faults_of(events, [skin.title for skin in here])
        pacing = all(skin.pacing for skin in here)
        wires[port] = Wire(transport, spec, pacing=pacing, faults=faults, seed=seed, truth=truth)
    return wires


def _channel(skin: Skin, device: Device, sensor: Any, wire: Wire, rate_hz: float | None, seed: int) -> Channel:
    rate = rate_hz or skin.rate_hz
    if rate:
        device.period_ns = round(1e9 / rate)
    sampling = SampleClock(
        period_ns=device.period_ns,
        skew_ppm=skin.clock.skew_ppm,
        drift_ppm_per_s=skin.clock.drift_ppm_per_s,
        reorder=skin.clock.reorder,
        delay_ns=round(skin.clock.delay_s * 1e9),
        jitter_ns=round(skin.clock.jitter_s * 1e9),
        seed=seed,
        name=skin.title,
    )
    if isinstance(sensor, RecordedReadings):  # in the device's frame as they are
        return Channel(skin.title, device, sensor, wire, sampling)
    placed = PlacedSensor(sensor, skin.quaternion)
    return Channel(skin.title, device, placed, wire, sampling, placed.surroundings)
