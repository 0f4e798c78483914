"""The tables of a scene file, as pydantic models: one declaration for checks, errors and the JSON schema.

``docs/scene-files.md`` explains each with examples; ``tactemu explain --schema`` prints the JSON schema for editors.
"""

from __future__ import annotations

import dataclasses
import inspect
import types
import typing
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    ValidationInfo,
    create_model,
    model_validator,
)

from firmware_protocols.bounds import Bounds
from tactemu.base.errors import nearest
from tactemu.base.own_code import own_error
from tactemu.base.units import (
    DEFAULT_STEP_S,
    LENGTH_UNIT,
    Coordinate,
    Hertz,
    Number,
    Radius,
    Seconds,
    Size,
    StepSeconds,
    Whole,
)
from tactemu.base.words import Names
from tactemu.geometry.motion import MOTIONS, InTurn, Motion, Together
from tactemu.geometry.shapes.registry import REGISTRY as SHAPE_CLASSES
from tactemu.geometry.shapes.registry import shape_class
from tactemu.geometry.shapes.shape import Shape
from tactemu.scene.engine_interface import JointTable
from tactemu.scene.engine_tables import AnyEngine
from tactemu.scene.events import EventTable, FaultText
from tactemu.scene.table import ClassName, Table, not_empty, one_of, placed, tables_of
from tactemu.scene.texture_tables import TextureTable
from tactemu.sensors.signs import Convention

Vector = tuple[Coordinate, Coordinate, Coordinate]


def _turning(quaternion: tuple[float, ...]) -> tuple[float, ...]:
    if not any(quaternion):
        raise ValueError("expected a quaternion (w, x, y, z) that is not zero")
    return quaternion


Quaternion = Annotated[tuple[Number, Number, Number, Number], AfterValidator(_turning)]


def _printable(text: str) -> str:
    if not text.isprintable() or "/" in text:
        raise ValueError(f"expected printable characters without '/', got {text!r}")
    return text


Name = Annotated[str, Field(min_length=1), AfterValidator(_printable)]
"""A name that can appear on terminals and in the paths of ports."""


def _bounded(hint: Any, body: Any = None) -> Any:
    """Return a type whose numbers have bounds: their own, or those of a dimension of a body."""
    inside = typing.get_args(hint)
    if hint in (int, float):
        return body or Annotated[hint, Bounds()]
    if typing.get_origin(hint) is Annotated:
        is_number = inside[0] in (int, float)
        return hint if is_number and not body else body if is_number else _bounded(inside[0], body)
    if not inside:
        return hint
    parts = tuple(_bounded(part, body) for part in inside)
    is_union = typing.get_origin(hint) in (Union, types.UnionType)
    return Union[parts] if is_union else typing.get_origin(hint)[parts]  # noqa: UP007


# -- motion --------------------------------------------------------------------------------------------------------


def _table_of(motion: type[Motion]) -> type[Table]:
    """Return the table with the fields of a motion's dataclass, and its ``kind``."""
    hints = typing.get_type_hints(motion, include_extras=True)
    fields: dict[str, Any] = {"kind": (Literal[motion.kind], ...)}  # type: ignore[name-defined]
    for field in dataclasses.fields(motion):  # type: ignore[arg-type]
        given = ... if field.default is dataclasses.MISSING else field.default
        fields[field.name] = (_bounded(hints[field.name]), given)
    return create_model(f"{motion.__name__}Motion", __base__=Table, __doc__=motion.__doc__, **fields)


_PLAIN = {kind: _table_of(motion) for kind, motion in MOTIONS.items() if motion not in (InTurn, Together)}


def make_motion(tables: dict | list) -> Motion:
    """Return the motion that a ``[body.motion]`` table, or a list of them (one after another), describes.

    Raises:
        SceneError, pydantic.ValidationError: the table describes no motion.
    """
    if isinstance(tables, list):
        return InTurn(tuple(make_motion(table) for table in tables))
    if not isinstance(tables, dict):
        raise ValueError("expected a table with a `kind`, or a list of such tables")
    kind = tables.get("kind", "")
    if not isinstance(kind, str) or kind not in MOTIONS:
        raise ValueError(f"unknown kind of motion {kind!r}{nearest(kind, MOTIONS)} (kinds: {', '.join(MOTIONS)})")
    if kind in ("sequence", "together"):
        checked = _CombinedTable.model_validate(tables)
        parts = tuple(make_motion(table) for table in checked.motions)
        return InTurn(parts, checked.repeat) if kind == "sequence" else Together(parts)
    values = _PLAIN[kind].model_validate(tables).model_dump(exclude={"kind"})
    return MOTIONS[kind](**values)


class _CombinedTable(Table):
    """Motions one after another, or at the same time."""

    kind: Literal["sequence", "together"]
    motions: list[Any] = Field(min_length=1)
    repeat: bool = False
    """Start a sequence over at its end."""


