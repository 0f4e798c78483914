"""Tests of the faces: the modules from which a file of a user's own imports, and the pages and files that show how."""

import ast
import inspect
import re
from pathlib import Path

import pytest

import firmware_protocols
import tactemu
from tactemu import devices, envs, models

ROOT = Path(__file__).parents[1]
FACES = {face.__name__: face for face in (tactemu, envs, models, devices, firmware_protocols)}
SHOWN = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "examples").rglob("*.py"))]
SHOWN += [ROOT / "firmware_protocols" / "template.py"]
SHOWN.remove(ROOT / "docs" / "realism.md")  # figures of this version's own code
FIXTURE = "tactemu.integrations.pytest_plugin", "TactileDevice"
"""The one public name in no face: the type of a fixture of pytest, which tactemu does not need."""
ADDED = {"PinTaxel", "Torus"}
"""Names that `tactemu` has once the files of the pages are part of the tree."""
IMPORT = re.compile(r"\bfrom ((?:tactemu|firmware_protocols)[\w.]*) import (\([^)]*\)|[\w, ]+)")
MODULE = re.compile(r"(?m)^\s*import ((?:tactemu|firmware_protocols)[\w.]*)")
ATTRIBUTE = re.compile(r"\btt\.([A-Za-z]\w*)")


def imported(text: str) -> set[tuple[str, str]]:
    """Module and name of every ``from ... import`` in a text."""
    found = set()
    for module, names in IMPORT.findall(text):
        found |= {(module, name.split()[0]) for name in names.strip("()").split(",") if name.strip()}
    return found


@pytest.mark.parametrize("name", FACES)
def test_every_name_of_a_face_is_there_once(name):
    if FACES[name] is envs:
        pytest.importorskip("gymnasium", reason="pip install 'tactemu[gym]'")
    names = FACES[name].__all__
    assert len(names) == len(set(names))
    assert not [public for public in names if not hasattr(FACES[name], public)]


def test_a_face_imports_its_names_and_does_nothing_else():
    tree = ast.parse(inspect.getsource(models))
    kinds = [type(node) for node in tree.body]
    assert kinds == [ast.Expr, *[ast.ImportFrom] * (len(kinds) - 2), ast.Assign] and ast.get_docstring(tree)
    names = [alias.name for node in tree.body if isinstance(node, ast.ImportFrom) for alias in node.names]
    assert sorted(names) == sorted(models.__all__)


def test_both_faces_of_devices_have_the_same_names():
    assert set(devices.__all__) == set(firmware_protocols.__all__)
    assert all(getattr(devices, name) is getattr(firmware_protocols, name) for name in devices.__all__)


@pytest.mark.parametrize("name", ["dynamixel", "eb90", "feetech", "http", "idl", "modbus", "sums"])
def test_a_public_module_lists_its_names(name):
    module = getattr(firmware_protocols, name)
    own = [public for public, it in vars(module).items() if getattr(it, "__module__", "") == module.__name__]
    assert set(module.__all__) >= {public for public in own if inspect.isclass(getattr(module, public))}
    assert all(hasattr(module, public) for public in module.__all__)


@pytest.mark.parametrize("path", SHOWN, ids=lambda path: path.name)
def test_what_users_are_shown_imports_from_faces_alone(path):
    text = path.read_text(encoding="utf-8")
    private = {
        (module, name)
        for module, name in imported(text) - {FIXTURE}
        if module not in FACES or (name not in FACES[module].__all__ and f"{module}.{name}" not in FACES)
    }
    private |= {(module, "") for module in MODULE.findall(text) if module not in FACES}
    assert not private
    assert set(ATTRIBUTE.findall(text)) <= {*tactemu.__all__, *ADDED}


def test_an_import_past_the_faces_is_found():
    text = "from tactemu.plan.plan import (\n    Stage,\n    Plan,\n)\nfrom tactemu.models import Site\n"
    assert imported(text) == {("tactemu.plan.plan", "Stage"), ("tactemu.plan.plan", "Plan"), ("tactemu.models", "Site")}


def test_types_in_the_contract_of_a_model_are_public():
    """A user can annotate what ``compile``, ``row`` and their arguments have: every class of ours is in a face."""
    public = {name for face in FACES.values() for name in face.__all__}
    contract = (models.SensorModel, models.Site, models.Compiled, models.Setting, models.Stage, models.Context)
    contract += (models.Transducer, models.TransducerSite, models.Shape, models.ShapeKind, models.Row, models.Probes)
    hidden = set()
    for cls in contract:
        module = inspect.getmodule(cls)
        for word in re.findall(r"\b[A-Z]\w+", " ".join(annotations(cls))):
            defined = getattr(getattr(module, word, None), "__module__", None) or ""
            if defined.startswith(("tactemu.", "firmware_protocols.")) and word not in public:
                hidden.add(f"{cls.__name__}: {word}")
    assert not hidden


def annotations(cls: type) -> list[str]:
    """The annotations of the attributes and public methods that a class defines itself, as text."""
    found = [str(annotation) for annotation in cls.__annotations__.values()]
    for name, method in vars(cls).items():
        function = getattr(method, "fget", None) or getattr(method, "__func__", None) or method
        if inspect.isfunction(function) and not name.startswith("_"):
            found += [str(annotation) for annotation in function.__annotations__.values()]
    return found
