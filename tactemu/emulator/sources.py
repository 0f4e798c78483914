"""The sources of the user's own, ``tactemu.serve(..., source=...)``: another simulator behind a device.

A source is one of

* a :class:`tactemu.Scene`, or the :class:`~tactemu.sensors.simulation.Simulation` that it was built into, with a sensor
  for each skin: one of the skin's name, or the only one;
* a function of time [s] that returns *poses*: a table by body of the scene, each a :class:`tactemu.Pose` in the world,
  or ``(position, quaternion)``, whose velocities are then the differences to the pose before;
* a function of time [s] that returns *readings*: of the taxels, as an array in the device's order, shape ``(n,)`` or
  ``(n, 3)``, SI, vectors in the device's frame, forces on the skin; or a table of arrays by quantity, with optional
  ``temperature``, ``acceleration`` and ``angular_velocity``, and for a force-torque sensor ``wrench`` [N, Nm], shape
  ``(6,)``, or ``(n, 6)`` of n sensors, in place of those that follow from the forces; or a table of either by skin.

A function is called once for each of a rising sequence of times: by the thread that calls ``start`` until that returns
(first for 0 s), then by the emulator's thread. While it computes, the device neither samples nor answers; samples whose
time passes meanwhile are missed, and counted. To avoid that, compute in a thread of your own and return its latest
values. An exception of the function, and a value that is not finite or of another shape, ends the run and is raised
from ``stop``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from firmware_protocols import Device
from firmware_protocols.senses import CONTACT, VECTORS
from tactemu.base.errors import SceneError, SourceError, nearest, no_such
from tactemu.geometry import rotation
from tactemu.geometry.motion import Pose
from tactemu.scene.placement import AMBIENT, PlacedSensor, PlacedSkin
from tactemu.scene.skins import SkinPart
from tactemu.sensors.signs import require_on_skin

if TYPE_CHECKING:
    from tactemu.scene.file import LoadedScene
    from tactemu.scene.scene import Scene
    from tactemu.sensors.sensor import Sensor
    from tactemu.sensors.simulation import Simulation

Function = Callable[[float], Any]


@dataclass
class SourceParts:
    """The parts of a scene that a source replaces."""

    sensors: dict[str, PlacedSkin] = field(default_factory=dict)
    """The sensors of the user's scene, by skin."""
    simulation: Simulation | None = None
    """The simulation of the user's scene."""
    readings: FunctionReadings | None = None
    poses: FunctionPoses | None = None

    @property
    def replaced_skins(self) -> set[str]:
        """Skins whose readings do not come from the scene."""
        return {*self.sensors, *(self.readings.skins if self.readings else ())}

    @property
    def posed_bodies(self) -> set[str]:
        """Bodies that the source moves: those that it poses, or all of the user's scene."""
        if self.simulation is not None:
            return {body.name for body in self.simulation.bodies}
        return set(self.poses.names) if self.poses else set()


def resolve_source(
    source: Any, loaded: LoadedScene, devices: dict[str, Device], build: Callable[[Scene], Simulation]
) -> SourceParts:
    """Return the parts of the scene that a source replaces.

    Raises:
        TactemuError: it is no source, has failed, or does not fit the devices.
    """
    from tactemu.scene.scene import Scene
    from tactemu.sensors.simulation import Simulation

    if source is None:
        return SourceParts()
    if isinstance(source, Scene | Simulation):
        sensors = _skins_of(source.sensors, devices)
        if isinstance(source, Scene):
            return SourceParts(sensors=sensors, simulation=build(source))
        if source.time_ns:
            raise SceneError(f"source: the simulation is at {source.time_ns * 1e-9:g} s; give it at its start: reset()")
        return SourceParts(sensors=sensors, simulation=source)
    if not callable(source):
        raise SceneError(f"source: expected a tactemu.Scene, built or not, or a function of time, got {source!r}")
    return _from_function(source, {body.name: body.fixed for body in loaded.tables.body}, devices)


