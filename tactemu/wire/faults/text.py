"""The text form of a fault.

::

    KIND [N% | every N | frame N,N-N,...] [id=0x201] [prefix=55aa] [to_driver | from_driver | both]
         [at T [for T] | from T] [to T] [the fault's own options]

``N%`` is the probability per frame (for ``load`` and ``babble`` the share of the bus), ``every N`` hits each N-th frame
that the target matches, ``frame 37,40-42`` these and no other; without any of the three, all are hit. Frames are
counted from 1 since the fault was switched on, as far as the target matches them and a driver has the port open. Times
are emulation times: ``3s``, ``16ms``, ``200us``. A fault of frames with ``at T`` and no ``for`` hits the first frame
from then on. The default direction is ``to_driver``.
"""

from __future__ import annotations

from typing import Any

from tactemu.base.errors import SceneError, nearest, shown
from tactemu.wire.faults.fault import Fault, LinkFault
from tactemu.wire.faults.options import DIRECTIONS, SHARE, Option
from tactemu.wire.faults.registry import FAULTS


def parse(text: str) -> Fault:
    """Return the fault that ``text`` describes.

    Raises:
        SceneError: names the word that is wrong and those that are expected.
    """
    word, *following = text.split() or [""]
    if not word:
        raise SceneError("an empty fault; `tactemu faults` lists them")
    if (fault := FAULTS.get(word)) is None:
        hint = nearest(word, FAULTS) or "; `tactemu faults` lists them"
        raise SceneError(f"fault {shown(text)}: unknown kind {shown(word)}{hint}")
    values: dict[str, Any] = {}
    start = ""
    while following:
        word = following.pop(0)
        try:
            name, value = _option(fault, "from" if word == "at" else word, following)
            if name in values:
                both = name == "start_ns" and word != start
                raise ValueError("give 'at' or 'from', not both" if both else "given twice")
        except ValueError as why:
            raise SceneError(f"fault {text!r}: {word!r}: {why}") from None
        start = word if name == "start_ns" else start
        values[name] = value
    once = start == "at" and "lasts_ns" not in values and not issubclass(fault, LinkFault)
    return fault(text=text, once=once, **values)


def _option(fault: type[Fault], word: str, following: list[str]) -> tuple[str, Any]:
    """Return the field and the value that a word gives, and take the value off the words that follow.

    Raises:
        ValueError: says why the fault has no such word, or what value is expected.
    """
    for name, option in reversed(fault.options().items()):
        if (value := option.value_of(word, following)) is not None:
            return name, option.read(value)
    takers = [other for other in FAULTS.values() if any(_is_begun(each, word) for each in other.options().values())]
    targets = (each.is_target for other in takers for each in other.options().values() if _is_begun(each, word))
    if any(targets) and issubclass(fault, LinkFault):
        raise ValueError(f"{fault.word} is a fault of the link: give it a time only")
    if takers:
        raise ValueError(f"{fault.word} has no such option; these have: {', '.join(each.word for each in takers)}")
    words = ["at", *(each.word for each in fault.options().values())]
    if SHARE.word in words and SHARE.value_of(f"{word}%", []):
        raise ValueError(f"a share needs its unit; did you mean '{word}%'?")
    raise ValueError(f"unknown word{nearest(word, [*words, *DIRECTIONS])}; expected {', '.join(words)}")


def _is_begun(option: Option, word: str) -> bool:
    """Return True if a word begins an option; a value alone tells no fault from others, unless it is a target."""
    if word == option.word:
        return True
    return (option.is_target or not option.alone) and option.value_of(word, ["0"]) is not None
