"""The keywords of the methods that a scene's user calls, in our words or in those of another simulator."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any, TypeVar

from tactemu.base.option_groups import OptionsClass, from_flat
from tactemu.base.words import hint, in_our_words

Method = TypeVar("Method", bound=Callable[..., Any])


def takes_words(method: Method) -> Method:
    """Return a method that also takes Genesis's words, where its object has ``names = "genesis"``.

    There it also takes a class of options with the options beside its own keywords, instead of an object. An unknown
    keyword is an error that names the valid one.
    """
    known = frozenset(inspect.signature(method).parameters)

    @functools.wraps(method)
    def call(self: Any, *args: Any, **given: Any) -> Any:
        is_genesis = self.names == "genesis"
        if known.issuperset(given) and not is_genesis:  # first, and cheap: poses are set at each step
            return method(self, *args, **given)
        if is_genesis:
            given = in_our_words(given, known)
            if args and isinstance(args[0], OptionsClass):
                options = {name: given.pop(name) for name in list(given) if name not in known}
                args = (from_flat(args[0], options, names="genesis"), *args[1:])
        for word in given:
            if word not in known:
                raise TypeError(f"{method.__qualname__} has no argument {word!r}{hint(word, known)}")
        return method(self, *args, **given)

    return call  # type: ignore[return-value]
