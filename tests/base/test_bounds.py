"""Tests of types of numbers: a value is refused in the same words wherever a user gives it."""

import dataclasses
import inspect
import math
import tomllib
import typing
from typing import Annotated

import numpy as np
import pytest
from pydantic import ConfigDict, TypeAdapter, ValidationError

import firmware_protocols as fp
import tactemu as tt
from firmware_protocols.bounds import LARGEST, LARGEST_INT, Bounds
from firmware_protocols.messages import error_message, nearest
from firmware_protocols.registry import DEVICES
from tactemu.base import units
from tactemu.base.options import check_declared, number
from tactemu.emulator.options import AssemblyOptions
from tactemu.geometry.motion import MOTIONS
from tactemu.geometry.shapes.registry import SHAPES, shape_class
from tactemu.plan.plan import Dtype
from tactemu.scene import file
from tactemu.scene.building import build_scene, make_devices
from tactemu.scene.schema import SceneTable
from tactemu.sensors.build_options import BuildOptions
from tactemu.sensors.models import MODELS, model_class
from tactemu.transducers.registry import TRANSDUCERS, transducer_class

TYPES = {name: kind for name, kind in vars(units).items() if hasattr(kind, "__metadata__")}
VALUES = [-1e300, -1, -0.0, 0, 1e-9, 0.5, 1, 2.0, 7, 1e5, 1e13, 1e300, 10**400, -math.inf, math.inf, math.nan]
VALUES += [True, False, "1", "much", None, [1.0], np.float32(0.25), np.int64(3)]
SCENE = """
[[body]]
name = "pad"
shape = "frame"

[[body]]
name = "ball"
shape = "sphere"
radius = 0.006
{motion}

[[skin]]
device = "flexitac"
link = "pad"
{skin}

[scene]
{scene}
"""


@pytest.mark.parametrize(
    ("bounds", "value", "whole", "says"),
    [
        (Bounds(), math.nan, False, "must be a finite number, got nan"),
        (Bounds(), -1e13, False, f"must be >= {-LARGEST:g}, got -10000000000000.0"),
        (Bounds(unit="m", above=0), 0, False, "must be > 0 m, got 0"),
        (Bounds(unit="m", low=0, below=3), 3, False, "must be >= 0 and < 3 m, got 3"),
        (Bounds(low=1), 1.5, True, "must be a whole number >= 1, got 1.5"),
        (Bounds(low=1), LARGEST_INT + 1, True, f"must be a whole number >= 1 and <= {LARGEST_INT:g}, got {2**63}"),
        (Bounds(low=0), True, False, "must be >= 0, got True"),
        (Bounds(low=0, high=math.inf), "1", False, "must be a number >= 0, got the text '1'"),
    ],
)
def test_a_value_out_of_bounds_is_refused(bounds, value, whole, says):
    with pytest.raises(ValueError) as error:
        bounds.check(value, whole)
    assert str(error.value) == says


def test_a_value_within_bounds_is_a_plain_number():
    assert Bounds(high=math.inf).check(math.inf) == math.inf
    assert type(Bounds().check(np.float32(0.5))) is float and type(Bounds().check(1)) is float
    assert type(Bounds(low=0).check(3.0, whole=True)) is int and type(Bounds().check(np.int8(3), whole=True)) is int
    assert Bounds().check(LARGEST_INT, whole=True) == LARGEST_INT


@pytest.mark.parametrize("name", TYPES)
def test_pydantic_and_python_agree(name):
    adapter = TypeAdapter(TYPES[name], config=ConfigDict(allow_inf_nan=False))
    for value in VALUES:
        try:
            expected = number("here", "it", value, TYPES[name])
        except tt.SceneError as error:
            with pytest.raises(ValidationError) as found:
                adapter.validate_python(value)
            assert f"here: it {error_message(found.value.errors()[0])}" == str(error)
        else:
            assert adapter.validate_python(value) == expected


def in_file(motion: str = "", skin: str = "", scene: str = "") -> None:
    """Read a scene with these keys, and make its devices."""
    loaded = file.check(tomllib.loads(SCENE.format(motion=motion, skin=skin, scene=scene)))
    build_scene(loaded, make_devices(loaded))


def refused(make, *args, **keys) -> str:
    """Return the end of the message by which a value is refused: what it must be, and what was given."""
    with pytest.raises((tt.SceneError, tt.DeviceError, ValueError)) as error:
        make(*args, **keys)
    return str(error.value).partition(" must be ")[2]


@pytest.mark.parametrize("value", ["100", "1e-8", "nan", "inf", "true", "'1 ms'"])
def test_the_step_of_a_scene(value):
    given = tomllib.loads(f"x = {value}")["x"]
    said = refused(tt.Scene, dt=given)
    assert said and said == refused(in_file, scene=f"dt = {value}")


@pytest.mark.parametrize("value", ["0", "-1.0", "1e9", "'fast'", "true"])
def test_a_rate(value):
    given = tomllib.loads(f"x = {value}")["x"]
    said = refused(AssemblyOptions, rate_hz=given)
    assert said and said == refused(in_file, skin=f"rate_hz = {value}")
    assert (
        said
        == refused(AssemblyOptions, rate_hz={"data": given})
        == refused(in_file, skin=f"rate_hz = {{data = {value}}}")
    )


NEEDED = {
    "hold": {}, "press": {"depth": 0.001}, "slide": {"distance": 0.01}, "roll": {"distance": 0.01, "radius": 0.006},
    "spin": {"rate": 1.0}, "joint": {"skin": "hand", "joint": "index"},
}  # fmt: skip
"""The keys that each motion needs."""