def motion_schemas() -> dict[str, dict[str, Any]]:
    """Return the JSON schema of each motion's table, by its name."""
    return {table.__name__.lstrip("_"): table.model_json_schema() for table in (*_PLAIN.values(), _CombinedTable)}


# -- bodies --------------------------------------------------------------------------------------------------------


class BodyTable(Table):
    """The keys that every ``[[body]]`` has."""

    shape: str
    name: Name
    fixed: bool = Field(default=False, description="the body never moves")
    position: Vector = Field(default=(0.0, 0.0, 0.0), description="position of the body's origin in the world [m]")
    quaternion: Quaternion = Field(default=(1.0, 0.0, 0.0, 0.0), description="orientation in the world (w, x, y, z)")
    motion: Any = Field(
        default=None, description="motion: a table with `kind`, or a list of such tables, one after another"
    )
    texture: TextureTable | None = Field(default=None, description="heights of the surface: a table with `kind`")


@cache
def _body_table(name: str, shape: type[Shape]) -> type[BodyTable]:
    """Return the table with the keys of a shape: its fields, or the parameters of its ``from_file``."""
    own = "from_file" in vars(shape)
    maker = shape.from_file if own else shape
    hints = typing.get_type_hints(maker, include_extras=True)
    fields: dict[str, Any] = {"shape": (Literal[name], ...)}  # type: ignore[valid-type]
    for key, parameter in inspect.signature(maker).parameters.items():
        if key == "folder":
            continue
        about = [text for text in getattr(hints[key], "__metadata__", ()) if isinstance(text, str)]
        given = ... if parameter.default is parameter.empty else parameter.default
        fields[key] = (
            _bounded(hints[key], Radius if key == "radius" else Size),
            Field(default=given, description=" ".join(about) or None),
        )
    return create_model(f"{shape.__name__}Body", __base__=BodyTable, __doc__=shape.__doc__, **fields)


SHAPES: dict[str, type[BodyTable]] = {
    **{name: _body_table(name, shape_class(name)) for name in SHAPE_CLASSES.classes},
    "frame": create_model(
        "FrameBody", __base__=BodyTable, __doc__="No geometry: a link for a skin.", shape=(Literal["frame"], ...)
    ),
}
"""The table of each ``shape``."""


def _own_table(name: str) -> type[BodyTable]:
    """Return the table of a shape of the user's own.

    Raises:
        SceneError: there is no such shape, or the file raises an error.
    """
    shape = shape_class(name)
    try:
        return _body_table(name, shape)
    except Exception as raised:  # its types may be anything
        raise own_error(SHAPE_CLASSES, name, raised) from raised


if TYPE_CHECKING:
    AnyBody = BodyTable
else:
    AnyBody = one_of(SHAPES, "shape", SHAPE_CLASSES, _own_table)


# -- skins ---------------------------------------------------------------------------------------------------------


class ClockTable(Table):
    """The timing of a device: its delays and the errors of its clock."""

    delay_s: Seconds = Field(default=0.0, description="delay from sample to wire [s]")
    jitter_s: Annotated[float, Bounds(unit="s", low=0, high=1)] = Field(
        default=0.0, description="upper bound of a further, uniform delay [s]"
    )
    reorder: bool = Field(default=False, description="with jitter, a later sample may overtake an earlier one")
    skew_ppm: Annotated[float, Bounds(low=-1e5, high=1e6)] = Field(
        default=0.0, description="device clock too slow (> 0) or too fast (< 0)"
    )
    drift_ppm_per_s: Annotated[float, Bounds(low=-1e3, high=1e3)] = Field(
        default=0.0, description="growth of the skew per second"
    )
    missed: Annotated[float, Bounds(low=0, high=0.9)] = Field(
        default=0.0, description="share of samples that the device's loop misses"
    )
    refresh_s: Seconds = Field(
        default=0.0, description="interval at which readings are renewed; they are repeated in between [s]"
    )


def one_or_more(value: Any) -> Any:
    """Return a text as a list of one; anything else as it is."""
    return [value] if isinstance(value, str) else value


Faults = Annotated[tuple[FaultText, ...], BeforeValidator(one_or_more)]


Rates = Annotated[
    Annotated[Hertz, Tag("<number>")] | Annotated[dict[str, Hertz], Tag("<table>")],
    Discriminator(lambda value: "<table>" if isinstance(value, dict) else "<number>"),
]
"""The rate of a device, or a table with the rate of each of its streams."""


class LinkTable(Table):
    """The place of one link of a device. A link placed by itself has its origin in the middle of its taxels."""

    body: str = Field(description="name of the body that carries the link")
    position: Vector = Field(default=(0.0, 0.0, 0.0), description="position of the link's frame on the body [m]")
    quaternion: Quaternion = Field(
        default=(1.0, 0.0, 0.0, 0.0), description="orientation of the link's frame on the body"
    )


