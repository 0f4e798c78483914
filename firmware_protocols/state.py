"""A device's whole state as plain data, and back: for saving, forking, and the check that nothing else is kept.

Plain data are numbers, text, bytes, arrays, and lists, tuples, dicts, sets and deques of them, and objects whose class
belongs to the kit or to the device's own module, as are functions that such a module names. Any other function, a
generator, an open file or an object of another library is refused with the name of the attribute that holds it. What
two attributes share is still shared after a restore.
"""

from __future__ import annotations

import importlib
import io
import json
import sys
from collections import Counter, defaultdict, deque
from collections.abc import Mapping
from types import FunctionType
from typing import Any

import numpy as np

_NOT_STATE = ("layout", "options")
"""Made anew, and equal, from the options."""
_PLAIN = (type(None), bool, int, float, str, bytes)
_CONTAINERS: dict[type, str] = {list: "list", tuple: "tuple", set: "set", frozenset: "frozenset"}


class NotPlain(TypeError):
    """An attribute holds what cannot be saved."""


def save(device: Any) -> dict[str, Any]:
    """The state of a device: nested dicts and lists of plain values and arrays, which share nothing with it.

    Raises:
        NotPlain: an attribute holds what cannot be saved; names it.
    """
    writer = _Writer(device)
    state = {name: value for name, value in vars(device).items() if name not in _NOT_STATE}
    return {name: writer.write(value, name) for name, value in state.items()}


def load(device: Any, state: dict[str, Any]) -> None:
    """Give a device, made with the same options, a state that :func:`save` returned, of this or another process.

    Raises:
        ValueError: the state is not one of this device.
    """
    reader = _Reader(device)
    values = {name: reader.read(value) for name, value in state.items()}
    kept = {name: value for name, value in vars(device).items() if name in _NOT_STATE}
    vars(device).clear()
    vars(device).update(kept | values)


def to_bytes(state: dict[str, Any]) -> bytes:
    """What :func:`save` returned as the bytes of an ``.npz`` file: the arrays, and the rest as JSON."""
    arrays: dict[str, np.ndarray] = {}
    text = json.dumps(_without_arrays(state, arrays))
    file = io.BytesIO()
    np.savez(file, tree=np.frombuffer(text.encode(), np.uint8), **arrays)  # type: ignore[arg-type]
    return file.getvalue()


def from_bytes(data: bytes) -> dict[str, Any]:
    """What :func:`to_bytes` wrote.

    Raises:
        ValueError: it is no such file.
    """
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        return _with_arrays(json.loads(file["tree"].tobytes()), file)


def _without_arrays(value: Any, arrays: dict[str, np.ndarray]) -> Any:
    if isinstance(value, np.ndarray):
        arrays[name := f"a{len(arrays)}"] = value
        return {"array": name}
    if isinstance(value, bytes):
        return {"bytes": value.hex()}
    if isinstance(value, list):
        return [_without_arrays(each, arrays) for each in value]
    if isinstance(value, dict):
        return {"dict": [[key, _without_arrays(each, arrays)] for key, each in value.items()]}
    return value


def _with_arrays(value: Any, arrays: Mapping[str, np.ndarray]) -> Any:
    if isinstance(value, list):
        return [_with_arrays(each, arrays) for each in value]
    if not isinstance(value, dict):
        return value
    ((kind, held),) = value.items()
    if kind == "array":
        return arrays[held]
    return bytes.fromhex(held) if kind == "bytes" else {key: _with_arrays(each, arrays) for key, each in held}


def _belongs(module: str, device: Any) -> bool:
    return module.partition(".")[0] == "firmware_protocols" or module in _own_modules(device)


