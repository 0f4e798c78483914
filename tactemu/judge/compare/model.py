"""The model of a sensor as its wire shows it: learned on the bench, asked and unasked, under many conditions."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from firmware_protocols import Can, CanFrame, Command, Connector, Device, Serial, Tcp, Udp, WireFrame
from firmware_protocols.frames import payload
from tactemu.base.errors import DeviceError, no_such
from tactemu.judge.compare.asking import Asked, ask, form_of, literal_bytes, records_of, stages_of
from tactemu.judge.compare.bench import Bench, Readings
from tactemu.judge.compare.declared import declare
from tactemu.judge.compare.frame_classes import (
    FrameClass,
    Record,
    envelope_of,
    identity_of,
    learn,
    learn_class,
    opened,
    tell_apart,
)
from tactemu.judge.compare.settings import find_settings
from tactemu.truth.entries import Sample

FRAMES_LEARNED = 40
"""Number of frames of the slowest stream in a run on the bench."""
LISTENING_RANGE_S = (0.3, 4.0)
"""Least and greatest time for which a run on the bench listens [s]."""
UPTIME_NS = 3_456_000_000_000_000
"""Time of the device's own clock in a run after a long time [ns]: 40 days."""
MIN_STARTED_FRAMES = 3
"""Least number of frames after a request without a documented answer that are a stream."""
ROUNDS = (2, 9, 3)
"""Number of times that each command is sent in the runs on the bench: at rest, with pushes, after a long time."""


@dataclass
class Answer:
    """The answer of a model to one command."""

    command: Command
    made: FrameClass | None = None
    """The class of the whole answer, all frames joined; ``None``: the model is silent."""
    frames: int = 0
    """The number of frames of an answer."""
    wait_s: tuple[float, float] = (0.0, 0.0)
    """Least and greatest time from the request to the answer's last bit [s]."""
    starts: bool = False
    """True if frames follow it that go on: it is no answer."""
    literal: dict[int, int] | None = None
    """The bytes that the documented example states, by place; ``None``: the documentation gives no bytes."""


@dataclass
class Model:
    """A model of a device, as seen on its wire."""

    name: str
    make: Callable[[], Device]
    connector: Connector
    unasked: list[FrameClass] = field(default_factory=list)
    """The classes of frames that it sends without a request after power-up."""
    started: list[FrameClass] = field(default_factory=list)
    """The classes of unasked frames after some command, such as one that starts a stream."""
    answers: dict[str, Answer] = field(default_factory=dict)
    """The answers, by name of the command."""

    channels: list[str] = field(default_factory=list)
    """The names of the numbers of the counts, in the order of the senses."""


def channel_names(bench: Bench) -> list[str]:
    """Return a name for each number of the counts of all senses of the first sample: point, and column if several."""
    device, names = bench.device, []
    samples = [each for each in bench.log.entries if isinstance(each, Sample)]
    for sample in [each for each in samples if each.number == samples[0].number]:
        shape = np.shape(sample.counts)
        what = "taxel" if sample.sense in ("", *device.contact) else sample.sense
        columns = [c.name for c in device.columns if not c.shared and c.sense in ("", sample.sense)]
        inner = int(np.prod(shape[1:], dtype=int))
        for point in range(shape[0] if shape else 1):
            for k in range(inner):
                named = columns[k] if len(columns) == inner else str(k)
                names.append(f"{what} {point}{f' {named}' if inner > 1 else ''}")
    return names


def port_of(device: Device, wanted: str, source: str) -> Connector:
    """Return the connector that fits a source, or the one that the user names.

    Raises:
        DeviceError: there is none.
    """
    if wanted:
        found = [each for each in device.ports if each.name == wanted]
        if not found:
            named = [each.name for each in device.ports if each.name]
            raise DeviceError(f"{device.name} has {no_such('port', wanted, named)}")
    else:
        scheme = source.partition(":")[0]
        kinds = {"can": (Can,), "udp": (Udp,), "socket": (Tcp, Serial), "tcp": (Tcp, Serial)}
        fitting = kinds.get(scheme, (Serial,))
        found = [each for kind in fitting for each in device.ports if isinstance(each, kind)]
    if not found:
        has = ", ".join(f"{each.name or 'first'} ({type(each).__name__})" for each in device.ports)
        raise DeviceError(f"{device.name} has no port for {source}; it has: {has}")
    return found[0]


# -- learning ----------------------------------------------------------------------------------------------------------


def learn_model(
    name: str,
    make: Callable[..., Device],
    connector: Connector,
    commands: Sequence[Command],
    progress: Callable[[str], object] = lambda text: None,
) -> Model:
    """Return what a model sends on one port, unasked and asked by these commands.

    Args:
        name: the name of the device.
        make: makes a device, with the given options beside the user's.
        connector: the port.
        commands: the commands that are asked.
        progress: is called with what is being done; it may raise an exception to end.
    """
    device = make()
    model = Model(name, make, connector)
    heard: list[Record] = []
    asked: dict[str, list[Asked]] = {each.name: [] for each in commands}
    runs = (Readings(), Readings(1, varies=True), Readings(2, varies=True))
    for run, readings in enumerate(runs):
        progress(f"the model, run {run + 1} of {len(runs)}")
        given = make()
        presets = _presets(given) if run == 2 else {}
        shown = UPTIME_NS if run == 2 else 0
        with Bench(given, connector, readings, shown_ns=shown, presets=presets) as bench:
            bench.run(device.boot_s + _listening_s(device))
            heard += records_of(bench, run, 0)
            model.channels = model.channels or channel_names(bench)
            unasked = {form_of(each) for each in heard}
            for _ in range(ROUNDS[run] if commands else 0):
                for command in commands:
                    progress(f"the model, run {run + 1} of {len(runs)}: {command.name}")
                    asked[command.name] += ask(bench, command, run, unasked)
    _sort_unasked(model, heard, device)
    for command in commands:
        model.answers[command.name] = _answer(command, asked[command.name], device)
    progress("the model after every command")
    model.started += _started(make, connector, model.unasked)
    made = {name: answer.made for name, answer in model.answers.items()}
    find_settings(make, connector.name, model.unasked, made, commands, progress)
    return model


