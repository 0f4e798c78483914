"""Documented commands, each with a worked example and its origin: on the method that answers it, or in a table."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from firmware_protocols.frames import WireFrame, frame_of, matches

F = TypeVar("F", bound=Callable)
Reply = WireFrame | str | Sequence[WireFrame | str] | Callable[[list[Any]], bool] | None


@dataclass(frozen=True, kw_only=True, slots=True)
class Command:
    """One documented command: a driver's request and the firmware's answer. `tactemu check` sends each.

    Frames are written as text (hex for bytes, candump notation for CAN) and are literal: bytes from the code under
    test would only agree with themselves. In an answer ``..`` is any byte, ``..{12}`` twelve of them, ``*`` any
    number of them.
    """

    name: str
    request: WireFrame | str | Sequence[str]
    """The request; several texts for one in stages, whose driver waits for an answer before it sends the next."""
    reply: Reply = None
    """The answer, or several in order; ``None``: documented silence; a predicate where no pattern can describe it."""
    about: str = ""
    after: Sequence[WireFrame | str] = ()
    """Requests to send first (select a port, unlock ...)."""
    port: str = ""
    """The port that it is sent to; default: the device's first port."""
    origin: str = ""
    """The source of the example: a manual's page, a capture, the driver that sends it."""
    safe: bool = False
    """True if the request and those in ``after`` only read: they write nothing that lasts, reset, zero or move nothing,
    and change neither rate nor mode. `tactemu compare` sends only such requests, unless you add ``--ask-all``."""
    within_ms: float | None = None
    """The time after which its driver gives up, from the request's first bit to the answer's last."""

    @property
    def stages(self) -> list[WireFrame]:
        """The frames of the request, one unless it has stages."""
        return list(map(frame_of, self.written))

    @property
    def written(self) -> Sequence[WireFrame | str]:
        """The texts of the request, one unless it has stages."""
        return (self.request,) if isinstance(self.request, str | WireFrame) else self.request

    @property
    def frame(self) -> WireFrame:
        """The request as a frame; stages joined."""
        stages = self.stages
        return stages[0] if len(stages) == 1 else b"".join(each for each in stages if isinstance(each, bytes))

    def agrees(self, frames: Sequence[Any]) -> bool:
        """Return True if these frames are the documented answer."""
        if callable(self.reply):
            return bool(self.reply(list(frames)))
        wanted: list[Any] = [] if self.reply is None else [self.reply]
        if isinstance(self.reply, list | tuple):
            wanted = list(self.reply)
        return len(frames) == len(wanted) and all(map(matches, wanted, frames))


# -- commands on the methods that answer them --------------------------------------------------------------------------


@dataclass(frozen=True)
class Handled:
    """The documented commands of a method, and the requests that it answers."""

    commands: tuple[Command, ...]
    on: tuple[Any, ...] = ()
    """The keys of its requests, where they do not follow from the examples."""
    data: str | None = None
    """The format of the data for :mod:`struct`, ``*`` behind it if more may follow; ``None``: as in the examples."""
    pattern: re.Pattern[bytes] | None = None
    """The pattern of its lines; ``None``: the lines in the examples."""


def command(
    request: WireFrame | str | Sequence[str] = "",
    reply: Reply = None,
    *,
    name: str = "",
    on: Any = None,
    data: str | None = None,
    pattern: bytes | None = None,
    **more: Any,
) -> Callable[[F], F]:
    """Return a decorator that declares a documented command on the method that answers it, once for each example.

    Args:
        request, reply: the example, as in :class:`Command`; without a request the method only answers.
        name: its name; default: the method's.
        on: the key of the requests that the method answers, or several in a range or tuple; by default it follows from
            the example.
        data: the format of the request's data for :mod:`struct`, whose numbers are ``request.values``; ``*`` behind
            it: more may follow. By default the lengths in the examples.
        pattern: the pattern of lines that the method answers, whose groups are ``request.values``.
        more: further fields of :class:`Command`.
    """

    def declare(method: F) -> F:
        before: Handled = getattr(method, "handled", Handled(()))
        title = name or method.__name__.strip("_").replace("_", " ")
        example = (Command(name=title, request=request, reply=reply, **more),) if request else ()
        method.handled = replace(  # type: ignore[attr-defined]
            before,
            commands=example + before.commands,
            on=_keys(on) + before.on,
            data=before.data if data is None else data,
            pattern=before.pattern if pattern is None else re.compile(pattern, re.DOTALL),
        )
        return method

    return declare


