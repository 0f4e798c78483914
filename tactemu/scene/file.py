"""The reader of scene files: TOML text to checked tables, with errors that name file, key and nearest valid name."""

from __future__ import annotations

import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

import firmware_protocols
from firmware_protocols.named_classes import UnknownNameError, WrongClassError, is_file_name
from firmware_protocols.options import checked
from firmware_protocols.registry import REGISTRY as DEVICES
from tactemu.base.errors import DeviceError, SceneError, no_such, reason_of
from tactemu.base.own_code import own_error
from tactemu.geometry.motion import Motion
from tactemu.scene.code_names import own_names
from tactemu.scene.default import tables_for
from tactemu.scene.engine_tables import ENGINES
from tactemu.scene.measured_defaults import measured_defaults
from tactemu.scene.schema import SHAPES, SceneFile, make_motion, motion_schemas
from tactemu.scene.validation_errors import list_errors
from tactemu.scene.words import in_our_words
from tactemu.sensors.models import REGISTRY as MODELS

DEFAULTS = Path(__file__).parent / "defaults"
"""The folder of the scenes of devices, by their names; the scenes of other devices are made from their layouts."""
_SAME_DEFAULT = {"linker_hand_l10": "linker_hand_l6", "linker_hand_o6": "linker_hand_l6"}
"""The device whose default scene another device runs, too."""


