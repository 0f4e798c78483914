"""A device's whole state as plain data, and back: for saving, forking, and the check of restarts.

Plain data are numbers, text, bytes, arrays, and lists, tuples, dicts, sets and deques of them, and objects whose class
belongs to the kit or to the device's own module, as well as named functions of such a module. Any other function, a
generator, an open file or an object of another library is refused with the name of the attribute that holds it. An
object that two attributes share is still shared after a restore.
"""

from __future__ import annotations

import functools
import importlib
import sys
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from types import FunctionType
from typing import Any

import numpy as np

TRANSIENT_FIELDS = ("layout", "options")
"""The attributes that are not saved, since they follow from the options."""
_PLAIN = (type(None), bool, int, float, str, bytes)
_CONTAINERS: dict[type, str] = {list: "list", tuple: "tuple", set: "set", frozenset: "frozenset"}


class NotPlain(TypeError):
    """An attribute holds an object that cannot be saved."""


def snapshot(device: Any) -> dict[str, Any]:
    """Return the state of a device: nested dicts and lists of plain values and arrays, which share nothing with it.

    Raises:
        NotPlain: an attribute holds an object that cannot be saved; the message names the attribute.
    """
    writer = Writer(lambda module: _belongs(module, device), _known(device))
    state = {name: value for name, value in vars(device).items() if name not in TRANSIENT_FIELDS}
    return {name: writer.write(value, name) for name, value in state.items()}


def restore(device: Any, state: dict[str, Any]) -> None:
    """Set the state of a device, made with the same options, to a :func:`snapshot` from this or another process.

    Raises:
        ValueError: the state is not one of this device, which then stays as it is.
    """
    set_attributes(device, decode(device, state))


def decode(device: Any, state: dict[str, Any]) -> dict[str, Any]:
    """Return the attributes in a :func:`snapshot`, for :func:`set_attributes`.

    Raises:
        ValueError: the state is not one of this device.
    """
    reader = Reader(lambda module: _belongs(module, device), _known(device), _own_modules(device))
    return {name: reader.read(value) for name, value in state.items() if name not in TRANSIENT_FIELDS}


def set_attributes(device: Any, attributes: dict[str, Any]) -> None:
    """Replace the attributes of a device, all but those of :data:`TRANSIENT_FIELDS`."""
    kept = {name: value for name, value in vars(device).items() if name in TRANSIENT_FIELDS}
    vars(device).clear()
    vars(device).update(kept | attributes)


def _known(device: Any) -> dict[str, Any]:
    return {"self": device, "layout": getattr(device, "layout", None)}


def _belongs(module: str, device: Any) -> bool:
    return module.partition(".")[0] == "firmware_protocols" or module in _own_modules(device)


class Writer:
    """A writer of objects as plain data. It writes an object that several share once.

    Args:
        belongs: returns True for a module whose functions and objects of whose classes may be written.
        known: objects that the reader has, too, by the names that stand for them.
    """

    def __init__(self, belongs: Callable[[str], bool], known: Mapping[str, Any]):
        self.belongs = belongs
        self._known = {id(value): name for name, value in known.items()}
        self._seen: dict[int, int] = {}
        self._held: list[Any] = []
        """The objects written so far, kept alive so that no id is used twice."""

    def write(self, value: Any, where: str) -> Any:
        """Return a value as plain data.

        Raises:
            NotPlain: it holds an object that cannot be saved; the message names ``where``.
        """
        if type(value) in _PLAIN:
            return value
        if isinstance(value, np.generic):
            return {"~": "number", "value": np.array(value)}
        if id(value) in self._known:
            return {"~": "known", "as": self._known[id(value)]}
        if isinstance(value, FunctionType) and "<" not in value.__qualname__ and self.belongs(value.__module__):
            return {"~": "named", "as": f"{value.__module__}:{value.__qualname__}"}
        if id(value) in self._seen:
            return {"~": "same", "as": self._seen[id(value)]}
        number = self._seen[id(value)] = len(self._seen)
        self._held.append(value)
        return {"n": number, **self.compound(value, where)}

    def compound(self, value: Any, where: str) -> dict[str, Any]:
        """Return an array, container or object as plain data, without its number.

        Raises:
            NotPlain: it is of a type that cannot be saved.
        """
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
        if self.belongs(kind.__module__) and not callable(getattr(kind, "__next__", None)):
            name = f"{kind.__module__}:{kind.__qualname__}"
            if isinstance(value, tuple):  # a named one
                return {"~": "record", "class": name, "items": [self.write(v, f"{where}[]") for v in value]}
            if isinstance(value, bytes):
                return {"~": "marked", "class": name, "value": bytes(value)}
            state = {name: self.write(each, f"{where}.{name}") for name, each in attributes_of(value).items()}
            return {"~": "object", "class": name, "state": state}
        raise NotPlain(
            f"self.{where} is a {kind.__module__}.{kind.__qualname__}: a device's state is numbers, text, bytes, "
            "arrays, lists, dicts and objects of the kit, so that it can be saved"
        )


