"""Worked examples: JSON files of vectors, each with its origin, and the declared facts that they pin.

``golden/*.json`` beside the file of a device, and ``tests/data/golden`` for those of this tree::

    {"origin": "manual, page 3", "vectors": [
      {"name": "all taxels", "origin": "manual, page 3", "pushes": {"left": [[0.1, 0.2], [0.3, 0.4]]},
       "request": "C1 01 00 C0", "reply": ["C1 01 ..."]}]}

A vector belongs to ``device``, or to the device that the file is named after. A frame is hex, or a CAN frame in candump
notation. A new device with ``options`` receives ``after`` on ``port``; its skin is pushed by ``newtons`` (one number,
one per taxel, or x, y, z of the force on each taxel in the frame of its link) or by ``pushes`` (images of patches by
name [N], as seen from outside, or ``{"row,column": push}`` of the pushed taxels alone; none elsewhere), or ``counts``
(one per value of its first sense, or ``"index"``: 0, 1, 2 ...) take the place of what ``measure`` returned. Then, at
``t_ns`` (1 s), it must answer ``request`` with exactly ``reply``, or its next conversion must send exactly ``stream``
(one conversion of each stream, in the order of ``Device.streams``), and convert ``rate_hz`` times a second, if that is
given.
``acceleration`` [m/s²], ``angular_velocity`` [rad/s] and ``temperature`` [°C], and any other sense by its key in
``senses``, have the values given, one for all points or for each.

Other senses measure the same pushes: ``pressure`` is the push over the area of the taxel (its patch's ``area``, else
the pitch squared) [Pa], ``vibration`` all pushes over all areas [Pa]; quantities that contact does not change are 0, or
25 °C and (0, 0, 9.80665) m/s².
"""

from __future__ import annotations

import functools
import inspect
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

import firmware_protocols
from firmware_protocols.calls import AuthorError
from firmware_protocols.check.host import SECOND_NS, Host, Subject
from firmware_protocols.check.mutations import mutations_of
from firmware_protocols.check.report import Fault
from firmware_protocols.device import Device
from firmware_protocols.frames import frame_of, payload, text_of
from firmware_protocols.senses import Counts

TREE = Path(firmware_protocols.__file__).parents[1] / "tests" / "data" / "golden"
"""The folder of the examples in the source tree."""
REQUEST_INTERVAL_NS = SECOND_NS // 100
"""The time between the requests of ``after``."""


@dataclass(frozen=True, kw_only=True)
class Example:
    """A vector: one worked example."""

    name: str
    origin: str
    device: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)
    after: Sequence[str] = ()
    port: str = ""
    newtons: Any = 0.0
    pushes: Mapping[str, Any] | None = None
    counts: Any = None
    t_ns: int = SECOND_NS
    request: str | None = None
    reply: Sequence[str] | None = None
    stream: Sequence[str] | None = None
    rate_hz: float | None = None
    acceleration: Any = None
    angular_velocity: Any = None
    temperature: Any = None
    senses: Mapping[str, Any] = field(default_factory=dict)

    @property
    def values(self) -> dict[str, Any]:
        """The values of senses that are given, by key."""
        named = {name: getattr(self, name) for name in ("acceleration", "angular_velocity", "temperature")}
        return {**{name: value for name, value in named.items() if value is not None}, **self.senses}

    @staticmethod
    def of(vector: Mapping[str, Any]) -> Example:
        """Return the example of a vector in a file.

        Raises:
            ValueError: a key is missing or unknown, or there is neither a reply nor a stream.
        """
        known = {each.name for each in fields(Example)}
        needed = {each.name for each in fields(Example) if each.default is each.default_factory is MISSING}
        if odd := (set(vector) - known) | (needed - set(vector)):
            raise ValueError(
                f"example {vector.get('name', '?')!r}: keys {sorted(odd)} unknown or missing; there are {sorted(known)}"
            )
        if not str(vector["origin"]).strip() or (vector.get("reply") is None) == (vector.get("stream") is None):
            raise ValueError(f"example {vector['name']!r}: give an origin, and `request` with `reply`, or `stream`")
        return Example(**vector)

    @property
    def frames(self) -> list[Any]:
        """The expected frames."""
        return [frame_of(text) for text in (self.reply if self.request is not None else self.stream) or ()]


def read(path: Path) -> list[Example]:
    """Return the examples of a file.

    Raises:
        ValueError: the file is no JSON, or a vector is invalid.
    """
    return list(_read(path.stem, path.read_text()))


@functools.lru_cache(maxsize=512)
def _read(device: str, text: str) -> tuple[Example, ...]:
    """Return the examples in the text of a file; the checks of all devices read all files of the tree."""
    return tuple(Example.of({"device": device, **vector}) for vector in json.loads(text)["vectors"])


def examples_of(cls: type[Device]) -> Iterator[tuple[Path, Example]]:
    """Yield the examples of a device with their files: those in the tree, and those beside the device."""
    for folder in dict.fromkeys([TREE, Path(inspect.getfile(cls)).parent / "golden"]):
        for path in sorted(folder.glob("*.json")):
            yield from ((path, example) for example in read(path) if example.device == cls.name)


def examples_with(subject: Subject) -> list[Example]:
    """Return the examples with the subject's options; none if a file cannot be read, which :func:`judged` reports."""
    try:
        return [example for _, example in examples_of(subject.cls) if example.options == subject.options]
    except (ValueError, KeyError, TypeError):
        return []


