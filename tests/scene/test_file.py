"""Scene files: what a right one means, and what a wrong one says."""

import json
import tomllib
from pathlib import Path

import pytest

from tactemu.base.errors import DeviceError, SceneError, TactemuError
from tactemu.emulator.assembly import assemble
from tactemu.emulator.options import AssemblyOptions
from tactemu.geometry.motion import InTurn, Press
from tactemu.scene import file, schema
from tactemu.scene.building import make_devices
from tactemu.scene.engine_tables import ENGINES
from tactemu.scene.events import Event
from tactemu.scene.scene import Scene
from tests.scenes import ball, pad

PAGE = Path(__file__).parents[2] / "docs" / "scene-files.md"
GOOD = (
    pad(0.08, 0.08, 0.02)
    + ball(0.006, [0, 0, 0.02])
    + """
motion = [{kind = "press", depth = 0.001, approach = 0.004, release = false}, {kind = "slide", distance = 0.01}]

[[skin]]
device = "anyskin"
link = "pad"
model = "kinematic_taxel"
options = {normal_stiffness = 400}
faults = "drop 1%"

[[scenario]]
at = 2
skin = "anyskin"
dead = [3]
"""
)


def test_a_file_becomes_tables_and_motions():
    loaded = file.parse(GOOD)
    motion = loaded.motions["ball"]
    assert isinstance(motion, InTurn) and isinstance(motion.motions[0], Press)
    assert motion.motions[0] == Press(depth=0.001, approach=0.004, release=False)
    assert loaded.tables.body[0].size == (0.08, 0.08, 0.02)
    assert loaded.tables.skin[0].faults == ("drop 1%",)
    assert loaded.tables.scene.dt == 1e-3


WRONG = [
    ("radius", "radus", "body[1] 'ball': unknown key 'radus'; did you mean 'radius'?"),
    ('"sphere"', '"spere"', "unknown shape 'spere'; did you mean 'sphere'?"),
    ("fixed = true", 'fixed = "yes"', "body[0] 'pad': fixed must be true or false, got 'yes'"),
    ("fixed = true", "fixed = 1", "body[0] 'pad': fixed must be true or false, got 1"),
    ('"sphere"', '"ball"', "unknown shape 'ball'; did you mean 'sphere'?"),
    ('"slide"', '"slid"', "body 'ball': motion: unknown kind of motion 'slid'; did you mean 'slide'?"),
    ("depth =", "deph =", "body 'ball': motion: unknown key 'deph'; did you mean 'depth'?"),
    ("depth = 0.001", "depth = nan", "body 'ball': motion.depth: must be >= -10 and <= 0.5 m (6 mm is 0.006), got nan"),
    ("depth = 0.001", "depth = 0.001, speed = -1", "body 'ball': motion.speed: must be >= 1e-09"),
    ('link = "pad"', 'link = "pd"', "skin 'anyskin': link: no body 'pd'; did you mean 'pad'?"),
    ("kinematic_taxel", "kinematic", "model: unknown model 'kinematic'; did you mean 'kinematic_taxel'?"),
    ("0.006", "-1", "body[1] 'ball'.radius: must be >= 1e-06 and < 1 m"),
    ("radius = 0.006", "", "body[1] 'ball'.radius: missing key"),
    ("fixed = true", "fixed = true\nmotion = {kind = 'hold'}", "a fixed body does not move"),
    ('name = "ball"', 'name = "pad"', "body 'pad': the name is used 2 times"),
    ('skin = "anyskin"', 'skin = "anyskn"', "scenario[0]: skin: no skin 'anyskn'; did you mean 'anyskin'?"),
    ("at = 2", "at = 2\nuntil = 1", "scenario[0]: until: expected a time after at = 2.0 s, got 1.0"),
    ("[[skin]]", "[[skins]]", "unknown key 'skins'; did you mean 'skin'?"),
    ("[[body]]", "[[body]", "not valid TOML"),
]


@pytest.mark.parametrize(("right", "wrong", "says"), WRONG, ids=[w[1][:20] for w in WRONG])
def test_every_mistake_is_named(right, wrong, says):
    with pytest.raises(SceneError) as error:
        file.parse(GOOD.replace(right, wrong, 1), source="hand.toml")
    assert str(error.value).startswith("hand.toml: ")
    assert says in str(error.value)


def test_all_mistakes_are_listed_at_once():
    with pytest.raises(SceneError) as error:
        file.parse(GOOD.replace("0.006", "-1").replace("[0.08,", "[0,"), source="hand.toml")
    assert len(str(error.value).splitlines()) == 2


def test_a_file_that_is_not_there():
    with pytest.raises(SceneError, match=r"nowhere\.toml: cannot read the scene file: No such file"):
        file.load("nowhere.toml")


def test_neither_file_nor_device():
    with pytest.raises(DeviceError, match=r"unknown device 'nosuch'.*a scene file ends in \.toml"):
        file.load("nosuch")


def test_a_device_file_that_does_not_run(tmp_path):
    path = tmp_path / "broken.py"
    path.write_text("import nothing_of_this_name\n")
    with pytest.raises(DeviceError, match="the file raised ModuleNotFoundError"):
        file.load(f"{path}:Device")


def test_the_schema_knows_every_motion():
    schema = json.loads(json.dumps(file.json_schema()))
    assert schema["$defs"]["PressMotion"]["required"] == ["kind", "depth"]
    assert schema["$defs"]["SphereBody"]["properties"]["motion"] == {"$ref": "#/$defs/Motion"}