def without_replaced(loaded: LoadedScene, given: SourceParts) -> LoadedScene:
    """Return the scene without the motions and readings that a source replaces."""
    motions = {name: motion for name, motion in loaded.motions.items() if name not in given.posed_bodies}
    skins = tuple(
        skin.model_copy(update={"link": None, "readings": None}) if skin.title in given.replaced_skins else skin
        for skin in loaded.tables.skin
    )
    return replace(loaded, motions=motions, tables=loaded.tables.model_copy(update={"skin": skins}))


def _from_function(function: Function, bodies: Mapping[str, bool], devices: Mapping[str, Device]) -> SourceParts:
    """Call a function for the first time, and return the parts of the scene that its result replaces.

    Args:
        function: the user's function.
        bodies: for each body of the scene, True if it is fixed.
        devices: the device of each skin.

    Raises:
        SourceError: the function raised, or returned no poses of these bodies and no readings of these skins.
    """
    first = _call(function, 0.0)
    moving = [name for name, is_fixed in bodies.items() if not is_fixed]
    if isinstance(first, Mapping) and first and set(first) <= set(moving):
        return SourceParts(poses=FunctionPoses(function, first))
    by_skin = isinstance(first, Mapping) and bool(first) and set(first) <= set(devices)
    is_reading = len(devices) == 1 and (not isinstance(first, Mapping) or not _QUANTITIES.isdisjoint(first))
    if not by_skin and not is_reading:
        raise SourceError(f"source at 0 s: {_problem(first, bodies, devices)}")
    fed = {name: FunctionSkin(name, devices[name]) for name in (first if by_skin else devices)}
    return SourceParts(readings=FunctionReadings(function, fed, first, by_skin))


_QUANTITIES = frozenset((*CONTACT, *AMBIENT, "wrench"))


def _problem(first: Any, bodies: Mapping[str, bool], devices: Mapping[str, Device]) -> str:
    """Return what is wrong with the first result of a function, and what was expected."""
    moving = ", ".join(name for name, is_fixed in bodies.items() if not is_fixed) or "none that moves"
    ways = [f"poses by body ({moving})", f"readings by skin ({', '.join(devices)})"]
    names = {*bodies, *devices}
    if len(devices) == 1:
        quantities = (*next(iter(devices.values())).contact, *AMBIENT)
        ways.append(f"readings by quantity ({', '.join(quantities)})")
        names |= set(quantities)
    if not isinstance(first, Mapping) or not first:
        return f"expected a table of {' or of '.join(ways[:2])}, got {_shown(first)}"
    wrong = next((name for name in first if bodies.get(name) or name not in names), None)
    if wrong is None:
        return f"expected a table of one kind: {', or '.join(ways)}; got {_shown(first)}"
    hint = f"no body or skin is called {wrong!r}{nearest(wrong, sorted(names))}"
    if bodies.get(wrong):
        hint = f"body {wrong!r} is fixed, and cannot be posed"
    return f"{hint}; expected a table of {', or of '.join(ways)}"


def _call(function: Function, t_s: float) -> Any:
    try:
        return function(t_s)
    except Exception as error:
        raise SourceError(f"source at {t_s:g} s raised {type(error).__name__}: {error}") from error


def _shown(value: Any) -> str:
    """Return a value in a few words, for a message."""
    if isinstance(value, Mapping):
        return f"a table of {', '.join(map(repr, value)) or 'nothing'}"
    return f"{type(value).__name__} {str(value)[:60]}"


# -- poses -------------------------------------------------------------------------------------------------------------


