"""The assembly of an emulator from a scene file: the simulation, and one channel per skin."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from firmware_protocols import Device
from tactemu import transports
from tactemu.base.clock import Clock, VirtualClock
from tactemu.base.errors import DeviceError, SceneError, TactemuError, no_such, reason_of
from tactemu.base.random_streams import stream_key
from tactemu.emulator.channel import Channel, Source
from tactemu.emulator.emulator import Emulator
from tactemu.emulator.options import AssemblyOptions
from tactemu.emulator.playback import Playback, RecordedReadings, recorded_readings
from tactemu.emulator.port_assignment import PortAssignment, assign_ports
from tactemu.emulator.sampling import SampleClock
from tactemu.emulator.scenario import check_scenario, faults_of, laws_needed, schedule
from tactemu.emulator.sources import resolve_source, without_replaced
from tactemu.geometry.motion import Joint
from tactemu.scene.building import build_scene, build_simulation, make_devices, named_file
from tactemu.scene.description import SceneContext
from tactemu.scene.events import EventTable
from tactemu.scene.file import LoadedScene
from tactemu.scene.measured_defaults import with_measured_defaults
from tactemu.scene.placement import NullSource, PlacedSkin, SenseReader
from tactemu.scene.schema import SkinTable
from tactemu.scene.steering import Steered
from tactemu.sensors.signs import require_on_skin
from tactemu.truth import Truth
from tactemu.wire.line import Pacing
from tactemu.wire.wire import Wire

if TYPE_CHECKING:
    from tactemu.scene.scene import Scene
    from tactemu.sensors.simulation import Simulation


@dataclass(frozen=True)
class Assembled:
    """An emulator, not yet open, and its simulation, scene and skins."""

    emulator: Emulator
    simulation: Any
    scene: Any
    loaded: LoadedScene
    skins: Mapping[str, PlacedSkin]
    """The skins on bodies, by name."""
    posed: frozenset[str]
    """The bodies that the user's source moves."""
    reassemble: Callable[..., Assembled] = field(repr=False)
    """A function that assembles an equal emulator with its own port, clock and truth log."""

    def fork(
        self,
        *,
        port: str | Mapping[str, str] | None = "memory:",
        clock: Clock | None = None,
        truth: Truth | None = None,
        state: Mapping[str, Any] | None = None,
    ) -> Assembled:
        """Return another emulator that continues from the present state once it is opened, and shares only constant
        data with this one. Call between two turns, as :meth:`Emulator.snapshot`, or give the state.

        The fork calls the user's source, too; a source that is a function of time alone returns the same to both.

        Args:
            port: the port of the fork; ``None``: fresh ports of the usual kind.
            clock: default: a virtual one.
            truth: default: in memory.
            state: a snapshot, of this emulator or one like it; default: the present state.

        Raises:
            StateError: a part cannot be saved.
            TactemuError: a port cannot be made.
        """
        state = self.emulator.snapshot() if state is None else state
        other = self.reassemble(port=port, clock=clock or VirtualClock(), truth=truth)
        other.emulator.restore(state)
        return other


