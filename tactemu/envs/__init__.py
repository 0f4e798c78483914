"""Environments of Gymnasium with touch, the extra ``tactemu[gym]``. ``import tactemu.envs`` registers them.

``__init__.pyi`` lists the public names; they are imported on first use.
"""

from __future__ import annotations

from importlib.util import find_spec

from firmware_protocols.public_names import import_public, public_names

_MODULE_OF = public_names(__file__)

__all__ = list(_MODULE_OF)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str):
    if name in _MODULE_OF and not find_spec("gymnasium"):
        raise ImportError("tactemu.envs needs gymnasium: pip install 'tactemu[gym]'")
    return import_public(__name__, _MODULE_OF, name)


def __dir__():
    return [*__all__]


def _register() -> None:
    """Register the environments for ``gymnasium.make`` and ``gymnasium.make_vec``."""
    import gymnasium

    for name in ("Press", "Hand"):
        place = f"tactemu.envs.{name.lower()}:{name}"
        gymnasium.register(f"tactemu/{name}-v0", entry_point=f"{place}Env", vector_entry_point=f"{place}VectorEnv")


if find_spec("gymnasium"):
    _register()
