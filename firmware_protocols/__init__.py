"""Firmware models of real tactile sensors: the bytes on their wires, without simulation, ports or clocks.

>>> import firmware_protocols as fp
>>> device = fp.create("anyskin")
>>> counts = device.measure(fp.Reading({"force": ...}), t_ns=0)
>>> device.stream(0, "")      # -> frames

The names in ``__all__`` are all that a device of your own imports (``docs/adding-a-device.md``); the modules that
define them may change in every version. ``__init__.pyi`` lists them; they are imported on first use, so that asking
for the names of devices does not wait for numpy.
"""

from __future__ import annotations

from firmware_protocols.public_names import import_public, public_names

_MODULE_OF = public_names(__file__)

__all__ = list(_MODULE_OF)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str):
    found = globals()[name] = import_public(__name__, _MODULE_OF, name)
    return found


def __dir__():
    return __all__