def _keys(on: Any) -> tuple[Any, ...]:
    """Return the keys in ``on``: none, one or several."""
    return tuple(on) if isinstance(on, range | tuple | list) else () if on is None else (on,)


def handled_in(cls: type) -> dict[str, Handled]:
    """Return what the methods of a class answer, by name of the method, those of base classes first."""
    names = dict.fromkeys(name for base in reversed(cls.__mro__) for name in vars(base))
    found = {name: getattr(getattr(cls, name, None), "handled", None) for name in names}
    return {name: each for name, each in found.items() if isinstance(each, Handled)}


# -- commands in a table -----------------------------------------------------------------------------------------------


def command_table(text: str, *, head: str = "", tail: str = "", **more: Any) -> tuple[Command, ...]:
    """Return the commands in a table: a line each, in columns two spaces apart, or more.

        name          request       reply              about
        ? version     9A 00 E3 00   9A 00 E3 05 *
        stop          58 01 00      -                  no answer
        unit 2        06 00 02      =                  the request comes back
        identity      'V\\n'         'V1.0\\n', '..'

    A line that is indented more than the first continues the one above. Text in quotes is ASCII. A reply is ``-`` or
    missing for silence, ``=`` for the request itself; several replies have commas between them. Of several requests
    with semicolons between them the last is the command, after the others; ``tcp: 00`` goes to the port ``tcp``. A name
    after ``? `` is of a safe command, which only reads. A line ``@ origin`` gives the origin of those below it.

    Args:
        text: the table, without headings.
        head, tail: bytes around every request and reply in hex.
        more: further fields of :class:`Command` (``origin``, ``port``, ``after``).

    Raises:
        ValueError: a line has no request.
    """
    lines = [line for line in text.splitlines() if line.strip()]
    indent = min((len(line) - len(line.lstrip()) for line in lines), default=0)
    rows: list[str] = []
    for line in lines:
        if line[indent] == " " and rows:
            rows[-1] += (" " if rows[-1].endswith(",") else "  ") + line.strip()
        else:
            rows.append(line.strip())
    found = []
    for row in rows:
        if row.startswith("@ "):
            more = {**more, "origin": row[2:]}
        else:
            found.append(_command(row, head, tail, more))
    return tuple(found)


def _command(row: str, head: str, tail: str, more: dict[str, Any]) -> Command:
    name, *cells = re.split(r"\s{2,}", row)
    if not cells:
        raise ValueError(f"command {row!r}: expected `name  request  reply  about`, in columns two spaces apart")
    more = {**more, "safe": name.startswith("? "), "name": name.removeprefix("? ")}
    request, reply, about = [*cells, "", ""][:3]
    port, text = re.findall(r"^(?:(\w+): )?(.*)$", request)[0]
    *after, request = re.split("; ", text)
    more = {
        **more,
        **({"port": port} if port else {}),
        **({"after": tuple(_framed(each, head, tail) for each in after)} if after else {}),
    }
    wanted = [] if reply in ("", "-") else [request] if reply == "=" else re.split(", ", reply)
    framed = [_framed(each, head, tail) for each in wanted]
    answer = framed[0] if len(framed) == 1 else framed or None
    return Command(request=_framed(request, head, tail), reply=answer, about=about, **more)


def _framed(cell: str, head: str, tail: str) -> str:
    """Return a cell in hex, between head and tail; text in quotes without them."""
    if cell[:1] in "'\"" and cell[:1]:
        return ast.literal_eval(f"b{cell}").hex(" ").upper()
    return f"{head} {cell} {tail}".strip() if head or tail else cell