def _placed_kind(table: dict[str, Any], info: ValidationInfo) -> dict[str, Any]:
    return table | {"kind": placed(table["kind"], info)} if isinstance(table.get("kind"), str) else table


TransducerTable = Annotated[dict[str, Any], AfterValidator(_placed_kind)]


class SkinTable(Table):
    """A device on a port, whose taxels a sensor on a body simulates."""

    name: Name | None = Field(default=None, description="name of the skin; default: the device's name")
    device: ClassName = Field(description="name of the device (see `tactemu devices`), or path/to/file.py:Class")
    device_options: dict[str, Any] = Field(default={}, description="keyword arguments of the device class")
    link: str | None = Field(default=None, description="name of the body that carries the taxels")
    readings: str | None = Field(default=None, description="instead of a link: truth log whose samples are replayed")
    readings_of: str | None = Field(default=None, description="name of the device in that log; default: its only one")
    links: dict[str, str | LinkTable] = Field(
        default={}, description="bodies that carry single links of the device (fingers ...), by the links' names"
    )
    joints: dict[str, str | JointTable] = Field(
        default={}, description="joints of the engine's model that the device's motors move, by the motors' names"
    )
    position: Vector = Field(default=(0.0, 0.0, 0.0), description="position of the device's frame on the link [m]")
    quaternion: Quaternion = Field(
        default=(1.0, 0.0, 0.0, 0.0), description="orientation of the device's frame on the link"
    )
    model_: ClassName | None = Field(
        default=None,
        alias="model",
        description="sensor model, or path/to/file.py:Class; default: the cheapest suitable one",
    )
    options: dict[str, Any] = Field(default={}, description="options of the sensor model, imperfections included")
    transducer: tuple[TransducerTable, ...] = Field(
        default=(), description="transducers: tables with a `kind`, one after another, between model and electronics"
    )
    embed: Annotated[float, Bounds(unit=LENGTH_UNIT, low=-1, high=1)] | None = Field(
        default=None, description="depth of the probes' centres below the skin [m]"
    )
    port: str | None = Field(
        default=None,
        min_length=1,
        description="port for the driver, such as pty:PATH, tcp:HOST:PORT, can:INTERFACE:CHANNEL or memory:",
    )
    ports: dict[str, str] = Field(default={}, description="ports of a device with several connectors, by their names")
    rate_hz: Rates | None = Field(
        default=None, description="sampling rate, or a table with a rate for each stream; default: the device's own"
    )
    pacing: Literal[True, False, "strict"] = Field(
        default=True, description="bytes and frames take their time on the line; strict: also after a stall"
    )
    clock: ClockTable = ClockTable()
    faults: Faults = Field(default=(), description="faults on the wire")
    measured: bool = Field(
        default=False, description="take keys that the skin does not give (noise, clock ...) from a real device"
    )

    @property
    def title(self) -> str:
        """The name of the skin in statistics and in the truth log."""
        return self.name or self.device.rpartition(":")[2]


class SceneTable(Table):
    """``[scene]``: the settings of the simulation."""

    dt: StepSeconds = Field(default=DEFAULT_STEP_S, description="simulation step [s]")
    seed: Whole = Field(default=0, description="seed of all random numbers")
    compute: str = Field(default="cpu", description="device that runs the kernels: cpu, cuda:0 ...")
    dtype: Literal["float32", "float64"] = Field(default="float32", description="number type of the kernels")
    convention: Convention = Field(
        default="skin",
        description="signs of forces: all act on the skin, or those of Genesis, which no device can have",
    )
    names: Names = Field(
        default="tactemu",
        description="words of poses, options and `set`: ours, or with `genesis` also those of Genesis",
    )

    @model_validator(mode="before")
    @classmethod
    def _computes(cls, data: Any) -> Any:
        if isinstance(data, dict) and "device" in data:
            raise ValueError("unknown key 'device': `compute` runs the kernels; `device` is a key of skins, the sensor")
        return data


class TruthTable(Table):
    """``[truth]``: the part of a run that is kept in memory."""

    keep: str | int | None = Field(default=None, description='memory for samples and frames; default: "256MB"')


class SceneFile(Table):
    """A scene file: all its tables."""

    truth: TruthTable = TruthTable()
    scene: SceneTable = SceneTable()
    engine: AnyEngine | None = None
    body: Annotated[tuple[AnyBody, ...], tables_of("body")] = ()
    skin: Annotated[tuple[SkinTable, ...], BeforeValidator(not_empty), tables_of("skin")]
    scenario: Annotated[tuple[EventTable, ...], tables_of("scenario")] = ()
