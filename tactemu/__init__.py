"""tactemu: a simulated tactile skin on the far end of the wire.

``__init__.pyi`` lists the public names; they are imported on first use, so that ``import tactemu`` costs nothing.
"""

from __future__ import annotations

from firmware_protocols.public_names import import_public, public_names
from tactemu.geometry.shapes.registry import SHAPES
from tactemu.sensors.models import MODELS
from tactemu.version import __version__ as __version__

_CLASSES = [target.partition(":") for target in (*SHAPES.values(), *MODELS.values())]
_MODULE_OF = public_names(__file__) | {kind: module for module, _, kind in _CLASSES}

__all__ = list(_MODULE_OF)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str):
    return import_public(__name__, _MODULE_OF, name)


def __dir__():
    return [*__all__, "__version__"]
