"""The public names of a package, imported on first use.

The stub ``__init__.pyi`` beside the package's ``__init__.py`` is their only list. Editors and type checkers read it,
and so does :func:`public_names`: a name in it is there for Python too. ``firmware_protocols`` and ``tactemu`` both have
one.
"""

from __future__ import annotations

import importlib


def public_names(init_file: str) -> dict[str, str]:
    """Return the module of each public name: those imported by the stub of an ``__init__.py``, one a line.

    Args:
        init_file: ``__file__`` of the package.
    """
    with open(f"{init_file.removesuffix('c')}i", encoding="utf-8") as stub:
        lines = [line.split() for line in stub if line.startswith("from ")]
    return {name: module for _from, module, _import, name, *_as in lines if not name.startswith("_")}


def import_public(package: str, modules: dict[str, str], name: str):
    """Return a public name of a package, or a public module.

    Raises:
        AttributeError: the package has no such name.
    """
    if name not in modules:
        raise AttributeError(f"module {package!r} has no attribute {name!r}")
    if modules[name] == package:
        return importlib.import_module(f"{package}.{name}")
    return getattr(__import__(modules[name], fromlist=[name]), name)