def test_every_toml_block_of_the_documentation_is_right():
    page = PAGE.read_text()
    blocks = [block.split("```")[0] for block in page.split("```toml\n")[1:]]
    assert len(blocks) >= 4
    whole = [block for block in blocks if "[[skin]]" in block and "[[body]]" in block]
    assert whole
    for block in whole:
        file.parse(block)
    for block in set(blocks) - set(whole):
        for body in tomllib.loads(block).get("body", []):
            if "motion" in body:
                file.make_motion(body["motion"])
            else:
                schema.SHAPES[body["shape"]].model_validate(body)


@pytest.mark.parametrize(
    "table",
    [schema.SceneTable, schema.SkinTable, schema.ClockTable, Event, *ENGINES.values(), *schema.SHAPES.values()],
)
def test_the_documentation_names_every_key(table):
    page = PAGE.read_text()
    for name, field in table.model_fields.items():
        key = field.alias or name
        assert f"`{key}`" in page or f"{key} = " in page, key


def test_a_device_file_is_found_beside_the_scene(tmp_path):
    (tmp_path / "mine.py").write_text(
        "from firmware_protocols import Device, Serial, grid_layout\n"
        "class Mine(Device):\n"
        "    name = title = 'mine'\n"
        "    ports = (Serial(baud=9600),)\n"
        "    def __init__(self):\n"
        "        self.layout = grid_layout(2, 3, 0.004)\n"
        "    def measure(self, reading, t_ns):\n"
        "        return reading['force'][:, 2]\n"
    )
    path = tmp_path / "scene.toml"
    path.write_text(
        GOOD.replace('device = "anyskin"', 'device = "mine.py:Mine"').replace('skin = "anyskin"', 'skin = "Mine"')
    )
    devices = make_devices(file.load(path))
    assert devices["Mine"].layout.positions.shape == (6, 3)


def test_a_device_file_runs_once_however_often_it_is_named(tmp_path, capsys):
    (tmp_path / "mine.py").write_text(
        "from firmware_protocols.template import VendorModel\nprint('run')\nclass Mine(VendorModel): pass\n"
    )
    name = f"{tmp_path}/mine.py:Mine"
    device = file.device_class(name)
    (made,) = make_devices(file.load(name)).values()
    assert type(made) is device
    assert capsys.readouterr().out == "run\n"


def test_names_of_many_bodies_are_compared_once(tmp_path):
    """A scene of 20,000 bodies took 40 s for this."""
    bodies = "".join(f'[[body]]\nshape = "sphere"\nradius = 0.01\nname = "{k}"\n' for k in range(1000))
    path = tmp_path / "many.toml"
    path.write_text(bodies + '[[skin]]\ndevice = "anyskin"\nlink = "0"\n')
    compared = 0

    class Name(str):
        __hash__ = str.__hash__

        def __eq__(self, other):
            nonlocal compared
            compared += 1
            return str.__eq__(self, other)

    loaded = file.load(str(path))
    for body in loaded.tables.body:
        object.__setattr__(body, "name", Name(body.name))
    assert not list(file._references(loaded.tables))
    scene = Scene()
    for body in loaded.tables.body:
        scene.add_body(name=body.name)
    assert compared < 10_000


OPTIONS = {
    "options = { nois = 1.0 }": "skin 'anyskin': options: kinematic_taxel has no 'nois'; did you mean 'noise'?",
    "device_options = { nois = 1 }": "skin 'anyskin': device anyskin: unknown option 'nois'",
    "transducer = [{ kind = 'magnetc' }]": "skin 'anyskin': transducer 1: unknown transducer 'magnetc'",
    "options = { jitter = 1e9 }": "sensor 'anyskin': jitter must be at most",
    "ports = { usb = 'pty:x' }": "anyskin has no port 'usb'",
    "ports = { '' = 'pt:x' }": "port 'pt:x': unknown scheme 'pt'; did you mean 'pty'?",
    "rate_hz = { imu = 100 }": "anyskin: rate_hz: no stream 'imu'",
    "[[scenario]]\nat = 1\nset = { noise = -1 }": "scenario[0]: sensor 'anyskin': noise must be zero or positive",
    "[scene]\ncompute = 'gpu'": "scene.compute: no device 'gpu' on this machine",
    "[scene]\nconvention = 'genesis'": "skin 'anyskin': devices measure what acts on the skin",
    "[[body]]\nshape = 'sphere'\nradius = 0.01\nname = 'ball'\n[body.motion]\nkind = 'joint'\nskin = 'anyskn'\n"
    "joint = 'x'\naxis = [0, 0, 1]": "body 'ball': motion: no skin 'anyskn'; did you mean 'anyskin'?",
}


@pytest.mark.parametrize("line", OPTIONS)
def test_an_error_of_an_option_names_the_file(line, tmp_path):
    path = tmp_path / "hand.toml"
    path.write_text(f"[[body]]\nname = 'pad'\nshape = 'plane'\n[[skin]]\ndevice = 'anyskin'\nlink = 'pad'\n{line}\n")
    with pytest.raises(TactemuError) as error:
        assemble(file.load(path))
    assert str(error.value).startswith(f"{path}: {OPTIONS[line]}")


def test_an_error_of_an_option_of_the_command_does_not_name_the_file(tmp_path):
    path = tmp_path / "hand.toml"
    path.write_text("[[body]]\nname = 'pad'\nshape = 'plane'\n[[skin]]\ndevice = 'anyskin'\nlink = 'pad'\n")
    for options in ({"device": "gpu"}, {"port": "pt:x"}, {"rate_hz": {"imu": 100}}):
        with pytest.raises(TactemuError) as error:
            assemble(file.load(path), AssemblyOptions(**options))
        assert str(path) not in str(error.value), error.value


def test_a_body_of_python_is_fixed_or_not():
    with pytest.raises(SceneError, match="add_body: fixed must be true or false, got 'yes'"):
        Scene().add_body(fixed="yes")