class FunctionPoses:
    """The poses that a user's function gives to bodies of a simulation at each of its steps."""

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ("names", "_function")

    def __init__(self, function: Function, first: Mapping[str, Any]):
        self.names = tuple(first)
        self._function = function
        self._t_s = 0.0
        self._before = {name: _pose(name, given, None, 0.0, 0.0) for name, given in first.items()}

    def attach(self, simulation: Simulation) -> None:
        """Move this simulation's bodies from now on."""
        self._put(simulation)
        simulation.posers.append(self.pose)

    def pose(self, simulation: Simulation, t_s: float) -> None:
        """Set the bodies to their poses at ``t_s``.

        Raises:
            SourceError: the function raised, or did not return poses of these bodies.
        """
        given = _call(self._function, t_s)
        if not isinstance(given, Mapping) or set(given) != set(self.names):
            raise SourceError(f"source at {t_s:g} s: expected poses of {', '.join(self.names)}, got {_shown(given)}")
        dt = t_s - self._t_s
        self._before = {name: _pose(name, given[name], self._before[name], t_s, dt) for name in self.names}
        self._t_s = t_s
        self._put(simulation)

    def _put(self, simulation: Simulation) -> None:
        for name, pose in self._before.items():
            simulation.set_pose(name, **pose._asdict())


def _pose(name: str, given: Any, before: Pose | None, t_s: float, dt: float) -> Pose:
    """Return a pose; velocities that are not given are differences to the pose ``before``, ``dt`` [s] ago."""
    try:
        position, wxyz, *velocities = (np.array(part, float) for part in given)
        shapes = [part.shape for part in (position, wxyz, *velocities)]
        if (
            shapes not in ([(3,), (4,)], [(3,), (4,), (3,), (3,)])
            or not np.isfinite(np.concatenate([position, *velocities])).all()
        ):
            raise ValueError
        quaternion = rotation.normalised(wxyz)
    except (TypeError, ValueError):
        raise SourceError(
            f"source at {t_s:g} s: body {name!r}: expected a tactemu.Pose, or position (3) and quaternion (4), "
            f"all finite, got {given!r}"
        ) from None
    if velocities:
        return Pose(position, quaternion, *velocities)
    if before is None or dt <= 0:
        return Pose(position, quaternion)
    turned = rotation.multiply(quaternion, rotation.conjugate(before.quaternion))
    return Pose(position, quaternion, (position - before.position) / dt, rotation.to_rotation_vector(turned) / dt)


# -- readings ----------------------------------------------------------------------------------------------------------


class FunctionSkin:
    """The readings of one skin that the user's function returns, without imperfections."""

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ("name", "_n", "_contact", "_wrenches")
    imperfections = None

    def __init__(self, name: str, device: Device):
        self.name, self._n, self._contact = name, len(device.layout), device.contact
        self._wrenches = sum(len(sense.at or ()) for sense in device.sensed if sense.quantity == "wrench")
        """The number of points with a wrench."""
        self.wrench: np.ndarray | None = None
        """Force and torque [N, Nm], shape ``(6,)`` or ``(n, 6)``; ``None``: they follow from the forces."""
        self._values: dict[str, np.ndarray] = {}
        self._ambient: dict[str, Any] = dict(AMBIENT)

    def put(self, given: Any, t_s: float) -> None:
        """Store the readings that the function returned for ``t_s``.

        Raises:
            SourceError: a quantity is missing or unknown, of another shape, or not finite.
        """
        table = given if isinstance(given, Mapping) else {self._contact[0]: given}
        optional = (*AMBIENT, "wrench") if self._wrenches else tuple(AMBIENT)
        if not set(self._contact) <= set(table) or not set(table) <= {*CONTACT, *optional}:
            expected = ", ".join((*self._contact, *(f"{name} (optional)" for name in optional)))
            raise SourceError(f"source at {t_s:g} s: skin {self.name!r}: expected {expected}; got {_shown(given)}")
        self._values = {name: self._checked(name, table[name], t_s) for name in self._contact}
        self._ambient = {
            name: self._checked(name, table[name], t_s) if name in table else AMBIENT[name] for name in AMBIENT
        }
        self.wrench = self._checked("wrench", table["wrench"], t_s) if "wrench" in table else None

    def _checked(self, name: str, value: Any, t_s: float) -> np.ndarray:
        shapes = {"temperature": (), "acceleration": (3,), "angular_velocity": (3,), "wrench": (6,)}
        shape = shapes.get(name, (self._n,))
        shape = (self._n, 3) if name in VECTORS else shape
        where = f"source at {t_s:g} s: skin {self.name!r}: {name}"
        try:
            array = np.array(value, float)
        except (TypeError, ValueError):
            raise SourceError(f"{where}: expected numbers of shape {shape}, got {_shown(value)}") from None
        if name == "wrench" and array.ndim == 2:
            shape = (self._wrenches, 6)
        if array.shape != shape:
            raise SourceError(f"{where}: expected shape {shape}, got {array.shape}")
        if not np.isfinite(array).all():
            at = np.argwhere(~np.isfinite(array))[0].tolist()
            raise SourceError(f"{where}{at or ''}: {array[tuple(at)]} is not finite")
        return array

    def quantity(self, name: str, ground_truth: bool = False) -> np.ndarray:
        """Return the latest reading, shape ``(n_taxels,)`` or ``(n_taxels, 3)``, SI, device's frame."""
        return self._values[name]

    def ambient(self, name: str, t_ns: int, link: str = "") -> Any:
        """Return an ambient quantity of the function, else room temperature, or the motion of a link at rest."""
        return self._ambient[name]


