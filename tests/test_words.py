"""Tests of the rules for docstrings, names and sizes of files, which CONTRIBUTING.md states."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("tactemu", "firmware_protocols", "benchmarks")
FILES = [file for package in PACKAGES for file in sorted((ROOT / package).rglob("*.py"))]
SOURCES = {".py", ".c", ".h"}
FRAGMENT_OPENERS = frozenset(
    "What Whether Which Who Whose Where When How Of That Those Its For From By In On As To None Nothing Something "
    "Nobody Somebody".split()
)
"""First words after which no sentence comes that stands alone."""
NO_VERBS = frozenset(
    "The A An One All Every Each Both Another Any Some Many Several There It This These They Everything Everyone "
    "Same Likewise Without Between While Until Is Are Has Was Were Two Three And Or But If With At Into Not No Only "
    "Also Then Now Here".split()
)
"""First words with which no verb in the imperative begins."""
OWNERS = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
NAMES = tomllib.loads((ROOT / "tests/data/words.toml").read_text())["replaced"]
"""A name of the past, and the name of today; ``folder/:name`` holds for paths that contain ``folder/``."""


def docstrings(tree: ast.Module) -> Iterator[tuple[int, ast.AST, str]]:
    """Yield the line, the node and the text of every docstring, also of those under a constant or an attribute."""
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if not isinstance(body, list):
            continue
        for before, part in zip([None, *body], body, strict=False):
            match part:
                case ast.Expr(value=ast.Constant(value=str() as text)) if before is None and isinstance(node, OWNERS):
                    yield part.lineno, node, text
                case ast.Expr(value=ast.Constant(value=str() as text)) if isinstance(
                    before, ast.Assign | ast.AnnAssign
                ):
                    yield part.lineno, before, text
                case _:
                    pass


def is_function(node: ast.AST) -> bool:
    """Return True for what is called: a property is a noun, as an attribute is."""
    if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        return False
    return not any(re.search("property|setter", ast.unparse(decorator)) for decorator in node.decorator_list)


def objection(node: ast.AST, text: str) -> str | None:
    """Return what is wrong with the first word of a docstring, or None."""
    first = text.split()[0].strip("`*,.:;") if text.split() else ""
    if first in FRAGMENT_OPENERS:
        return "is a fragment"
    if is_function(node) and first in NO_VERBS:
        return "of a function begins with no verb in the imperative"
    return None


def names(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Yield the line and the name of every definition, argument and attribute that is set."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.lineno, node.name
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.attr


def replaced(path: str, name: str) -> str | None:
    """Return the name that stands for ``name`` in the file at ``path``, or None if the name is free."""
    for row, then in NAMES.items():
        where, _, word = row.rpartition(":")
        if word == name and where in path:
            return then
    return None


@pytest.mark.parametrize(
    "text", ["What a wire drops.", "Of a command in a log.", "None.", "The bytes of a frame.", "Its name."]
)
def test_a_fragment_is_found(text):
    (_, node, found), *_ = docstrings(ast.parse(f'def f():\n    """{text}"""\n'))
    assert objection(node, found)


@pytest.mark.parametrize("package", PACKAGES)
def test_docstrings_are_sentences(package):
    found = [
        f"{file.relative_to(ROOT)}:{line}: {objection(node, text)}: {text.split(chr(10))[0]}"
        for file in FILES
        if file.relative_to(ROOT).parts[0] == package
        for line, node, text in docstrings(ast.parse(file.read_text()))
        if objection(node, text)
    ]
    assert not found, "\n".join(found)


def test_names_are_the_field_s():
    found = []
    for file in FILES:
        path = str(file.relative_to(ROOT))
        every = [(1, file.stem), *names(ast.parse(file.read_text()))]
        found += [f"{path}:{line}: {name}: {then}" for line, name in every if (then := replaced(path, name.strip("_")))]
    assert not found, "\n".join(found)


MAX_LINES = 400
"""Longest file: beyond it a file is about two things."""
MIN_LINES = 30
"""Shortest file of the product: below it a file costs its reader more to open than to read."""
FACES = {"__init__.py", "__main__.py", "version.py", "models.py", "devices.py"}
"""Names of files that may be shorter."""


def test_files_are_about_one_thing():
    files = [file for folder in (*PACKAGES, "tests", "scripts") for file in sorted((ROOT / folder).rglob("*.*"))]
    lines = {file.relative_to(ROOT): len(file.read_text().splitlines()) for file in files if file.suffix in SOURCES}
    assert not {str(file): count for file, count in lines.items() if count > MAX_LINES}
    product = {file: count for file, count in lines.items() if file.parts[0] in PACKAGES and file.name not in FACES}
    assert not {str(file): count for file, count in product.items() if count < MIN_LINES and file.suffix == ".py"}
