"""``tactemu check``: what the contract's judge finds in a device, for its author."""

from __future__ import annotations

import json as json_module
from collections.abc import Sequence

from firmware_protocols.check import FUZZ, Report, check
from firmware_protocols.options import from_words
from tactemu.base.errors import DeviceError


def check_device(target: str, words: Sequence[str], *, fuzz: int = FUZZ, json: bool = False) -> Report:
    """Check a device and print the report.

    Raises:
        DeviceError: no such device, or an option that it does not take.
    """
    try:
        report = check(target, from_words(words), fuzz=fuzz)
    except (LookupError, ValueError) as error:
        raise DeviceError(str(error)) from None
    print(json_module.dumps(report.as_dict()) if json else "\n".join(report.lines()))
    return report