def numeric(kind: str) -> list[str]:
    """Return the options of a motion that are one number, or a number or ``None``."""
    hints = typing.get_type_hints(MOTIONS[kind], include_extras=True)
    own = {field.name: hints[field.name] for field in dataclasses.fields(MOTIONS[kind])}
    single = {name: hint for name, hint in own.items() if typing.get_origin(hint) is not tuple}
    return [name for name, hint in single.items() if "Bounds" in repr(hint)]


@pytest.mark.parametrize(("kind", "name"), [(kind, name) for kind in NEEDED for name in numeric(kind)])
@pytest.mark.parametrize("value", [-1e300, 1e300, "much", True])
def test_options_of_motions(kind, name, value):
    keys = NEEDED[kind] | {name: value}
    said = refused(MOTIONS[kind], **keys)
    toml = ", ".join(f"{key} = {str(each).lower() if each is True else repr(each)}" for key, each in keys.items())
    assert said and said == refused(in_file, motion=f"motion = {{kind = '{kind}', {toml}}}")


@pytest.mark.parametrize("value", [0, 1000, 1.5, "much", True])
def test_options_of_devices(value):
    toml = "true" if value is True else repr(value)
    said = refused(fp.create, "flexitac", rows=value)
    assert said and said == refused(in_file, skin=f"device_options = {{rows = {toml}}}")


@pytest.mark.parametrize("value", ["-1.0", "1e300", "'much'", "true", "nan"])
def test_options_of_sensors(value):
    def in_python():
        scene = tt.Scene()
        pad = scene.add_body(None, name="pad")
        scene.add_sensor(tt.KinematicTaxel(normal_stiffness=tomllib.loads(f"x = {value}")["x"]), link=pad)
        scene.build()

    def in_toml():
        text = SCENE.format(motion="", scene="", skin=f"options = {{normal_stiffness = {value}}}")
        loaded = file.check(tomllib.loads(text))
        build_scene(loaded, make_devices(loaded))[0].build()

    said = refused(in_python)
    assert said and said == refused(in_toml)


DECLARED = {
    **{name: model_class(name) for name in MODELS},
    **{name: transducer_class(name) for name in TRANSDUCERS},
    **{name: shape_class(name) for name in SHAPES},
    **MOTIONS,
}


@pytest.mark.parametrize("name", DECLARED)
def test_the_types_of_all_options_are_known_when_it_runs(name):
    """A type that is imported for type checkers only would leave all options of its class unchecked."""
    hints = typing.get_type_hints(DECLARED[name], include_extras=True)
    assert {field.name for field in dataclasses.fields(DECLARED[name])} <= hints.keys()


def test_declared_options_are_checked():
    @dataclasses.dataclass
    class Options:
        size: tuple[units.Length, units.Length] = (1.0, 1.0)
        share: Annotated[units.Share, "of the whole"] | None = None
        fast: bool = False

    check_declared("here", Options(share=1))
    for wrong, says in {
        "size[1] must be > 0 m, got 0.0": Options(size=(1.0, 0.0)),
        "size must be 2 numbers, got (1.0,)": Options(size=(1.0,)),  # type: ignore[arg-type]
        "share must be >= 0 and <= 1, got 2": Options(share=2),
        "fast must be true or false, got 1": Options(fast=1),  # type: ignore[arg-type]
    }.items():
        with pytest.raises(tt.SceneError) as error:
            check_declared("here", says)
        assert str(error.value) == f"here: {wrong}"


def test_a_scene_built_in_python_has_the_defaults_of_a_scene_file():
    table, options = SceneTable(), BuildOptions(n_envs=1)
    defaults = {name: getattr(options, name) for name in ("device", "seed", "dtype")}
    assert tt.Scene().dt == table.dt and (table.compute, table.seed, table.dtype) == tuple(defaults.values())
    for build in (tt.Scene.build, tt.Scene.build_split):
        given = {name: each.default for name, each in inspect.signature(build).parameters.items() if name in defaults}
        assert given and given == {name: defaults[name] for name in given}
    assert typing.get_args(SceneTable.model_fields["dtype"].annotation) == typing.get_args(Dtype)


def test_the_nearest_name_is_a_hint():
    assert nearest("radus", ["radius", "length"]) == "; did you mean 'radius'?"
    assert nearest("xyz", ["radius", "length"]) == "" == nearest(3, ["radius"]) == nearest("", ["_a"])


@pytest.mark.parametrize(
    ("name", "near"),
    [
        ("anyskn", "'anyskin'"),
        ("AnySkin", "'anyskin'"),
        ("singltact", "'singletact'"),
        ("xela", "'xela_server' or 'xela_uskin' or 'xela_uskin_4x6'"),
        ("hello", ""),
        ("sensor", ""),
        ("robot", ""),
        ("reskin", ""),
        ("teensy", ""),
        ("force", ""),
    ],
)
def test_of_devices_only_near_names_are_proposed(name, near):
    assert nearest(name, DEVICES) == (f"; did you mean {near}?" if near else "")


@pytest.mark.parametrize(
    ("name", "known", "near"),
    [
        ("dorp", ("drop", "delay"), "'drop'"),
        ("dup", ("drop", "duplicate"), ""),
        ("boom", ("brownout",), ""),
        ("friction", ("positions",), ""),
        ("mass", ("normals",), ""),
        ("pat", ("pad",), "'pad'"),
        ("walk", ("random_walk",), "'random_walk'"),
    ],
)
def test_of_other_names_only_near_ones_are_proposed(name, known, near):
    assert nearest(name, known) == (f"; did you mean {near}?" if near else "")
