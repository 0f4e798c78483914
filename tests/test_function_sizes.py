"""No function has more than 8 parameters or 60 lines, but for faces, whose parameters are what a user writes."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parent.parent
FILES = [file for package in ("tactemu", "firmware_protocols") for file in sorted((ROOT / package).rglob("*.py"))]
MAX_PARAMETERS = 8
MAX_LINES = 60
FACES = {
    # file::function: the reason why its parameters, or the help in its docstring, are so many
    "tactemu/cli/compare.py::compare": "each option of the command is a parameter, and its docstring is the help",
    "tactemu/cli/judging.py::judge": "as above",
    "tactemu/cli/judging.py::proxy": "as above",
    "tactemu/cli/logs.py::replay": "as above",
    "tactemu/cli/running.py::execute": "as above",
    "tactemu/cli/running.py::run": "as above",
    "tactemu/cli/scenes.py::dataset": "as above",
    "tactemu/sensors/pose_input.py::bind_poses": "public: each array of another simulator is a keyword",
    "firmware_protocols/devices/inspire_rh56dftp.py::__init__": "as above",
    "firmware_protocols/framing.py::__init__": "public: a device's author gives each part of its packets by keyword",
    "firmware_protocols/motors.py::__init__": "public: a device's author gives each figure of its joints by keyword",
}
Function = ast.FunctionDef | ast.AsyncFunctionDef


def is_warp(node: ast.AST) -> bool:
    """Return True for a kernel, or a function that kernels call."""
    return isinstance(node, Function) and any(
        ast.unparse(each).startswith(("wp.", "warp_kernel")) for each in node.decorator_list
    )


def functions(tree: ast.AST) -> Iterator[Function]:
    """Yield the functions that Python runs."""
    for node in ast.iter_child_nodes(tree):
        if not is_warp(node):
            if isinstance(node, Function):
                yield node
            yield from functions(node)


def n_parameters(function: Function) -> int:
    """Return the number of parameters, without ``self``."""
    given = function.args
    names = [each.arg for each in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
    names += [each.arg for each in (given.vararg, given.kwarg) if each is not None]
    return len(names) - (names[:1] in (["self"], ["cls"]))


def lines_of(node: ast.AST) -> set[int]:
    """Return the lines of a definition, decorators left out."""
    return set(range(node.lineno, node.end_lineno + 1))  # type: ignore[attr-defined]


def n_lines(function: Function) -> int:
    """Return the number of lines, without the kernels that a factory of kernels contains."""
    kernels = [each for each in ast.walk(function) if is_warp(each)]
    return len(lines_of(function).difference(*map(lines_of, kernels)))


def test_functions_are_small():
    large = set()
    for file in FILES:
        for function in functions(ast.parse(file.read_text(encoding="utf-8"))):
            if n_parameters(function) > MAX_PARAMETERS or n_lines(function) > MAX_LINES:
                large.add(f"{file.relative_to(ROOT)}::{function.name}")
    assert large - FACES.keys() == set(), "give them a class for their arguments, or parts"
    assert FACES.keys() - large == set(), "these are small enough now: take them off the list"


def test_a_large_function_is_found():
    body = "    x = 1\n" * 60
    wide, long, factory = (
        next(functions(ast.parse(text)))
        for text in (
            "def wide(self, a, b, c, d, /, e, f, *g, h, **i): ...",
            f"def long():\n{body}",
            "def factory():\n    @wp.kernel\n    def kernel():\n"
            + body.replace("x =", "    x =")
            + "    return kernel",
        )
    )
    assert n_parameters(wide) == 9 and n_lines(long) == 61
    assert n_lines(factory) == 3, "a decorator, its factory's head and end"