class _Writer:
    def __init__(self, device: Any):
        self.device = device
        self.seen: dict[int, int] = {}
        self.held: list[Any] = []
        """Keeps what was seen alive, so that no id is used twice."""

    def write(self, value: Any, where: str) -> Any:
        if type(value) in _PLAIN:
            return value
        if isinstance(value, np.generic):
            return {"~": "number", "value": np.array(value)}
        if value is self.device:
            return {"~": "self"}
        if value is getattr(self.device, "layout", None):
            return {"~": "layout"}
        if (
            isinstance(value, FunctionType)
            and "<" not in value.__qualname__
            and _belongs(value.__module__, self.device)
        ):
            return {"~": "named", "as": f"{value.__module__}:{value.__qualname__}"}
        if id(value) in self.seen:
            return {"~": "same", "as": self.seen[id(value)]}
        number = self.seen[id(value)] = len(self.seen)
        self.held.append(value)
        return {"n": number, **self._compound(value, where)}

    def _compound(self, value: Any, where: str) -> dict[str, Any]:
        kind = type(value)
        if kind is bytearray:
            return {"~": "bytearray", "value": bytes(value)}
        if kind is np.ndarray and value.dtype != object:
            return {"~": "array", "value": value.copy()}
        if kind in _CONTAINERS:
            return {"~": _CONTAINERS[kind], "items": [self.write(v, f"{where}[{k}]") for k, v in enumerate(value)]}
        if kind is deque:
            return {"~": "deque", "maxlen": value.maxlen, "items": [self.write(v, f"{where}[]") for v in value]}
        if kind in (dict, Counter, defaultdict):
            pairs = [[self.write(k, f"{where} key"), self.write(v, f"{where}[{k!r}]")] for k, v in value.items()]
            more = {"factory": _factory(value, where)} if kind is defaultdict else {}
            return {"~": kind.__name__, "items": pairs, **more}
        if _belongs(kind.__module__, self.device) and not callable(getattr(kind, "__next__", None)):
            state = {name: self.write(each, f"{where}.{name}") for name, each in _attributes(value).items()}
            return {"~": "object", "class": f"{kind.__module__}:{kind.__qualname__}", "state": state}
        raise NotPlain(
            f"self.{where} is a {kind.__module__}.{kind.__qualname__}: a device's state is numbers, text, bytes, "
            "arrays, lists, dicts and objects of the kit, so that it can be saved"
        )


def _attributes(value: Any) -> dict[str, Any]:
    """What an object is made of; its class may say what suffices to make it again (``__getstate__``, as for pickle)."""
    if hasattr(value, "__setstate__"):
        return value.__getstate__()
    slots = [name for cls in type(value).__mro__ for name in getattr(cls, "__slots__", ())]
    names = [*(name for name in slots if hasattr(value, name)), *getattr(value, "__dict__", {})]
    return {name: getattr(value, name) for name in names}


def _factory(value: defaultdict, where: str) -> str:
    if value.default_factory not in (int, float, list, dict, bytearray):
        raise NotPlain(f"self.{where} is a defaultdict of {value.default_factory}: use int, float, list or dict")
    return value.default_factory.__name__


class _Reader:
    def __init__(self, device: Any):
        self.device = device
        self.made: dict[int, Any] = {}

    def read(self, value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        kind = value["~"]
        if kind == "same":
            return self.made[value["as"]]
        if kind in ("self", "layout"):
            return self.device if kind == "self" else self.device.layout
        if kind == "number":
            return value["value"][()]
        if kind == "named":
            return self._named(value["as"])
        made = self._make(kind, value)
        return made

    def _make(self, kind: str, value: dict[str, Any]) -> Any:
        if kind in ("bytearray", "array"):
            made = bytearray(value["value"]) if kind == "bytearray" else value["value"].copy()
            return self._keep(value, made)
        if kind == "object":
            return self._object(value)
        if kind in ("dict", "Counter", "defaultdict"):
            made = self._keep(value, _empty_dict(kind, value))
            made.update((self.read(k), self.read(v)) for k, v in value["items"])
            return made
        if kind in ("list", "deque", "set"):
            empty = {"list": [], "deque": deque(maxlen=value.get("maxlen")), "set": set()}[kind]
            made = self._keep(value, empty)
            for item in value["items"]:
                (made.add if isinstance(made, set) else made.append)(self.read(item))
            return made
        items = [self.read(item) for item in value["items"]]
        return self._keep(value, tuple(items) if kind == "tuple" else frozenset(items))

    def _object(self, value: dict[str, Any]) -> Any:
        made = self._keep(value, object.__new__(self._named(value["class"])))
        state = {name: self.read(each) for name, each in value["state"].items()}
        if hasattr(made, "__setstate__"):
            made.__setstate__(state)
        else:
            for name, each in state.items():
                object.__setattr__(made, name, each)
        return made

    def _named(self, name: str) -> Any:
        module, _, qualname = name.partition(":")
        if not _belongs(module, self.device):
            raise ValueError(f"a state of {type(self.device).__name__} holds no {name}")
        found: Any = _own_modules(self.device).get(module) or importlib.import_module(module)
        for part in qualname.split("."):
            found = getattr(found, part)
        return found

    def _keep(self, value: dict[str, Any], made: Any) -> Any:
        self.made[value["n"]] = made
        return made


def _own_modules(device: Any) -> dict[str, Any]:
    """The modules of a device's classes, by name; a file of the user's own is under a name of its own."""
    modules = {cls.__module__ for cls in type(device).__mro__} - sys.stdlib_module_names
    return {module: sys.modules[module] for module in modules if module in sys.modules}


def _empty_dict(kind: str, value: dict[str, Any]) -> Any:
    if kind == "defaultdict":
        factories = {"int": int, "float": float, "list": list, "dict": dict, "bytearray": bytearray}
        return defaultdict(factories[value["factory"]])
    return {} if kind == "dict" else Counter()
