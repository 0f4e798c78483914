"""Devices, sensor models, shapes, transducers and engines of a user's own: from files and packages."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import tactemu as tt
from tactemu.base.errors import DeviceError, SceneError
from tactemu.cli import main
from tactemu.models import model_class, shape_class, transducer_class
from tactemu.scene import file
from tactemu.scene.building import build_scene, make_devices
from tests.pages import ROOT, files_of

OWN = """
from dataclasses import dataclass
from typing import Annotated

from firmware_protocols.template import VendorModel
from tactemu import KinematicTaxel, Sphere
from tactemu.models import Engine, EngineTable, Length, Transducer, transducer_class

print("the code runs")


class Skin(VendorModel):
    name = "own_skin"


class Taxel(KinematicTaxel):
    level = 2


@dataclass(frozen=True, kw_only=True)
class Bead(Sphere):
    radius: Annotated[Length, "of the bead [m]"] = 0.006


class Layer(transducer_class("material")):
    pass


class Drop(EngineTable):
    \"\"\"A bead that sinks.\"\"\"

    speed: float = 0.01

    def open(self, scene, folder, motors):
        return Sinking(scene, self.speed)


class Sinking(Engine):
    def __init__(self, scene, speed):
        self.speed = speed
        self.bodies = [scene.add_body(Bead(), name="bead", position=(0, 0, 0.008))]
        scene.posers.append(self.pose)

    def pose(self, simulation, t_s):
        simulation.set_pose(self.bodies[0], position=(0, 0, 0.008 - self.speed * t_s))


class Nothing:
    pass
"""

PAD = '[[body]]\nname = "pad"\nshape = "frame"\nfixed = true\n'
BEAD = '[[body]]\nname = "bead"\nshape = "{shape}"\n{more}position = [0, 0, 0.005]\n'
SKIN = '[[skin]]\nname = "s"\ndevice = "{device}"\nlink = "pad"\n{more}'
BLOCKS = {
    "device": PAD + SKIN.format(device="{}Skin", more=""),
    "model": PAD + SKIN.format(device="anyskin", more='model = "{}Taxel"\n'),
    "shape": PAD + BEAD.format(shape="{}Bead", more="radius = 0.006\n") + SKIN.format(device="anyskin", more=""),
    "transducer": PAD + SKIN.format(device="anyskin", more='[[skin.transducer]]\nkind = "{}Layer"\n'),
    "engine": PAD + '[engine]\nkind = "{}Drop"\nspeed = 0.05\n' + SKIN.format(device="anyskin", more=""),
}
"""A scene file for each kind of class, with a place for what comes before the class's name."""
POINTS = {
    "devices": "own_skin = own_pieces:Skin",
    "models": "own_taxel = own_pieces:Taxel",
    "shapes": "own_bead = own_pieces:Bead",
    "transducers": "own_layer = own_pieces:Layer",
    "engines": "own_drop = own_pieces:Drop",
}
INSTALLED = {"Skin": "own_skin", "Taxel": "own_taxel", "Bead": "own_bead", "Layer": "own_layer", "Drop": "own_drop"}


@pytest.fixture
def folder(tmp_path) -> Path:
    """A folder with the code and, elsewhere than the working directory, with the scenes beside it."""
    (tmp_path / "code").mkdir()
    (tmp_path / "code" / "pieces.py").write_text(OWN)
    for name, text in BLOCKS.items():
        (tmp_path / f"{name}.toml").write_text(text.replace("{}", "code/pieces.py:"))
    return tmp_path