def replayed(subject: Subject, example: Example) -> tuple[list[Any], Device]:
    """Return the frames that a new device sends in an example, and the device.

    Raises:
        AuthorError: the device failed.
        ValueError: an image does not fit the layout, or an option is invalid.
    """
    host = Host(subject.make(example.options))
    for k, request in enumerate(example.after):
        host.t_ns = k * REQUEST_INTERVAL_NS
        host.send(request, example.port)
    host.t_ns = example.t_ns
    host.pushes = example.newtons if example.pushes is None else example.pushes
    sent = []
    known = {sense.key for sense in host.device.sensed}
    if odd := example.values.keys() - known:
        raise ValueError(f"the example has values of {sorted(odd)}, the device's senses are {sorted(known)}")
    for stream in host.device.periods:
        keys = {sense.key for sense in host.device.senses_of(stream)} & example.values.keys()
        counts = host.measure(stream, **{key: example.values[key] for key in keys})
        if example.counts is not None:
            given, kept = _example_counts(example.counts, counts), vars(host.device).get("counts")
            host.device.counts = {**kept, next(iter(kept)): given} if isinstance(kept, Mapping) else given
        if example.stream is not None:
            sent += host.streamed(stream)
    return (host.send(example.request, example.port) if example.request is not None else sent), host.device


def _example_counts(counts: Any, measured: Counts) -> np.ndarray:
    like = np.asarray(next(iter(measured.values())) if isinstance(measured, Mapping) else measured)
    values = np.arange(like.size) if counts == "index" else np.array(counts)
    return values.reshape(like.shape).astype(like.dtype)


def difference(subject: Subject, example: Example) -> str:
    """Return the first difference between an example and the device; empty if there is none.

    Raises:
        AuthorError, ValueError: as :func:`replayed`.
    """
    got, device = replayed(subject, example)
    if (text := first_difference(got, example.frames)) or example.rate_hz is None:
        return text
    rates = {stream: 1e9 / period if period else 0.0 for stream, period in device.periods.items()}
    if any(np.isclose(rate, example.rate_hz) for rate in rates.values()):
        return ""
    found = ", ".join(f"{stream} {rate:g}".strip() for stream, rate in rates.items())
    ways = "set self.period_ns or self.periods[...]" if example.after else "correct rate_hz"
    where = f"{ways}, or correct rate_hz" if example.after and device.periods == subject.make().periods else ways
    return f"it converts {found} times a second instead of {example.rate_hz:g}: {where}"


def first_difference(got: Sequence[Any], wanted: Sequence[Any]) -> str:
    """Return the first difference, as ``frame 0, byte 4: 0001 instead of 0100``; empty if there is none."""
    for k, (mine, theirs) in enumerate(zip(got, wanted)):
        if text_of(mine) == text_of(theirs):
            continue
        a, b = payload(mine), payload(theirs)
        at = next((i for i, (x, y) in enumerate(zip(a, b)) if x != y), min(len(a), len(b)))
        if a == b:
            return f"frame {k}: {text_of(mine)} instead of {text_of(theirs)}"
        lengths = f" ({len(a)} bytes instead of {len(b)})" if len(a) != len(b) else ""
        return f"frame {k}, byte {at}: {_some(a, at)} instead of {_some(b, at)}{lengths}"
    return "" if len(got) == len(wanted) else f"{len(got)} frames instead of {len(wanted)}"


def _some(data: bytes, at: int) -> str:
    return data[at : at + 4].hex().upper() + ("…" if len(data) > at + 4 else "") or "the end"


def judged(subject: Subject, mutations: bool = True) -> tuple[list[Fault], list[str], int]:
    """Return faults, unpinned facts (none without ``mutations``), and the number of examples."""
    faults: list[Fault] = []
    try:
        given = list(examples_of(subject.cls))
    except (ValueError, KeyError, TypeError) as error:
        return [Fault("examples", f"a file of examples cannot be read: {error}")], [], 0
    failed = []
    for path, example in given:
        try:
            text = difference(subject, example)
        except AuthorError as error:
            text = str(error)
        except ValueError as error:
            faults.append(Fault("examples", f"{example.name!r} ({example.origin}): {error}", str(path)))
            continue
        if text:
            failed.append((path, example, text))
    for path, example, text in failed:
        fits = [change for change, passes in _tried(subject, [example], hints=True) if passes]
        if _all_pass(subject, [example]):  # it fails by what earlier ones left behind, in the class or the module
            fits = []
        hint = f"; it fits with {' or '.join(fits[:3])}" if fits else ""
        faults.append(Fault("examples", f"{example.name!r} ({example.origin}): {text}{hint}", str(path)))
    if faults or not mutations:
        return faults, [], len(given)
    unpinned = [change for change, passes in _tried(subject, [example for _, example in given]) if passes]
    return [], unpinned, len(given)


def _tried(subject: Subject, examples: Sequence[Example], hints: bool = False) -> Iterator[tuple[str, bool]]:
    """Yield each mutation of a declared fact, and True if all examples pass with it."""
    for mutation in mutations_of(subject.cls, hints):
        with mutation.apply() as had_effect, subject.without_snapshots():
            passes = _all_pass(subject, examples) and had_effect()
        yield mutation.text, passes


def _all_pass(subject: Subject, examples: Sequence[Example]) -> bool:
    try:
        subject.make()
        return not any(difference(subject, example) for example in examples)
    except Exception:  # a mutation may break the device in any way, which pins the fact
        return False