def _sort_unasked(model: Model, heard: Sequence[Record], device: Device) -> None:
    """Learn the classes of unasked frames, and set apart those that come at power-up only."""
    half_ns = round((device.boot_s + _listening_s(device) / 2) * 1e9)
    late = [record for record in heard if record.run == 0 and record.t_ns > half_ns]
    for each in learn(heard, device.rollovers) if heard else []:
        declare(each, device, [payload(r.frame) for r in heard if identity_of(r.frame) == each.identity])
        each.rate_hz, each.sample_hz = _rates_hz(each, late)
        (model.unasked if each.rate_hz else model.started).append(each)
    tell_apart(model.unasked)
    if len(model.unasked) == 1 and not model.started:
        (only,) = model.unasked
        only.is_unmarked = (
            bool(only.size) and only.envelope == "plain" and not (only.identity or only.fixed or only.sum)
        )


def _rates_hz(made: FrameClass, records: Sequence[Record]) -> tuple[float, float]:
    """Return the frames of a class per second, and the samples that have some; 0 for too few."""
    firsts: dict[int, int] = {}
    numbers: dict[int, int] = {}
    for record in records:
        count = sum(made.fits(each) for each in opened(payload(record.frame), made.envelope))
        if count and record.sample is not None and identity_of(record.frame) == made.identity:
            firsts.setdefault(record.sample, record.t_ns)
            numbers[record.sample] = numbers.get(record.sample, 0) + count
    if len(firsts) < 3:
        return 0.0, 0.0
    last, first = max(firsts), min(firsts)
    seconds = (firsts[last] - firsts[first]) * 1e-9
    return (sum(numbers.values()) - numbers[last]) / seconds, (len(firsts) - 1) / seconds


def _listening_s(device: Device) -> float:
    slowest = max([period for period in device.periods.values() if period], default=10_000_000)
    return min(max(FRAMES_LEARNED * slowest * 1e-9, LISTENING_RANGE_S[0]), LISTENING_RANGE_S[1])


def _presets(device: Device) -> dict[str, int]:
    """Return high values of the counters that are soon full in their lowest byte."""
    rng = random.Random(5)
    return {
        each.name: rng.randrange(1 << each.bits) & ~0xFF | 0xF0
        for each in device.rollovers
        if each.state and not each.clock and each.bits >= 8
    }


def is_known(frame: WireFrame, known: Sequence[FrameClass]) -> bool:
    """Return True for a frame of one of these classes."""
    for each in known:
        if identity_of(frame) == each.identity:
            contents = opened(payload(frame), each.envelope)
            if contents and each.fits(contents[0]) and (each.sum is None or each.sum.holds(contents[0])):
                return True
    return False


def _answer(command: Command, asked: Sequence[Asked], device: Device) -> Answer:
    answer = Answer(command, literal=literal_bytes(command))
    if not asked:
        return answer
    records, waits, numbers = zip(*asked)
    answer.frames, answer.wait_s = max(numbers), (min(waits), max(waits))
    if command.reply is None and answer.frames >= MIN_STARTED_FRAMES:
        answer.starts = True
        return answer
    contents = [payload(each.frame) for each in records]
    envelope = envelope_of(contents) if answer.frames == 1 and not isinstance(command.frame, CanFrame) else "plain"
    if (envelope == "cobs" and len(set(contents)) < 4) or any(len(opened(each, envelope)) != 1 for each in contents):
        envelope = "plain"
    records = [replace(each, frame=opened(payload(each.frame), envelope)[0]) for each in records]
    answer.made = learn_class(records, device.rollovers, f"answer to `{command.name}`", None, envelope)
    declare(answer.made, device, contents if envelope == "plain" else [])
    if envelope == "plain" and answer.literal is not None:
        answer.made.fixed = {at for at in answer.literal if answer.made.const.get(at) == answer.literal[at]}
    return answer


def _started(make: Callable[..., Device], connector: Connector, unasked: Sequence[FrameClass]) -> list[FrameClass]:
    """Return the classes of unasked frames that begin after some documented command, sent to a fresh model."""
    device = make()
    commands = [each for each in device.commands if (each.port or device.ports[0].name) == connector.name]
    records: list[Record] = []
    for command in [each for each in commands if not each.safe][:60]:
        with Bench(make(), connector, Readings(1, varies=True)) as bench:
            bench.run(device.boot_s + 0.05)
            bench.ask([*(stages := stages_of(command))[0], stages[1]], 0.05)
            at = len(bench.log.entries)
            bench.run(0.4)
            new = [each for each in records_of(bench, 0, at) if not is_known(each.frame, unasked)]
            records += new if len(new) > 2 else []
    classes = learn(records, device.rollovers, "started frames") if records else []
    for each in classes:
        declare(each, device, [payload(r.frame) for r in records if identity_of(r.frame) == each.identity])
    tell_apart([*unasked, *classes])
    return classes
