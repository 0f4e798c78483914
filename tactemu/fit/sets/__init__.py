"""Sets of real recordings, one file each: their reader, the law of their sensor, and the errors of its predictions.

A module has ``AIMS``, ``read(folder)``, ``fit(recordings)``, ``errors(parameters, recordings)`` and
``folds(recordings)``, which :mod:`tactemu.fit.realism` calls. Errors are those of predictions, in the unit of the aim;
the docstring names the parts of a predicted recording that a law may use.
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
    "rh56_middle_finger": "tactemu.fit.sets.rh56",
    "fluid_channel": "tactemu.fit.sets.fluid",
}


def set_module(name: str) -> ModuleType:
    """Return the module of a set, by its folder's name."""
    return importlib.import_module(SETS[name])
