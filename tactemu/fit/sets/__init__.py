"""Sets of real recordings, one file each: their reader, the law of their sensor, and what it predicts.

A module has ``AIMS`` and ``CONSTANTS``, ``read(folder)`` and ``fit(recordings)``; for its laws ``points(key,
recording)``, the quantities of a recording that the law of an aim predicts, and ``predict(parameters, key,
recording)``; for its constants ``constants(recordings)``. ``unit(name)`` names what repeats of one condition share.
:mod:`tactemu.fit.realism` calls them. The docstring names the parts of a predicted recording that a law may use.
"""

from __future__ import annotations

import importlib
from types import ModuleType

SETS: dict[str, str] = {
    # folder of the recordings: module
    "eflesh": "tactemu.fit.sets.eflesh",
    "weiss_sdh2": "tactemu.fit.sets.weiss",
    "cpm_finger": "tactemu.fit.sets.cpm_finger",
    "anyskin_leap": "tactemu.fit.sets.anyskin",
    "icub_hand_2012": "tactemu.fit.sets.icub_hand",
    "fluid_channel": "tactemu.fit.sets.fluid",
}


def set_module(name: str) -> ModuleType:
    """Return the module of a set, by its folder's name."""
    return importlib.import_module(SETS[name])
