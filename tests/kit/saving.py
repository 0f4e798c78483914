"""Saving a kit object as text and reading it back, without pickle: what a device's snapshot may hold."""

import base64
import importlib
import json
import types
from collections import Counter, deque

import numpy as np


def saved(thing) -> str:
    """As JSON. An object that is met twice is written once.

    Raises:
        TypeError: not plain data.
    """
    return json.dumps(_write(thing, {}))


def restored(text: str):
    """What :func:`saved` was given."""
    return _read(json.loads(text), {})


def _write(thing, seen: dict):
    if thing is None or isinstance(thing, (bool, int, float, str)):
        return thing
    if id(thing) in seen:
        return {"same": seen[id(thing)][0]}
    number = len(seen)
    seen[id(thing)] = (number, thing)
    return {"number": number, **_content(thing, seen)}


def _content(thing, seen) -> dict:
    if isinstance(thing, (types.FunctionType, type)):
        if "<" in thing.__qualname__:
            raise TypeError(f"not a function of a module: {thing!r}")
        return {"name": f"{thing.__module__}:{thing.__qualname__}"}
    if type(thing) in (bytes, bytearray):
        return {"bytes": base64.b64encode(thing).decode(), "mutable": isinstance(thing, bytearray)}
    if isinstance(thing, np.ndarray):
        return {"array": base64.b64encode(thing.tobytes()).decode(), "type": thing.dtype.str, "shape": thing.shape}
    if isinstance(thing, (tuple, list, deque)):
        return {"items": [_write(item, seen) for item in thing], "kind": type(thing).__name__}
    if isinstance(thing, dict):
        pairs = [[_write(key, seen), _write(value, seen)] for key, value in thing.items()]
        return {"pairs": pairs, "counter": isinstance(thing, Counter)}
    if not type(thing).__module__.startswith(("firmware_protocols.", "tests.kit.")):
        raise TypeError(f"not plain data: {thing!r}")
    cls = f"{type(thing).__module__}:{type(thing).__qualname__}"
    return {"class": cls, "state": _write(thing.__getstate__(), seen)}


def _read(data, seen: dict):
    if not isinstance(data, dict):
        return data
    if "same" in data:
        return seen[data["same"]]
    number = data["number"]
    if "name" in data:
        seen[number] = _named(data["name"])
    elif "bytes" in data:
        seen[number] = (bytearray if data["mutable"] else bytes)(base64.b64decode(data["bytes"]))
    elif "array" in data:
        array = np.frombuffer(base64.b64decode(data["array"]), data["type"]).reshape(data["shape"])
        seen[number] = array.copy()
    elif "items" in data:
        kind = {"list": list, "deque": deque}.get(data["kind"], tuple)
        seen[number] = kind(_read(item, seen) for item in data["items"])
    elif "pairs" in data:
        seen[number] = Counter() if data["counter"] else {}
        for key, value in data["pairs"]:
            seen[number][_read(key, seen)] = _read(value, seen)
    else:
        _read_object(data, seen)
    return seen[number]


def _read_object(data, seen) -> None:
    cls = _named(data["class"])
    seen[data["number"]] = thing = cls.__new__(cls)
    state = _read(data["state"], seen)
    if hasattr(thing, "__setstate__"):
        thing.__setstate__(state)
    elif state is not None:
        thing.__dict__.update(state)


def _named(name: str):
    module, _, path = name.partition(":")
    thing = importlib.import_module(module)
    for part in path.split("."):
        thing = getattr(thing, part)
    return thing