@pytest.fixture
def package(tmp_path, monkeypatch) -> Path:
    """A package that is installed as ``pip install`` leaves it, and scenes with the names of its entry points."""
    site = tmp_path / "site"
    info = site / "own_pieces-1.0.dist-info"
    info.mkdir(parents=True)
    (site / "own_pieces.py").write_text(OWN)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: own_pieces\nVersion: 1.0\n")
    groups = (f"[tactemu.{group}]\n{line}\n" for group, line in POINTS.items())
    (info / "entry_points.txt").write_text("".join(groups))
    for name, text in BLOCKS.items():
        for kind, installed in INSTALLED.items():
            text = text.replace("{}" + kind, installed)
        (tmp_path / f"{name}.toml").write_text(text)
    monkeypatch.syspath_prepend(site)
    yield tmp_path
    sys.modules.pop("own_pieces", None)


def pushed(path: Path) -> np.ndarray:
    """Readings of a scene file after a step."""
    loaded = file.load(path)
    scene, _skins = build_scene(loaded, make_devices(loaded))
    simulation = scene.build()
    for _ in range(60):
        simulation.step()
    return scene.sensors[0].read()[0]


@pytest.mark.parametrize("kind", ["device", "model", "shape", "engine"])
def test_a_scene_file_names_a_class_in_a_file_beside_it(folder, kind):
    force = pushed(folder / f"{kind}.toml")
    assert (force[..., 2] < 0).any() == (kind in ("shape", "engine"))


@pytest.mark.parametrize("kind", ["device", "model", "shape", "engine"])
def test_a_scene_file_names_a_class_of_an_installed_package(package, kind):
    force = pushed(package / f"{kind}.toml")
    assert (force[..., 2] < 0).any() == (kind in ("shape", "engine"))


def test_a_command_finds_the_classes_of_an_installed_package(package):
    """In a process of its own, which looks for them as that of a user does."""
    code = "import sys; sys.path[:0] = sys.argv[1:3]; from tactemu.cli import main; sys.argv[1:] = sys.argv[3:]; main()"
    command = [sys.executable, "-c", code, str(package / "site"), str(ROOT), "explain", "engine.toml", "--no-cost"]
    done = subprocess.run(command, cwd=package, capture_output=True, text=True, timeout=100, check=False)
    assert done.returncode == 0, done.stderr
    assert "own_drop" not in done.stderr and "Plan:" in done.stdout


@pytest.mark.parametrize("where", ["folder", "package"])
@pytest.mark.parametrize("kind", BLOCKS)
def test_without_code_none_of_it_runs(request, where, kind, capsys, monkeypatch):
    place = request.getfixturevalue(where)
    monkeypatch.setattr(sys, "argv", ["tactemu", "explain", str(place / f"{kind}.toml"), "--no-code"])
    with pytest.raises(SystemExit) as ended:
        main()
    said = capsys.readouterr()
    assert ended.value.code == 2 and "Python code that would be run" in said.err
    assert "the code runs" not in said.out


def test_without_code_no_device_of_an_installed_package_is_loaded(package, capsys):
    with pytest.raises(SceneError, match="own_skin: this is Python code"):
        file.load("own_skin", code=False)
    assert "the code runs" not in capsys.readouterr().out


def test_python_names_them_too(folder, monkeypatch):
    where = f"{folder}/code/pieces.py"
    assert model_class(f"{where}:Taxel").__name__ == "Taxel"
    assert shape_class(f"{where}:Bead")().radius == 0.006
    assert transducer_class(f"{where}:Layer").__name__ == "Layer"
    scene = tt.Scene()
    body = scene.add_body(shape_class(f"{where}:Bead")(), position=(0, 0, 0.005))
    assert body.shape.radius == 0.006


def test_files_of_one_name_in_two_folders_are_two(tmp_path):
    for folder, radius in (("a", 0.001), ("b", 0.002)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "pieces.py").write_text(OWN.replace("0.006", str(radius)))
    one, other = (shape_class(f"{tmp_path}/{folder}/pieces.py:Bead") for folder in "ab")
    assert (one().radius, other().radius) == (0.001, 0.002)
    assert one.__module__ != other.__module__


