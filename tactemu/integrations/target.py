"""The target after ``tactemu://`` or in a channel's name: a device or scene, and options of :func:`tactemu.serve`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from urllib.parse import parse_qs, unquote

from tactemu.base.errors import SceneError, no_such
from tactemu.session.serving import Served, serve

_SCHEME = "tactemu://"


def _yes_or_no(text: str) -> bool:
    return {"yes": True, "no": False}[text]


_OPTIONS: dict[str, Callable[[str], Any]] = {
    "rate_hz": float, "seed": int, "truth": str, "device": str, "by_hand": _yes_or_no,
}  # fmt: skip


def device_for(target: str, port: str | None = None) -> Served:
    """Return the device of a target, not yet started: ``anyskin``, ``hand.toml?rate_hz=200&seed=7&fault=drop 1%``.

    Write a percent sign before two hexadecimal digits as ``%25``, as in any URL.

    Raises:
        SceneError: an unknown option, or a wrong value.
    """
    name, _, query = target.removeprefix(_SCHEME).partition("?")
    options: dict[str, Any] = {"by_hand": False}
    for key, values in parse_qs(query, keep_blank_values=True).items():
        if key == "fault":
            options["faults"] = values
        elif key not in _OPTIONS:
            raise SceneError(f"{target}: {no_such('option', key, ['fault', *_OPTIONS])}")
        else:
            try:
                options[key] = _OPTIONS[key](values[-1])
            except (ValueError, KeyError):
                raise SceneError(f"{target}: {key}: wrong value {values[-1]!r}") from None
    return serve(unquote(name), port, **options)
