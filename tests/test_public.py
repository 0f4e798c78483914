"""The public names of ``tactemu``: for Python, and for type checkers."""

import ast
import importlib
import re
from pathlib import Path

import pytest
from pydantic import BaseModel

import firmware_protocols as fp
import tactemu

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("name", tactemu.__all__)
def test_every_public_name_is_there(name):
    assert getattr(tactemu, name).__name__ == name


def test_serve_is_the_function_however_often_it_is_used():
    assert callable(tactemu.serve)
    module = importlib.import_module("tactemu.session.serving")
    assert tactemu.serve is module.serve


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'Sphera'"):
        tactemu.Sphera  # noqa: B018


LAZY = {
    # package: each of its public names, and the module that defines it
    "tactemu": tactemu._PUBLIC,
    "firmware_protocols": {name: f"firmware_protocols.{module}" for name, module in fp._MODULE_OF.items()},
}


@pytest.mark.parametrize("package", LAZY)
def test_editors_and_python_are_told_the_same_names(package):
    """``if TYPE_CHECKING:`` imports from the modules that the lazy table names."""
    tree = ast.parse((ROOT / package / "__init__.py").read_text())
    checked = next(node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
    imports = [(node.module, name) for node in checked.body if isinstance(node, ast.ImportFrom) for name in node.names]
    assert all(name.asname == name.name for _, name in imports), "only `X as X` is exported"
    assert {name.name: module for module, name in imports} == LAZY[package]
    for name, module in LAZY[package].items():
        assert getattr(importlib.import_module(package), name) is getattr(importlib.import_module(module), name)


@pytest.mark.parametrize("package", ["tactemu", "firmware_protocols"])
def test_packages_say_that_they_have_types(package):
    assert (ROOT / package / "py.typed").is_file()


def test_only_files_with_kernels_are_checked_less():
    """Rules are switched off where Warp's annotations defeat them, file by file, and nowhere else."""
    reasons = re.compile(r"^\s*@wp\.(kernel|func|struct)|(import |load_)mujoco", re.MULTILINE)
    for package in ("tactemu", "firmware_protocols"):
        for path in (ROOT / package).rglob("*.py"):
            text = path.read_text()
            assert "# pyright: report" not in text or reasons.search(text), path.relative_to(ROOT)


def test_the_version_is_told_in_one_place():
    assert re.fullmatch(r"\d+\.\d+\.\d+", tactemu.__version__)
    assert not re.search(r"^version\s*=", (ROOT / "pyproject.toml").read_text(), re.MULTILINE)


def test_the_changelog_begins_with_this_version():
    headings = re.findall(r"(?m)^## (.*)$", (ROOT / "CHANGELOG.md").read_text())
    assert re.fullmatch(re.escape(tactemu.__version__) + r" \((unreleased|20\d\d-\d\d-\d\d)\)", headings[0])
    assert not [line for line in headings[1:] if "unreleased" in line]


def test_no_public_object_speaks_pydantics_words():
    public = [getattr(tactemu, name) for name in tactemu.__all__]
    tables = [thing for thing in public if isinstance(thing, type) and issubclass(thing, BaseModel)]
    assert tactemu.Event in tables
    for table in tables:
        with pytest.raises(tactemu.SceneError, match="unknown key 'no_such_key'"):
            table(no_such_key=1)
