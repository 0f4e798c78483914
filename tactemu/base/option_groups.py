"""The groups in which a sensor model takes the options that all models have, and their flat form.

In Python a group is an object, ``electronics=ElectronicsOptions(noise=0.002)``. Scene files, `tactemu tune` and the
benches give all options of a model side by side, ``{"noise": 0.002, "normal_stiffness": 400.0}``; :func:`from_flat`
alone turns these into a model.
"""

from __future__ import annotations

import dataclasses
import inspect
from abc import ABCMeta
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, ClassVar, Self, TypeVar

from tactemu.base.errors import SceneError
from tactemu.base.options import check_declared
from tactemu.base.words import GENESIS, Names, hint, in_our_words

Model = TypeVar("Model")


class OptionsClass(ABCMeta):
    """The type of such a dataclass; ``help()`` shows its options, and the contract of an abstract base there alone."""

    def __dir__(cls) -> Iterable[str]:
        options = {each.name for each in _fields(cls)}
        hidden = set(getattr(cls, "__dataclass_fields__", ()))  # options, and ClassVars that describe the class
        for base in filter(inspect.isabstract, cls.__mro__[1:]):
            hidden |= vars(base).keys()
        return [name for name in super().__dir__() if name in options or (name not in hidden and name[0] != "_")]

    @property
    def __signature__(cls) -> inspect.Signature:
        """The signature with the fields of the class first, then its groups."""
        whole = inspect.signature(cls.__init__)
        given = list(whole.parameters.values())[1:]
        return whole.replace(parameters=sorted(given, key=lambda each: isinstance(each.default, OptionGroup)))


class Options(metaclass=OptionsClass):
    """A base of dataclasses of options: an unknown keyword is an error that names the valid one, and so is a value that
    is not of the option's declared type."""

    other_words: ClassVar[Mapping[str, str]] = {}
    """Words that other simulators have for its options, each with what to give here; messages say so."""

    def __new__(cls, *args: Any, **given: Any) -> Self:
        """Return a new object, once all keywords are known.

        Raises:
            TypeError: a keyword is unknown.
        """
        known = {each.name for each in _fields(cls)}
        for name in given:
            if name not in known:
                raise TypeError(f"{cls.__name__} has no option {name!r}{_hint(cls, name)}")
        return super().__new__(cls)

    def __post_init__(self) -> None:
        check_declared(type(self).__name__, self)


class OptionGroup(Options):
    """A base of the groups; they are written with the options that differ from the defaults only."""

    def __repr__(self) -> str:
        values = ((each, getattr(self, each.name)) for each in dataclasses.fields(self))  # type: ignore[arg-type]
        changed = ", ".join(f"{each.name}={value!r}" for each, value in values if value is not each.default)
        return f"{type(self).__name__}({changed})"


def groups(model: type | Any) -> dict[str, OptionGroup]:
    """Return the groups of a model's class by their fields, each with its defaults."""
    return {each.name: each.default for each in _fields(model) if isinstance(each.default, OptionGroup)}


def defaults(model: type | Any) -> dict[str, Any]:
    """Return all options of a model's class with their defaults, flat: its own first, then those of its groups.

    Raises:
        SceneError: the class has an option of a group's name.
    """
    grouped = groups(model)
    found = {each.name: each.default for each in _fields(model) if each.name not in grouped}
    for group, default in grouped.items():
        for each in _fields(default):
            if each.name in found:
                raise SceneError(f"{model.__name__}: its option {each.name!r} is one of {group}; choose another name")
            found[each.name] = getattr(default, each.name)
    return found


def from_flat(model: type[Model], given: Mapping[str, Any], called: str = "", names: Names = "tactemu") -> Model:
    """Return a model, given its class and its options side by side.

    Args:
        model: the class.
        given: options of the model and of its groups.
        called: the name of the model for messages, if not that of the class.
        names: ``genesis`` takes Genesis's words, too.

    Raises:
        SceneError: the model has no such option; the message names the nearest, and lists the model's own.
    """
    known = defaults(model)
    if names == "genesis":
        given = in_our_words(given, known)
    for name in given:
        if name not in known:
            listed = ", ".join(each.name for each in _fields(model) if not isinstance(each.default, OptionGroup))
            raise SceneError(
                f"{called or model.__name__} has no {name!r}{hint(name, known)} (options: {listed}; and those of every "
                "model: docs/sensors.md)"
            )
    own, grouped = dict(given), groups(model)
    for group, default in grouped.items():
        within = {each.name: own.pop(each.name) for each in _fields(default) if each.name in own}
        if within:
            own[group] = dataclasses.replace(default, **within)  # type: ignore[type-var]
    return model(**own)


def to_flat(model: Any) -> dict[str, Any]:
    """Return the options of a model side by side, its own first."""
    values = {each.name: getattr(model, each.name) for each in _fields(model)}
    inside = {name: to_flat(values.pop(name)) for name in groups(type(model))}
    return values | {name: value for group in inside.values() for name, value in group.items()}


def _fields(options: Any) -> Iterator[dataclasses.Field]:
    return (
        (each for each in dataclasses.fields(options) if each.init) if dataclasses.is_dataclass(options) else iter(())
    )


def _hint(cls: type[Options], name: str) -> str:
    """Return the end of the message of an unknown keyword: the group that it belongs to, or the nearest keyword."""
    known = defaults(cls)
    ours = GENESIS.get(name, name)
    if name in cls.other_words:
        return f"; give {cls.other_words[name]}"
    told = "" if name in known else hint(name, known)
    for group, default in groups(cls).items():
        if ours in {each.name for each in _fields(default)}:
            return f"{told}; it is one of {group}: {group}={type(default).__name__}({ours}=...)"
    return told
