"""Building of a :class:`~tactemu.scene.scene.Scene`, with one sensor per skin, from a scene file's tables."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from firmware_protocols import Device
from firmware_protocols.connectors import port_error
from firmware_protocols.options import checked, declared
from firmware_protocols.senses import TOUCH, quantity_error
from tactemu.base.errors import DeviceError, SceneError, TactemuError, TransportError
from tactemu.base.option_groups import defaults, from_flat
from tactemu.base.options import numbers
from tactemu.base.own_code import own_error
from tactemu.geometry import rotation
from tactemu.geometry.bodies import Body
from tactemu.geometry.shapes.registry import shape_class
from tactemu.geometry.shapes.shape import Shape
from tactemu.geometry.shapes.texture import Texture
from tactemu.scene.engine_interface import BatchEngine, Engine, JointMotors
from tactemu.scene.engine_tables import REGISTRY as ENGINES
from tactemu.scene.engine_tables import BatchTable
from tactemu.scene.file import LoadedScene, device_class
from tactemu.scene.placement import PlacedSensor, PlacedSkin
from tactemu.scene.schema import BodyTable, SkinTable
from tactemu.scene.skins import SkinPart, parts_of
from tactemu.sensors.models import cheapest, model_class, models_for
from tactemu.transducers.chain import Chain
from tactemu.transducers.registry import make_transducer

if TYPE_CHECKING:
    from tactemu.scene.scene import Scene
    from tactemu.sensors.sensor_model import SensorModel
    from tactemu.sensors.simulation import Simulation
    from tactemu.transducers.transducer import Transducer


@contextmanager
def named_file(loaded: LoadedScene, where: str = "", *, is_own: bool = True) -> Iterator[None]:
    """Begin the message of an error within with the scene file, if the scene is of one, and the place in it.

    Args:
        loaded: the scene.
        where: the place, with a colon and a space.
        is_own: False if the value in question is not the file's but of an option, which overrides it.

    Raises:
        SceneError, DeviceError, TransportError: the error, with this message.
    """
    try:
        yield
    except (SceneError, DeviceError, TransportError) as error:
        if not is_own or Path(loaded.source).suffix != ".toml" or str(error).startswith(loaded.source):
            raise
        place = "" if str(error).startswith(where) else where
        raise type(error)(f"{loaded.source}: {place}{error}") from error


def make_devices(loaded: LoadedScene) -> dict[str, Device]:
    """Return the device of each skin, by the skin's name.

    Raises:
        DeviceError: there is no such device, or it does not have an option.
    """
    devices = {}
    for skin in loaded.tables.skin:
        with named_file(loaded, f"skin {skin.title!r}: "):
            devices[skin.title] = _device_of(skin)
    return devices


def _device_of(skin: SkinTable) -> Device:
    """Return the device of a skin; its option ``sees``, if it has one, is the quantity that the transducers provide."""
    name, options = skin.device, skin.device_options
    if skin.transducer and "sees" in declared(device_class(name)) and "sees" not in options:
        model = model_class(model_name(skin, make_device(name, options)))
        kind = Chain(f"skin {skin.title!r}", transducers_of(skin), model.layouts).output
        options = {**options, "sees": kind.quantity}
    return make_device(name, options)


def transducers_of(skin: SkinTable) -> list[Transducer]:
    """Return the transducers of a skin, checked.

    Raises:
        SceneError: there is no such kind, or the transducer does not have or accept an option.
    """
    return [
        make_transducer(f"skin {skin.title!r}: transducer {k}", table) for k, table in enumerate(skin.transducer, 1)
    ]


def make_device(name: str, options: dict[str, Any]) -> Device:
    """Return a device, given its name and options.

    Raises:
        DeviceError: there is no such device, it does not have or accept an option, or its ports or senses are wrong.
    """
    cls = device_class(name)
    try:
        device = cls(**checked(cls, options))
    except (TypeError, ValueError, ArithmeticError, LookupError) as error:
        raise DeviceError(f"device {name}: {error}") from error
    wrong = (port_error(getattr(device, "ports", None)), *map(quantity_error, device.sensed))
    if found := next(filter(None, wrong), ""):
        raise DeviceError(f"device {name}: {found}; `tactemu check {name}` checks all of it")
    return device


def build_scene(
    loaded: LoadedScene,
    devices: dict[str, Device],
    laws: Mapping[str, Sequence[str]] | None = None,
    local_ns: Callable[[str, int], int] = lambda skin, t_ns: t_ns,
) -> tuple[Scene, dict[str, PlacedSkin]]:
    """Return the scene, and each skin that is on a link with its sensors, by the skin's name; nothing is compiled yet.

    ``laws`` names the imperfections of each skin that can be switched while it runs; ``local_ns`` returns the time of a
    skin's own clock at a time of the scene.

    Raises:
        SceneError: a body or an option is wrong.
    """
    from tactemu.scene.scene import Scene

    scene = Scene(dt=loaded.tables.scene.dt, convention=loaded.tables.scene.convention)
    with named_file(loaded):
        for body in loaded.tables.body:
            scene.add_body(
                _shape(body, loaded.folder),
                name=body.name,
                fixed=body.fixed,
                position=body.position,
                quaternion=body.quaternion,
                motion=loaded.motions.get(body.name),
                texture=_texture(body, loaded.folder),
            )
        engine = (
            None if loaded.tables.engine is None else open_engine(scene, loaded, _motors(loaded, devices, local_ns))
        )
        friction = loaded.tables.engine.friction if loaded.tables.engine else None
        skins = {}
        for skin in loaded.tables.skin:
            device = devices[skin.title]
            if skin.link is None or not len(device.layout):
                continue
            placed = []
            for part in parts_of(skin, device.layout):
                link, ignored = _body_of(scene, engine, part)
                wanted = (laws or {}).get(skin.title, ())
                model = sensor_model(skin, device, wanted, part=part, ignored=ignored, friction=friction)
                sensor = scene.add_sensor(model, link=link, name=part.name, transducers=transducers_of(skin))
                if engine is not None:
                    engine.attach_sensor(sensor)
                placed.append(PlacedSensor(sensor, part))
            skins[skin.title] = PlacedSkin(placed, len(device.layout))
    return scene, skins


def build_simulation(
    scene: Scene,
    loaded: LoadedScene,
    n_envs: int | None = None,
    *,
    device: str | None = None,
    seed: int | None = None,
    first_env: int = 0,
    like: Simulation | None = None,
) -> Simulation:
    """Compile the scene of a file, with its number type.

    Args:
        scene: the scene that :func:`build_scene` returned.
        loaded: the file.
        n_envs: as for :meth:`tactemu.Scene.build`, as ``first_env`` and ``like``.
        device: the device that runs the kernels; default: the file's own.
        seed: root of all random streams; default: the file's own.
        first_env: see ``n_envs``.
        like: see ``n_envs``.

    Raises:
        SceneError: as :meth:`tactemu.Scene.build`; the message names the file.
    """
    from tactemu.sensors.build_options import device_of

    world = loaded.tables.scene
    chosen = device or world.compute
    with named_file(loaded, "scene.compute: ", is_own=chosen == world.compute):
        device_of(chosen)
    with named_file(loaded):
        seed = world.seed if seed is None else seed
        return scene.build(n_envs, device=chosen, seed=seed, dtype=world.dtype, first_env=first_env, like=like)


def open_engine(scene: Scene, loaded: LoadedScene, motors: Sequence[JointMotors]) -> Any:
    """Open the engine that a scene file names, an :class:`Engine`, and add the bodies of its model to the scene.

    Raises:
        SceneError: a skin has joints and the engine moves no motors, the engine or a library that it needs is not
            installed, the engine cannot read its model, or an engine of the user's own raises an error.
    """
    table = loaded.tables.engine
    assert table is not None
    if motors and not table.moves_motors:
        raise SceneError(
            f'skin {motors[0].skin!r}: joints: an engine of kind {table.kind!r} moves no motors; use kind "mujoco"'
        )
    try:
        engine: Any = table.open(scene, loaded.folder, motors)
    except TactemuError:
        raise
    except Exception as raised:
        raise own_error(ENGINES, table.kind, raised) from raised
    if isinstance(table, BatchTable):
        engine.starts = loaded.starts
    return engine


def read_engine(loaded: LoadedScene) -> BatchEngine | None:
    """Return the engine of many environments of a scene file with its model, for an empty scene; ``None`` if none.

    Raises:
        SceneError: the model cannot be read.
    """
    from tactemu.scene.scene import Scene

    if not isinstance(loaded.tables.engine, BatchTable):
        return None
    return open_engine(Scene(dt=loaded.tables.scene.dt), loaded, _motors(loaded, {}, lambda _skin, t_ns: t_ns))


def _motors(
    loaded: LoadedScene, devices: Mapping[str, Device], local_ns: Callable[[str, int], int]
) -> list[JointMotors]:
    return [
        JointMotors(skin.title, devices[skin.title], skin.joints, partial(local_ns, skin.title))
        for skin in loaded.tables.skin
        if skin.joints
    ]


def _body_of(scene: Scene, engine: Engine | None, part: SkinPart) -> tuple[Body, tuple[int, ...]]:
    """Return the body that carries a part of a skin, and the indices of the bodies that the skin ignores."""
    name = part.body
    if engine is None or any(body.name == name for body in scene.bodies if body not in engine.bodies):
        return scene.body(name), ()
    return engine.body_of(name, part.name), engine.ignored_bodies(name)


def _shape(body: BodyTable, folder: Path) -> Shape | None:
    if body.shape == "frame":
        return None
    own = {name: getattr(body, name) for name in type(body).model_fields if name not in BodyTable.model_fields}
    try:
        return shape_class(body.shape).from_file(folder, **own)
    except SceneError as error:
        raise SceneError(f"body {body.name!r}: {error}") from None


def _texture(body: BodyTable, folder: Path) -> Texture | None:
    try:
        return None if body.texture is None else body.texture.make(folder)
    except SceneError as error:
        raise SceneError(f"body {body.name!r}: {error}") from None


def model_name(skin: SkinTable, device: Device) -> str:
    """Return the name of a skin's sensor model: the one that the file gives, else the cheapest that is suitable."""
    if skin.model_ or not skin.transducer:
        return skin.model_ or cheapest(device.contact[0])
    takes = [name for name in transducers_of(skin)[0].takes if name in TOUCH]
    return cheapest("force" if "force" in takes else takes[0])


