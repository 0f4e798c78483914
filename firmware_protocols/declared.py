"""Tables that the files of a device declare, and whether anything in them is a checksum."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from types import FunctionType
from typing import Any

from firmware_protocols.device import Device
from firmware_protocols.sums import SUMS
from firmware_protocols.tables import Frame


def frames_of(device: Device | type[Device]) -> list[Frame]:
    """Return the frame tables of a device: those bound in an instance, then those of its class."""
    if isinstance(device, type):
        return tables_of(device, Frame)
    return [*(each for each in vars(device).values() if isinstance(each, Frame)), *tables_of(type(device), Frame)]


def tables_of(cls: type[Device], kind: type | tuple[type, ...]) -> list[Any]:
    """Return the tables of a type: those that the class lists, else those in its modules and classes, also in dicts and
    lists."""
    if listed := [each for each in cls.tables if isinstance(each, kind)]:
        return listed
    own = [each for each in cls.__mro__ if issubclass(each, Device) and each is not Device]
    places = [*(vars(sys.modules[each.__module__]) for each in own), *(vars(each) for each in own)]
    found: dict[int, Any] = {}
    for value in (each for place in places for each in list(place.values())):
        inner = value.values() if isinstance(value, Mapping) else value if isinstance(value, list | tuple) else [value]
        found |= {id(each): each for each in inner if isinstance(each, kind)}
    return list(found.values())


def has_checksum(device: Device) -> bool:
    """Return True if a frame table of the device has a sum, its protocol has one, or its file uses one of the kit's.

    CAN, UDP and TCP have a check of their own, which this leaves out.
    """
    return (
        any(field.kind == "sum" for frame in frames_of(device) for field in frame.fields)
        or any(getattr(each, "has_checksum", False) for each in vars(device).values())
        or any(each in _SUM_FUNCTIONS for each in tables_of(type(device), FunctionType))
    )


_SUM_FUNCTIONS = {each.function for each in SUMS.values()}