WRONG = {
    "shape = 'spere'": "unknown shape 'spere'; did you mean 'sphere'\\? \\(shapes: sphere, box, .*frame; your own: "
    r"path/to/file\.py:Class, or an entry point of tactemu\.shapes\)",
    "shape = 'code/pieces.py:Bed'": "pieces.py has no class 'Bed'",
    "shape = 'code/piece.py:Bead'": "no such shape file: .*piece.py",
    "shape = 'code/pieces.py:Nothing'": "pieces.py:Nothing is no shape: derive the class from Shape",
    "shape = 'code/broken.py:Bead'": "broken.py:Bead: the file raised ZeroDivisionError",
    "shape = 'code/pieces.py:Bead'\nradius = 'big'": r"body\[0\] 'x'.radius: must be a number >= 1e-06 and < 1 m",
    "shape = 'code/pieces.py:Bead'\nradios = 1": "unknown key 'radios'; did you mean 'radius'",
}


@pytest.mark.parametrize("line", WRONG)
def test_a_wrong_shape_is_told(folder, line):
    (folder / "code" / "broken.py").write_text("1 / 0\n")
    path = folder / "scene.toml"
    path.write_text(f"[[body]]\nname = 'x'\n{line}\n" + PAD + SKIN.format(device="anyskin", more=""))
    with pytest.raises(SceneError, match=WRONG[line]):
        file.load(path)


ELSEWHERE = {
    ("device", "Skin"): "no device: derive the class from Device",
    ("model", "Taxel"): "no model: derive the class from SensorModel",
    ("transducer", "Layer"): "no transducer: derive the class from Transducer",
    ("engine", "Drop"): "no engine: derive the class from EngineTable",
}


@pytest.mark.parametrize(("kind", "name"), ELSEWHERE)
def test_a_class_of_the_wrong_kind_is_told(folder, kind, name):
    path = folder / f"{kind}.toml"
    path.write_text(path.read_text().replace(f":{name}", ":Nothing"))
    with pytest.raises((SceneError, DeviceError), match=ELSEWHERE[kind, name]):
        pushed(path)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("device", r"unknown device 'qqqq'; `tactemu devices` lists them \(your own: .*tactemu\.devices"),
        ("model", r"unknown model 'qqqq' \(models: contact_probe, .*your own: .*tactemu\.models"),
        ("transducer", r"unknown transducer 'qqqq' \(transducers: material, .*your own: .*tactemu\.transducers"),
        ("engine", r"unknown engine 'qqqq' \(engines: mujoco, .*your own: .*tactemu\.engines"),
    ],
)
def test_an_unknown_name_says_how_to_name_ones_own(folder, kind, message):
    path = folder / f"{kind}.toml"
    text = path.read_text()
    path.write_text(text.replace(next(part for part in text.split('"') if "pieces.py" in part), "qqqq"))
    with pytest.raises((SceneError, DeviceError), match=message):
        pushed(path)


def test_an_engine_that_moves_no_motors_is_given_none(folder):
    path = folder / "engine.toml"
    joints = 'device = "linker_hand_l6"\njoints = { "index" = "hinge" }'
    path.write_text(path.read_text().replace('device = "anyskin"', joints))
    with pytest.raises(SceneError, match=r"joints: an engine of kind '.*Drop' moves no motors"):
        pushed(path)


def test_the_engine_of_the_page_swings(tmp_path):
    for name, text in files_of(ROOT / "docs" / "scene-files.md").items():
        (tmp_path / name).write_text(text)
    assert (pushed(tmp_path / "pendulum.toml")[..., 2] < 0).any()
    bob = tmp_path / "bob.toml"
    bob.write_text((tmp_path / "pendulum.toml").read_text().replace('link = "pad" ', 'link = "bob" '))
    assert pushed(bob).shape == (5, 3)


def test_editors_accept_names_of_ones_own():
    schema = file.json_schema()["properties"]
    for table in (schema["body"]["items"], schema["engine"]["anyOf"][0]):
        assert [sorted(each) for each in table["anyOf"]][1] == ["properties", "required", "type"]