def sensor_model(
    skin: SkinTable,
    device: Device,
    laws: Sequence[str] = (),
    *,
    part: SkinPart | None = None,
    ignored: tuple[int, ...] = (),
    friction: float | None = None,
) -> Any:
    """Return the sensor model of a skin: the device's taxels, placed on the link, with the skin's options.

    ``laws`` are built although they are off, so that they can be switched on. ``part`` is one part of a skin on several
    bodies. The skin ignores the bodies ``ignored``, and has the scene's ``friction`` unless its options set one.

    Raises:
        SceneError: there is no such model, or it does not have or accept an option.
    """
    name = model_name(skin, device)
    try:
        model = model_class(name)
    except SceneError as error:
        raise SceneError(f"skin {skin.title!r}: model: {error}") from error
    _check_senses(skin, name, model, device)
    where = f"skin {skin.title!r}: options"
    try:
        known = defaults(model)
        given = taxels(part or parts_of(skin, device.layout)[0], skin, model, known) | _arrays(skin.options)
        if friction is not None and "friction" in known:
            given.setdefault("friction", friction)
        if ignored:
            given.setdefault("ignore", ignored)
        if laws:
            given["adjustable"] = tuple(sorted({*given.get("adjustable", ()), *laws}))
        return from_flat(model, given, name)
    except (TypeError, ValueError, ArithmeticError, SceneError) as error:
        raise SceneError(f"{where}: {error}") from error