class FunctionReadings:
    """The readings of skins by the user's function, which is called as the loop reaches their time."""

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ("_function", "_by_skin")

    def __init__(self, function: Function, skins: Mapping[str, FunctionSkin], first: Any, by_skin: bool):
        self.skins = dict(skins)
        self._function, self._by_skin = function, by_skin
        self._t_ns = 0
        self._put(first, 0.0)

    def advance_to(self, t_ns: int) -> None:
        """Call the function for ``t_ns``, once for each time.

        Raises:
            SourceError: the function raised, or its result does not fit the skins.
        """
        if t_ns > self._t_ns:
            self._t_ns = t_ns
            t_s = t_ns * 1e-9
            self._put(_call(self._function, t_s), t_s)

    def _put(self, given: Any, t_s: float) -> None:
        if not self._by_skin:
            given = dict.fromkeys(self.skins, given)
        elif not isinstance(given, Mapping) or set(given) != set(self.skins):
            raise SourceError(f"source at {t_s:g} s: expected readings of {', '.join(self.skins)}, got {_shown(given)}")
        for name, skin in self.skins.items():
            skin.put(given[name], t_s)


# -- a scene of the user's own -----------------------------------------------------------------------------------------


def _skins_of(sensors: Sequence[Sensor], devices: Mapping[str, Device]) -> dict[str, PlacedSkin]:
    """Return the sensors of the user's scene as skins of devices, by name.

    Raises:
        SceneError: a skin has no sensor, or one that does not fit its device.
    """
    named = {sensor.name: sensor for sensor in sensors}
    if len(sensors) == len(devices) == 1:
        named = {next(iter(devices)): sensors[0]}
    missing = [name for name in devices if name not in named]
    if missing:
        raise SceneError(
            f"source: {no_such('sensor', missing[0], named)}; name each after its skin: scene.add_sensor(..., name=...)"
        )
    return {name: _placed(name, named[name], device) for name, device in devices.items()}


def _placed(name: str, sensor: Sensor, device: Device) -> PlacedSkin:
    model, n = sensor.model, len(device.layout)
    where = f"source: sensor {sensor.name!r}"
    if sensor.n_taxels != n:
        raise SceneError(f"{where} has {sensor.n_taxels} taxels, {device.name} has {n}")
    for quantity in device.contact:
        if quantity not in model.layouts:
            raise SceneError(f"{where} gives {', '.join(model.layouts)} and not {quantity}, which {device.name} senses")
    require_on_skin([sensor], f"{where}: devices measure")
    part = SkinPart(
        name, device.layout, np.arange(n), device.layout.links, sensor.link.name, (0.0, 0.0, 0.0), rotation.IDENTITY
    )
    return PlacedSkin([PlacedSensor(sensor, part)], n)
