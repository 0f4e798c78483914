"""The loading of classes that users name, with errors of this package."""

from __future__ import annotations

from typing import Any

from firmware_protocols.named_classes import NamedClasses, UnknownNameError, WrongClassError
from tactemu.base.errors import SceneError, TactemuError


def load_class(registry: NamedClasses, name: str, error: type[TactemuError] = SceneError) -> Any:
    """Return a class of a registry by name: that of the table, of an entry point, or ``path/to/file.py:Class``.

    Args:
        registry: the classes of one kind.
        name: the name.
        error: the class of the error that is raised.

    Raises:
        TactemuError: there is no such class, or the user's own code raises an error.
    """
    try:
        return registry.load(name)
    except (UnknownNameError, WrongClassError) as wrong:
        raise error(wrong.args[0]) from None
    except Exception as raised:  # a user's own code may raise anything
        raise own_error(registry, name, raised, error) from raised


def own_error(
    registry: NamedClasses, name: str, raised: Exception, error: type[TactemuError] = SceneError
) -> Exception:
    """Return the error that tells what a user's own code raised; what other code raised is returned as it is."""
    if not registry.is_own(name):
        return raised
    where = "the file" if ".py:" in name else "the package"
    return error(f"{name}: {where} raised {type(raised).__name__}: {raised}")