def assemble(
    loaded: LoadedScene,
    options: AssemblyOptions | None = None,
    *,
    clock: Clock | None = None,
    truth: Truth | None = None,
    like: Simulation | None = None,
) -> Assembled:
    """Build the emulator of a scene file; this compiles the kernels, and only the emulator opens the ports.

    ``like`` is a simulation of the same scene and options, whose constant data is shared.

    Raises:
        TactemuError: something in the scene or the options is not available.
    """
    options = options or AssemblyOptions()
    if options.measured:
        skins = with_measured_defaults(loaded.tables.skin)
        loaded = replace(loaded, tables=loaded.tables.model_copy(update={"skin": skins}))
    original, world = loaded, loaded.tables.scene
    seed = world.seed if options.seed is None else options.seed
    wire_seed = stream_key(seed, f"environment {options.env}") if options.env else seed
    devices = make_devices(loaded)
    check_scenario(loaded.tables.scenario, devices, loaded.source)
    check_scenario(options.scenario, devices)
    built = partial(_built, loaded=loaded, options=options, seed=seed, like=like)
    given = resolve_source(options.source, loaded, devices, built)
    loaded = without_replaced(loaded, given)
    events = (*loaded.tables.scenario, *options.scenario)
    truth = truth or Truth()
    assignments, wires = _wires(loaded, devices, events, options, wire_seed, truth)
    laws = {name: (*options.adjustable, *laws_needed(events, name)) for name in devices}
    channels: dict[str, Channel] = {}

    def local_ns(skin: str, t_ns: int) -> int:
        return channels[skin].local_ns(t_ns) if skin in channels else t_ns

    with named_file(loaded):
        scene, placed = build_scene(_driven(loaded, devices, local_ns), devices, laws, local_ns)
        for name, skin in placed.items():
            require_on_skin((part.sensor for part in skin.parts), f"skin {name!r}: devices measure")
    played = _recordings(loaded, devices)
    simulation = built(scene) if placed else given.simulation
    if given.poses and simulation is not None:
        given.poses.attach(simulation)
    placed |= given.sensors
    from_source = given.readings.skins if given.readings else {}
    for skin in loaded.tables.skin:
        device = devices[skin.title]
        readings = from_source.get(skin.title) or played.get(skin.title) or placed.get(skin.title) or NullSource()
        own = {each.connector.name: wires[each.address] for each in assignments if each.skin == skin.title}
        with named_file(loaded, is_own=not options.rate_hz):
            channels[skin.title] = _channel(skin, device, SenseReader(readings, device), own, options, wire_seed)
    followed = [*played.values(), *([given.readings] if given.readings else [])]
    advanced = Playback(simulation, followed) if followed else simulation
    truth.context = SceneContext(simulation, devices, placed)
    emulator = Emulator(advanced, channels.values(), clock=clock, truth=truth, recipe=_recipe(original, options))
    _schedule(emulator, loaded, options)
    again = partial(_reassemble, original, options, simulation, simulation is given.simulation)
    return Assembled(emulator, simulation, scene, loaded, placed, frozenset(given.posed_bodies), again)


def _reassemble(
    loaded: LoadedScene, options: AssemblyOptions, simulation: Simulation | None, is_given: bool, **own: Any
) -> Assembled:
    """Assemble an equal emulator with its own ``port``, ``clock`` and ``truth``; ``is_given``: the user's source."""
    motions = {name: copy(motion) if isinstance(motion, Steered) else motion for name, motion in loaded.motions.items()}
    skins = tuple(skin.model_copy(update={"port": None, "ports": {}}) for skin in loaded.tables.skin)
    tables = loaded.tables.model_copy(update={"skin": skins})
    source = simulation.clone() if is_given and simulation is not None else options.source
    options = replace(options, port=own.pop("port"), source=source, fresh_ports=True)
    return assemble(replace(loaded, motions=motions, tables=tables), options, **own, like=simulation)


def _built(
    scene: Scene, loaded: LoadedScene, options: AssemblyOptions, seed: int, like: Simulation | None
) -> Simulation:
    simulation = build_simulation(scene, loaded, device=options.device, seed=seed, first_env=options.env, like=like)
    if like is None:
        simulation.step()  # loads the kernels, so that the first frame is not late
        simulation.reset()
    return simulation


def _recipe(loaded: LoadedScene, options: AssemblyOptions) -> dict[str, Any]:
    """Return the scene and options of a run without its ports and memory limits; a saved state must have the same."""
    tables = loaded.tables.model_dump(by_alias=True, exclude={"truth": True, "skin": {"__all__": {"port", "ports"}}})
    given = {name: getattr(options, name) for name in ("rate_hz", "faults", "seed", "adjustable")}
    events = [event.model_dump(exclude_defaults=True) for event in options.scenario]
    return {**tables, "asked for": given | {"scenario": events}}


def truth_of(loaded: LoadedScene, path: str | Path | None = None, keep: str | int | None = None) -> Truth:
    """Return the truth log of a run of this scene; ``keep`` overrides the scene's own.

    Raises:
        TactemuError: the file cannot be written, or the scene reads it.
    """
    reads = [loaded.source, *(loaded.folder / skin.readings for skin in loaded.tables.skin if skin.readings)]
    try:
        return Truth(path, keep=loaded.tables.truth.keep if keep is None else keep, reads=reads)
    except OSError as error:
        raise TactemuError(f"{path}: cannot write the truth log: {reason_of(error, path)}") from None


