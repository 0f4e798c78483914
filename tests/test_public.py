"""The public names of ``tactemu``: for Python, and for type checkers."""

import ast
import importlib
import re
import tomllib
from pathlib import Path

import pytest
from pydantic import BaseModel

import firmware_protocols as fp
import tactemu

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("name", tactemu.__all__)
def test_every_public_name_is_there(name):
    assert getattr(tactemu, name).__name__.removeprefix("tactemu.") == name


def test_serve_is_the_function_however_often_it_is_used():
    assert callable(tactemu.serve)
    module = importlib.import_module("tactemu.session.serving")
    assert tactemu.serve is module.serve


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'Sphera'"):
        tactemu.Sphera  # noqa: B018


PACKAGES = {package.__name__: package for package in (tactemu, fp)}


@pytest.mark.parametrize("package", PACKAGES)
def test_a_stub_has_every_public_name(package):
    """Names that the registries of shapes and models add for Python are in the stub too, where editors see them."""
    body = ast.parse((ROOT / package / "__init__.pyi").read_text()).body
    imports = [(node.module, name) for node in body if isinstance(node, ast.ImportFrom) for name in node.names]
    assert all(name.asname == name.name for _, name in imports), "only `X as X` is exported"
    told = {name.name: module for module, name in imports if name.name != "__version__"}
    assert told == PACKAGES[package]._MODULE_OF
    assert set(dir(PACKAGES[package])) >= set(told)


@pytest.mark.parametrize("package", PACKAGES)
def test_a_public_name_is_what_its_import_gives(package):
    for name, module in PACKAGES[package]._MODULE_OF.items():
        namespace = {}
        exec(f"from {module} import {name}", namespace)
        assert getattr(PACKAGES[package], name) is namespace[name]


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_say_that_they_have_types(package):
    assert (ROOT / package / "py.typed").is_file()


def test_only_files_with_kernels_are_checked_less():
    """Rules are switched off where Warp's types defeat them, file by file, but for one about annotations."""
    reasons = re.compile(r"^\s*@(warp_kernel|wp\.(kernel|func|struct))|(import |load_)mujoco", re.MULTILINE)
    for package in ("tactemu", "firmware_protocols"):
        for path in (ROOT / package).rglob("*.py"):
            text = path.read_text()
            assert "# pyright: report" not in text or reasons.search(text), path.relative_to(ROOT)
    for folder in tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["pyright"]["executionEnvironments"]:
        assert {key for key, on in folder.items() if on is False} == {"reportInvalidTypeForm"}
        assert any(reasons.search(path.read_text()) for path in (ROOT / folder["root"]).rglob("*.py"))


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
