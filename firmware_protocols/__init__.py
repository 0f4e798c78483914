"""Firmware models of real tactile sensors: the bytes on their wires, without simulation, ports or clocks.

>>> import firmware_protocols as fp
>>> device = fp.create("anyskin")
>>> counts = device.measure(fp.Reading({"force": ...}), t_ns=0)
>>> device.stream(0, "")      # -> frames

The names in ``__all__`` are all that a device of your own imports (``docs/adding-a-device.md``); the modules that
define them may change in every version. Names are imported on first use, so that asking for the names of devices does
not wait for numpy; ``__init__.pyi`` lists them for editors.
"""

from __future__ import annotations

import importlib

_PUBLIC = {
    # module: its public names
    "adc": ("LowPass", "int16", "pack_12_bits", "quantize"),
    "can_frames": ("CanFrames",),
    "commands": ("Command",),
    "connectors": ("USB", "Can", "Connector", "Dds", "Rs485", "Serial", "Tcp", "Topic", "Udp", "WebSocket"),
    "device": (
        "Axis", "Column", "Convert", "Counts", "Device", "Quantity", "Reading", "Restart", "Rollover", "Sense",
        "Sent", "Stream", "Transmissions",
    ),
    "facts": ("Fact", "assumed", "fact_table", "measured", "stated"),
    "frames": ("CanFrame", "WireFrame", "with_payload"),
    "framing": ("MORE", "NO_PACKET", "SOUND", "Broken", "Cobs", "Lines", "Packets", "Ppp", "cobs", "ppp"),
    "layouts": ("Layout", "Patch", "filled", "grid_layout", "place", "points", "stack"),
    "magnetic": ("LinearMagnet",),
    "motors": ("Motors", "Setpoints"),
    "options": ("Option",),
    "protocols": ("Answer",),
    "registers": ("Memory", "Refused", "RegisterMap", "Registers"),
    "registry": ("DEVICES", "create", "device_class", "names"),
    "table_lines": ("Identifier", "TableError"),
    "tables": ("Frame",),
}  # fmt: skip
_MODULE_OF = {name: f"firmware_protocols.{module}" for module, names in _PUBLIC.items() for name in names}
_MODULES = {
    # public modules, each with an `__all__` of its own
    "idl": "firmware_protocols.idl",
    "sums": "firmware_protocols.sums",
    **{name: f"firmware_protocols.protocols.{name}" for name in ("dynamixel", "eb90", "feetech", "http", "modbus")},
}

__all__ = list(_MODULE_OF | _MODULES)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str):
    if name in _MODULES:
        found = importlib.import_module(_MODULES[name])
    elif name in _MODULE_OF:
        found = getattr(importlib.import_module(_MODULE_OF[name]), name)
    else:
        raise AttributeError(f"module 'firmware_protocols' has no attribute {name!r}")
    globals()[name] = found
    return found


def __dir__():
    return __all__