def _driven(loaded: LoadedScene, devices: dict[str, Device], local_ns: Callable[[str, int], int]) -> LoadedScene:
    """Return the scene with its joint motions bound to the joints of the devices.

    Raises:
        SceneError: there is no such skin, or its device has no such joint.
    """
    motions = dict(loaded.motions)
    for body, motion in loaded.motions.items():
        if not isinstance(motion, Joint):
            continue
        where = f"body {body!r}: motion"
        if motion.skin not in devices:
            raise SceneError(f"{where}: {no_such('skin', motion.skin, devices)}")
        has = devices[motion.skin].joints(0)
        if motion.joint not in has:
            raise SceneError(f"{where}: {devices[motion.skin].name} has {no_such('joint', motion.joint, has)}")

        def position(t_s: float, motion: Joint = motion) -> float:
            return devices[motion.skin].joints(local_ns(motion.skin, round(t_s * 1e9)))[motion.joint]

        motions[body] = motion.driven_by(position)
    return replace(loaded, motions=motions)


def _recordings(loaded: LoadedScene, devices: dict[str, Device]) -> dict[str, RecordedReadings]:
    """Return the recordings that replace physics, by the skin's name."""
    return {
        skin.title: recorded_readings(loaded.folder / skin.readings, skin.readings_of, skin.title, devices[skin.title])
        for skin in loaded.tables.skin
        if skin.readings is not None
    }


def _schedule(emulator: Emulator, loaded: LoadedScene, options: AssemblyOptions) -> None:
    """Schedule the events of the file, then those of the options."""
    for k, event in enumerate(loaded.tables.scenario):
        with named_file(loaded, f"scenario[{k}]: "):
            schedule(emulator, [event])
    schedule(emulator, options.scenario)


def _wires(
    loaded: LoadedScene,
    devices: Mapping[str, Device],
    events: Sequence[EventTable],
    options: AssemblyOptions,
    seed: int,
    truth: Truth,
) -> tuple[list[PortAssignment], dict[str, Wire]]:
    """Return the ports, and one wire for each, with the faults of all skins that share it."""
    skins, fresh = loaded.tables.skin, {"fresh": options.fresh_ports, "usual_network": options.usual_network}
    with named_file(loaded, is_own=options.port is None):
        assignments = assign_ports(skins, devices, options.port, **fresh)
        ports = {address: transports.create(address) for address in dict.fromkeys(each.address for each in assignments)}
    wires: dict[str, Wire] = {}
    for address, port in ports.items():
        names = [assignment.skin for assignment in assignments if assignment.address == address]
        connector = next(assignment.connector for assignment in assignments if assignment.address == address)
        here = [skin for skin in skins if skin.title in names]
        faults = [*(fault for skin in here for fault in skin.faults), *options.faults, *faults_of(events, names)]
        paced = {skin.pacing for skin in here}
        pacing: Pacing = False if False in paced else "strict" if "strict" in paced else True
        wires[address] = Wire(port, connector, pacing=pacing, faults=faults, seed=seed, truth=truth)
    return assignments, wires


def _channel(
    skin: SkinTable, device: Device, source: Source, wires: dict[str, Wire], options: AssemblyOptions, seed: int
) -> Channel:
    wanted = _periods(skin, device, options.rate_hz or skin.rate_hz)
    sampling = SampleClock(
        period_ns=next((period for period in (*wanted.values(), *device.periods.values()) if period), 10_000_000),
        skew_ppm=skin.clock.skew_ppm,
        drift_ppm_per_s=skin.clock.drift_ppm_per_s,
        reorder=skin.clock.reorder,
        delay_ns=round(skin.clock.delay_s * 1e9),
        jitter_ns=round(skin.clock.jitter_s * 1e9),
        missed=skin.clock.missed,
        seed=seed,
        name=skin.title,
    )
    refresh_ns = round(skin.clock.refresh_s * 1e9)
    return Channel(skin.title, device, source, wires, sampling, wanted, refresh_ns=refresh_ns)


def _periods(skin: SkinTable, device: Device, rate_hz: float | Mapping[str, float] | None) -> dict[str, int]:
    """Return the sampling periods that the user has set, by stream [ns].

    Raises:
        DeviceError: a single rate is given for streams with different senses.
    """
    if rate_hz is None:
        return {}
    if not isinstance(rate_hz, Mapping):
        if len({stream.senses for stream in device.streams.values()}) > 1:
            table = ", ".join(f"{name} = {rate_hz:g}" for name in device.periods)
            words = " ".join(f"--rate {name}={rate_hz:g}" for name in device.periods)
            raise DeviceError(f"{skin.title}: rate_hz: which stream? give a table, as {{ {table} }}, or {words}")
        rate_hz = dict.fromkeys(device.periods, rate_hz)
    return {stream: round(1e9 / rate) for stream, rate in rate_hz.items()}