def attributes_of(value: Any) -> dict[str, Any]:
    """Return the attributes of an object, or those that its class chooses to save (``__getstate__``, as for pickle)."""
    if has_own_state(type(value)):
        return value.__getstate__()
    slots = [name for cls in type(value).__mro__ for name in getattr(cls, "__slots__", ())]
    names = [*(name for name in slots if hasattr(value, name)), *getattr(value, "__dict__", {})]
    return {name: getattr(value, name) for name in names}


def has_own_state(cls: type) -> bool:
    """Return True if a class defines ``__setstate__``, which rebuilds its objects from their ``__getstate__``."""
    return hasattr(cls, "__setstate__") and not is_dataclass(cls)  # Python gives it to frozen dataclasses with slots


def _factory(value: defaultdict, where: str) -> str:
    if value.default_factory not in (int, float, list, dict, bytearray):
        raise NotPlain(f"self.{where} is a defaultdict of {value.default_factory}: use int, float, list or dict")
    return value.default_factory.__name__


class Reader:
    """A reader of the plain data of a :class:`Writer`. It makes objects only of the classes that belong.

    Args:
        belongs, known: as the writer's.
        modules: modules that cannot be imported by name, by name.
    """

    def __init__(
        self, belongs: Callable[[str], bool], known: Mapping[str, Any], modules: Mapping[str, Any] | None = None
    ):
        self.belongs, self._known, self._modules = belongs, known, modules or {}
        self._made: dict[int, Any] = {}
        self._found: dict[tuple[str, type], Any] = {}

    def read(self, value: Any) -> Any:
        """Return the object that plain data stand for.

        Raises:
            ValueError: the data are not those of a writer.
        """
        try:
            return self._read(value)
        except (LookupError, TypeError, AttributeError, ImportError, RecursionError, OverflowError) as error:
            raise ValueError(f"not a state: {type(error).__name__} {error}") from None

    def _read(self, value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        kind = value["~"]
        if kind == "same":
            return self._made[value["as"]]
        if kind == "known":
            return self._known[value["as"]]
        if kind == "number":
            return value["value"][()]
        if kind == "named":
            return self._named(value["as"], FunctionType)
        return self.make(kind, value)

    def _read_all(self, values: Iterable[Any]) -> Iterator[Any]:
        """Return the objects that plain data stand for, without a call for each number and text."""
        read = self._read
        return (read(each) if isinstance(each, dict) else each for each in values)

    def make(self, kind: str, value: dict[str, Any]) -> Any:
        """Return the array, container or object that plain data stand for."""
        if kind == "object":
            return self._object(value)
        if kind in ("bytearray", "array"):
            made = bytearray(memoryview(value["value"])) if kind == "bytearray" else value["value"].copy()
            return self.keep(value, made)
        if kind in ("dict", "Counter", "defaultdict"):
            made = self.keep(value, _empty_dict(kind, value))
            made.update({self._read(k): self._read(v) for k, v in value["items"]})
            return made
        if kind in ("list", "deque", "set"):
            empty = [] if kind == "list" else set() if kind == "set" else deque(maxlen=value.get("maxlen"))
            made = self.keep(value, empty)
            (made.update if kind == "set" else made.extend)(self._read_all(value["items"]))
            return made
        if kind == "marked":
            return self.keep(value, self._class(value["class"], bytes)(value["value"]))
        items = self._read_all(value["items"])
        if kind == "record":
            return self.keep(value, self._class(value["class"], tuple)(*items))
        return self.keep(value, {"tuple": tuple, "frozenset": frozenset}[kind](items))

    def _object(self, value: dict[str, Any]) -> Any:
        cls = self._class(value["class"], object)
        made = self.keep(value, object.__new__(cls))
        read, store = self._read, object.__setattr__
        state = {name: read(each) if isinstance(each, dict) else each for name, each in value["state"].items()}
        sets_its_state, init_fields, checks_its_fields = _traits(cls)
        if sets_its_state:
            made.__setstate__(state)
            return made
        if not init_fields <= state.keys():
            missing = init_fields - state.keys()
            raise ValueError(f"a {value['class']} without {', '.join(sorted(missing))}")
        for name, each in state.items():
            store(made, name, each)
        if checks_its_fields:
            made.__post_init__()
        return made

    def _class(self, name: str, kind: type) -> Any:
        found = self._named(name, type)
        if not issubclass(found, kind):
            raise ValueError(f"{name} is not a {kind.__name__}")
        return found

    def _named(self, name: str, kind: type) -> Any:
        """Return a function or class by its name, if a module that belongs defines it and does not merely import it."""
        if (found := self._found.get((name, kind))) is not None:
            return found
        module, _, qualname = name.partition(":")
        if not self.belongs(module):
            raise ValueError(f"a state cannot hold {name}")
        found: Any = self._modules.get(module) or importlib.import_module(module)
        for part in qualname.split("."):
            found = getattr(found, part)
        if not isinstance(found, kind) or (found.__module__, found.__qualname__) != (module, qualname):
            raise ValueError(f"a state cannot hold {name}")
        self._found[name, kind] = found
        return found

    def keep(self, value: dict[str, Any], made: Any) -> Any:
        """Store an object by its number, for other places that share it, and return it."""
        self._made[value["n"]] = made
        return made


@functools.lru_cache(maxsize=512)
def _traits(cls: type) -> tuple[bool, frozenset[str], bool]:
    """Return if a class has its own ``__setstate__``, the fields that make an object, and if it checks its fields.

    A frozen dataclass checks its fields in ``__post_init__``; others may reset their state there. A class that is no
    dataclass has no fields.
    """
    if not is_dataclass(cls):
        return has_own_state(cls), frozenset(), False
    is_frozen = cls.__dataclass_params__.frozen  # pyright: ignore[reportAttributeAccessIssue]
    init_fields = frozenset(each.name for each in fields(cls) if each.init)
    return has_own_state(cls), init_fields, is_frozen and hasattr(cls, "__post_init__")


def _own_modules(device: Any) -> dict[str, Any]:
    """Return the modules of a device's classes, by name; a user's own file is not importable by its name."""
    modules = {cls.__module__ for cls in type(device).__mro__} - sys.stdlib_module_names
    return {module: sys.modules[module] for module in modules if module in sys.modules}


def _empty_dict(kind: str, value: dict[str, Any]) -> Any:
    if kind == "defaultdict":
        factories = {"int": int, "float": float, "list": list, "dict": dict, "bytearray": bytearray}
        return defaultdict(factories[value["factory"]])
    return {} if kind == "dict" else Counter()