def _check_senses(skin: SkinTable, name: str, model: Any, device: Device) -> None:
    offers = model.layouts
    if skin.transducer:
        kind = Chain(f"skin {skin.title!r}", transducers_of(skin), offers).output
        if device.contact != (kind.quantity,):
            raise SceneError(
                f"skin {skin.title!r}: its transducers provide {kind.quantity}, but {device.name} "
                f"senses {', '.join(device.contact)}"
            )
        return
    for quantity in device.contact:
        if quantity not in offers:
            raise SceneError(
                f"skin {skin.title!r}: model: {name} provides {', '.join(model.layouts)} and not {quantity}, "
                f"which {device.name} senses (models that do: {', '.join(models_for(quantity))})"
            )


def taxels(part: SkinPart, skin: SkinTable, model: type[SensorModel], known: Collection[str]) -> dict[str, Any]:
    """Return the model's options for the taxels: positions, normals and radius in the link's frame.

    Those of a single grid have shape ``(rows, cols, 3)``.
    """
    layout = part.layout
    turn = rotation.normalised(part.quaternion)
    radius = numbers(model.__name__, "radius", skin.options.get("radius", layout.pitches / 2))
    below = skin.embed if skin.embed is not None else radius if model.senses_within_radius else 0.0
    inside = layout.positions - np.reshape(np.broadcast_to(below, (len(layout),)), (-1, 1)) * layout.normals
    positions = rotation.rotate(turn, inside) + np.asarray(part.position)
    normals = rotation.rotate(turn, layout.normals)
    patch = layout.patches[0]
    if len(layout.patches) == 1 and patch.rows > 1 and patch.cols > 1:
        positions = positions.reshape(patch.rows, patch.cols, 3)
        normals = normals.reshape(patch.rows, patch.cols, 3)
    given = {
        "positions": positions,
        "normals": normals,
        "radius": _one_or_each(layout.pitches / 2),
        "taxel_area": _one_or_each(layout.areas),
    }
    return {name: value for name, value in given.items() if name in known}


def _one_or_each(values: np.ndarray) -> Any:
    """Return one number if it is the same for all taxels, else a tuple with one for each."""
    return float(values[0]) if len(values) and (values == values[0]).all() else tuple(values.tolist())


def _arrays(options: dict[str, Any]) -> dict[str, Any]:
    return {name: tuple(value) if isinstance(value, list) else value for name, value in options.items()}