@dataclass(frozen=True)
class LoadedScene:
    """A checked scene file."""

    tables: SceneFile
    """The checked tables."""
    motions: dict[str, Motion]
    """The motions, by the name of the body."""
    source: str
    """The file, or the device whose default scene it is."""
    folder: Path
    """The folder that paths in the file are relative to."""
    starts: Mapping[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    """Start poses, in each environment, of bodies that an engine moves freely
    (:attr:`tactemu.engines.batch_engine.BatchEngine.starts`); default: those of its model."""


def load(target: str | Path, device_options: Mapping[str, Any] | None = None, *, code: bool = True) -> LoadedScene:
    """Return the scene in the file ``target``, or the default scene of the device called ``target`` with its options.

    Reading a scene runs the code of others that it names: Python files, and classes of installed packages.
    ``code=False`` refuses a scene that names any, and runs none.

    Raises:
        SceneError: the file cannot be read or has errors; the message lists every error.
        DeviceError: ``target`` is neither a file nor a device, or the device does not take an option.
    """
    text = str(target)
    if not code and DEVICES.is_own(text):
        raise SceneError(f"{text}: this is Python code, which would be run; give a scene file without code")
    if text.endswith(".toml"):
        if device_options:
            named = ", ".join(device_options)
            raise SceneError(f"{text}: give the options {named} in the scene file, as `device_options` of its skins")
        path = Path(text)
        try:
            return parse(path.read_text(encoding="utf-8-sig"), source=text, folder=path.parent, code=code)
        except (OSError, UnicodeDecodeError) as error:
            reason = reason_of(error) if isinstance(error, OSError) else "not a text file"
            raise SceneError(f"{text}: cannot read the scene file: {reason}") from None
    return default_scene(text, device_options or {})


def default_scene(name: str, device_options: Mapping[str, Any] | None = None) -> LoadedScene:
    """Return the default scene of a device.

    It is the file in ``defaults/``, the ``scene`` text of your own class, or a scene made for the device's layout, also
    if options change that layout. A class that inherits from a device does not inherit its scene, which would run the
    parent device.

    Raises:
        DeviceError: there is no such device, or it does not take an option.
        SceneError: the text of the class is no scene, or the scene of another device.
    """
    device, source = device_class(name), f"default scene of {name}"
    if device_options:
        return _with_options(name, device, device_options, source)
    alike = _SAME_DEFAULT.get(name, name)
    shipped = DEFAULTS / f"{alike}.toml"
    if name in firmware_protocols.DEVICES and shipped.is_file():
        return parse(shipped.read_text(encoding="utf-8").replace(f'"{alike}"', f'"{name}"'), source=source)
    if not vars(device).get("scene"):
        return check(tables_for(name, device), source=source)
    loaded = parse(device.scene, source=source)
    own = [skin.device in (name, device.name) for skin in loaded.tables.skin]
    if not any(own):
        raise SceneError(f"{source}: no skin has device = {device.name!r}")
    skins = tuple(
        skin.model_copy(update={"device": name, "name": skin.title}) if is_own else skin
        for skin, is_own in zip(loaded.tables.skin, own)
    )
    return replace(loaded, tables=loaded.tables.model_copy(update={"skin": skins}))


def _with_options(name: str, device: type[firmware_protocols.Device], options: Mapping, source: str) -> LoadedScene:
    try:
        given = checked(device, options)
        layout = device(**given).layout
    except (TypeError, ValueError, ArithmeticError, LookupError) as error:
        raise DeviceError(f"device {name}: {error}") from error
    if not np.array_equal(layout.positions, device().layout.positions):
        return check(tables_for(name, device, **given), source=source)
    loaded = default_scene(name)
    skins = tuple(skin.model_copy(update={"device_options": given}) for skin in loaded.tables.skin)
    return replace(loaded, tables=loaded.tables.model_copy(update={"skin": skins}))


def device_class(name: str) -> type[firmware_protocols.Device]:
    """Return the class of a device, given its name or ``path/to/file.py:Class``.

    Raises:
        DeviceError: there is no such device, or its file raises an error.
    """
    try:
        return firmware_protocols.device_class(name)
    except UnknownNameError as error:
        hint = "" if is_file_name(name) or name.endswith(".py") else "; a scene file ends in .toml"
        said = error.args[0].partition(";")[0] if hint and Path(name).suffix else error.args[0]
        raise DeviceError(f"{said}{hint}") from None
    except WrongClassError as error:
        raise DeviceError(error.args[0]) from None
    except Exception as error:  # a user's device file may raise anything
        raise own_error(DEVICES, name, error, DeviceError) from error


def parse(text: str, *, source: str = "scene", folder: Path | None = None, code: bool = True) -> LoadedScene:
    """Return the scene that a TOML text describes.

    Raises:
        SceneError: the text is no TOML, or has errors; the message lists every error.
    """
    try:
        data = tomllib.loads(text)
    except ValueError as error:  # TOMLDecodeError, and numbers of thousands of digits
        raise SceneError(f"{source}: not valid TOML: {str(error).partition(';')[0]:.200}") from None
    except RecursionError:
        raise SceneError(f"{source}: not a scene: tables or lists are nested too deep") from None
    if not data:
        raise SceneError(f"{source}: the file is empty; `tactemu new FILE` writes a scene to start from")
    return check(data, source=source, folder=folder, code=code)


def check(data: dict[str, Any], *, source: str = "scene", folder: Path | None = None, code: bool = True) -> LoadedScene:
    """Return the scene that tables already read describe.

    Raises:
        SceneError: the tables have errors; the message lists every error.
    """
    for where, name in () if code else own_names(data):
        raise SceneError(
            f"{source}: {where} names {name}, Python code that would be run; give a scene file without code"
        )
    try:
        data = in_our_words(data)
        tables = SceneFile.model_validate(data, context={"folder": folder})
        if any(skin.measured for skin in tables.skin):
            skins = tuple(measured_defaults(skin) if skin.measured else skin for skin in tables.skin)
            tables = tables.model_copy(update={"skin": skins})
    except ValidationError as error:
        raise SceneError(list_errors(error, data, source)) from None
    motions = _motions(tables, source)
    validation_errors = [f"{source}: {text}" for text in _references(tables)]
    if validation_errors:
        raise SceneError("\n".join(validation_errors))
    return LoadedScene(tables, motions, source, folder or Path())


def json_schema() -> dict[str, Any]:
    """Return the JSON schema of a scene file, for editors."""
    schema = SceneFile.model_json_schema(by_alias=True)
    kinds = motion_schemas()
    schema["$defs"] |= kinds
    one = {"oneOf": [{"$ref": f"#/$defs/{name}"} for name in kinds]}
    schema["$defs"]["Motion"] = {"description": "one motion, or a list of them, one after another"} | {
        "anyOf": [one, {"type": "array", "items": one}]
    }
    for body in SHAPES.values():
        schema["$defs"][body.__name__]["properties"]["motion"] = {"$ref": "#/$defs/Motion"}
    properties = schema["properties"]
    properties["body"]["items"] = _or_own(properties["body"]["items"], "shape", SHAPES)
    engine, nothing = properties["engine"]["anyOf"]
    properties["engine"]["anyOf"] = [_or_own(engine, "kind", ENGINES), nothing]
    return schema


def _or_own(table: dict[str, Any], key: str, known: Iterable[str]) -> dict[str, Any]:
    """Return the JSON schema of a table, or of one with any keys for a class of the user's own."""
    own = {"type": "string", "not": {"enum": list(known)}, "description": "path/to/file.py:Class, or of a package"}
    return {"anyOf": [table, {"type": "object", "properties": {key: own}, "required": [key]}]}


def _motions(tables: SceneFile, source: str) -> dict[str, Motion]:
    found = {}
    for body in tables.body:
        if body.motion is None:
            continue
        where = f"{source}: body {body.name!r}: motion"
        if body.fixed:
            raise SceneError(f"{where}: a fixed body does not move; remove `fixed` or the motion")
        try:
            found[body.name] = make_motion(body.motion)
        except ValidationError as error:
            raise SceneError(list_errors(error, body.motion, f"{source}: body {body.name!r}", ("motion",))) from None
        except ValueError as error:
            raise SceneError(f"{where}: {error}") from None
        except SceneError as error:
            raise SceneError(f"{where}: {error}") from None
    return found


def _references(tables: SceneFile):
    """Yield a message for each name that does not exist, or that is used twice."""
    bodies = [body.name for body in tables.body]
    elsewhere = tables.engine is not None  # the engine's bodies are known only once its model is read
    skins = [skin.title for skin in tables.skin]
    for kind, names in (("body", bodies), ("skin", skins)):
        for name, count in sorted(Counter(names).items()):
            if count > 1:
                yield f"{kind} {name!r}: the name is used {count} times; give each {kind} a `name` of its own"
    for skin in tables.skin:
        if (skin.link is None) == (skin.readings is None):
            yield f"skin {skin.title!r}: give it a `link` to a body, or `readings` from a truth log (one of the two)"
        elif skin.link is not None and skin.link not in bodies and not elsewhere:
            yield f"skin {skin.title!r}: link: {no_such('body', skin.link, bodies, 'bodies')}"
        for link, place in skin.links.items():
            body = place if isinstance(place, str) else place.body
            if body not in bodies and not elsewhere:
                yield f"skin {skin.title!r}: links.{link}: {no_such('body', body, bodies, 'bodies')}"
        if skin.joints and tables.engine is None:
            yield f"skin {skin.title!r}: joints: they name joints of an engine's model; add an [engine]"
        if skin.model_ is not None and not MODELS.knows(skin.model_):
            yield f"skin {skin.title!r}: model: {MODELS.unknown(skin.model_)}"
    for k, event in enumerate(tables.scenario):
        if event.skin is not None and event.skin not in skins:
            yield f"scenario[{k}]: skin: {no_such('skin', event.skin, skins)}"
