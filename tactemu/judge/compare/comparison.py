"""The comparison of a capture with a model. It needs no sensor: a capture that was kept can be judged again."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from firmware_protocols import CanFrame, Column, Command, Device, WireFrame
from firmware_protocols.frames import text_of
from tactemu.judge.compare.answer_check import Answered, answers_of, check_answers, exchanges_of
from tactemu.judge.compare.asking import stages_of
from tactemu.judge.compare.cutting import ByteStream, cut
from tactemu.judge.compare.findings import Verdicts
from tactemu.judge.compare.frame_checks import check_frames
from tactemu.judge.compare.frame_classes import FrameClass, identity_of, matrix, opened
from tactemu.judge.compare.model import Model
from tactemu.judge.compare.presses import Course, Press, check_presses
from tactemu.judge.compare.specimen import Specimen, measure
from tactemu.judge.compare.stream_check import Stream, check_stream
from tactemu.judge.compare.timing import check_rate, latest_s
from tactemu.truth.entries import Passage

MIN_LISTENING_S = 0.5
"""Least time without a request for which unasked frames are judged [s]."""
MAX_OWN_REQUESTS = 64
"""Largest number of requests of a capture that are asked of the model."""
MIN_STARTED = 12
"""Least number of frames of a class that some command has started, for checks of its contents."""


@dataclass
class Comparison:
    """The result of a comparison."""

    model: Model
    verdicts: Verdicts = field(default_factory=Verdicts)
    specimen: Specimen = field(default_factory=Specimen)
    asked: dict[str, int] = field(default_factory=dict)
    """The number of requests, by command."""
    listened_s: float = 0.0
    frames: int = 0
    """The number of unasked frames that were recognised."""

    @property
    def agrees(self) -> bool:
        """True if something was compared and no difference of the protocol was found."""
        return not self.verdicts.protocol and bool(self.verdicts.agrees)


def requests_in(entries: Sequence[Passage], commands: Sequence[Command]) -> list[Command]:
    """Return the requests of a capture as commands: documented ones, and others without a documented answer."""
    documented = {frame: command for command in commands for frame in [stages_of(command)[1]]}
    before = {each for command in commands for each in stages_of(command)[0]}
    found: dict[WireFrame, Command] = {}
    for entry in entries:
        frame = entry.frame
        if entry.kind == "rx" and frame not in found and len(found) < MAX_OWN_REQUESTS and frame not in before:
            own = Command(name=text_of(frame).upper(), request=frame, reply=_anything)
            found[frame] = documented.get(frame, own)
    return list(found.values())


def _anything(frames: list[Any]) -> bool:
    """Return True: no document says what answers this request."""
    return True


def compare(
    model: Model,
    entries: Sequence[Passage],
    *,
    seconds: float,
    presses: Sequence[Press] = (),
    buffering_s: float = 0.0,
    progress: Callable[[str], object] = lambda text: None,
) -> Comparison:
    """Compare a capture with a model.

    Args:
        model: what the model sends; its answers are those to the requests of the capture.
        entries: the capture, with times from its start.
        seconds: its length.
        presses: presses in known places, with their times in the capture.
        buffering_s: time for which an adapter may keep bytes back [s].
        progress: is called with what is being done.
    """
    result = Comparison(model)
    verdicts = result.verdicts
    names: dict[WireFrame, str] = {stages_of(a.command)[1]: a.command.name for a in model.answers.values()}
    before, exchanges = exchanges_of(entries, names)
    result.listened_s = exchanges[0].sent_ns * 1e-9 if exchanges else seconds
    bounds = bounds_of(model)
    progress("comparing the frames that came unasked")
    if result.listened_s >= MIN_LISTENING_S:
        stream = check_stream(before, result.listened_s, model.unasked, model.started, bounds, verdicts)
        _check_rates(stream, result)
    else:
        stream = Stream(list(model.unasked))
        if model.unasked:
            verdicts.unjudged.append("frames without a request: the capture begins with requests")
    result.frames = sum(map(len, stream.contents.values()))
    progress("comparing the answers")
    running = [each for each in model.started if _frames_in(before, [each])]
    answered = answers_of(exchanges, [*stream.classes, *running])
    result.asked = {name: len(got.contents) for name, got in answered.items()}
    if answered and any(each.kind == "framing" for each in verdicts.protocol):
        verdicts.unjudged.append("the answers: they cannot be told from the frames that come unasked")
    else:
        streamed = [each for each in stream.classes if stream.contents.get(each.label)]
        check_answers(model.answers, answered, bounds, streamed, buffering_s, verdicts)
    after = [entry for exchange in exchanges for entry in exchange.entries]
    began = _frames_in(after, model.started)
    for made in model.started:
        contents = [content for _, content in began.get(made.label, [])]
        if len(contents) >= MIN_STARTED:
            check_frames(made, contents, bounds, verdicts)
    progress("measuring the specimen")
    _measure(result, stream, answered, exchanges, _frames_in(after, stream.classes), began, presses)
    return result


def late_commands(model: Model, entries: Sequence[Passage], buffering_s: float) -> list[Command]:
    """Return the commands of which no answer was as early as the model's; more tries tell load from lateness."""
    names: dict[WireFrame, str] = {stages_of(a.command)[1]: a.command.name for a in model.answers.values()}
    answered = answers_of(exchanges_of(entries, names)[1], model.unasked)
    late = []
    for name, got in answered.items():
        answer = model.answers[name]
        is_timed = answer.made is not None and answer.command.reply is not None
        if is_timed and (not got.waits_s or min(got.waits_s) > latest_s(answer, buffering_s)):
            late.append(answer.command)
    return late


def bounds_of(model: Model) -> list[tuple[float, float]]:
    """Return the range of each channel of the counts."""
    device = model.make()
    columns = [each for each in device.columns if not each.shared]
    return [_range_of(name, columns, device) for name in model.channels]


def _range_of(name: str, columns: Sequence[Column], device: Device) -> tuple[float, float]:
    what, _, rest = name.partition(" ")
    senses = ("", *device.contact) if what == "taxel" else ("", what)
    own = [each for each in columns if each.sense in senses]
    named = [each for each in own if rest.endswith(f" {each.name}")]
    chosen = named or own
    if not chosen:
        return -np.inf, np.inf
    return min(each.low for each in chosen), max(each.high for each in chosen)


def _check_rates(stream: Stream, result: Comparison) -> None:
    """Compare the rates; classes of one rate that the same clock drives give one finding each."""
    for made in stream.classes:
        times, contents = stream.times_ns.get(made.label, []), stream.contents.get(made.label, [])
        ratio = check_rate(made, times, contents, result.verdicts)
        if ratio is not None:
            result.specimen.clock_ppm[made.label] = round((ratio - 1) * 1e6, 1)


# -- the specimen ------------------------------------------------------------------------------------------------------

Timed = dict[str, list[tuple[int, bytes]]]
"""Contents with their times, by label of the class."""


def _frames_in(entries: Sequence[Passage], classes: Sequence[FrameClass]) -> Timed:
    """Return the frames of these classes in entries."""
    found: Timed = {}
    plain = [(entry.t_ns, entry.frame) for entry in entries if isinstance(entry.frame, bytes)]
    for entry in entries:
        if isinstance(entry.frame, CanFrame):
            for made in classes:
                if made.identity == identity_of(entry.frame) and made.fits(entry.frame.data):
                    found.setdefault(made.label, []).append((entry.t_ns, entry.frame.data))
    if plain and classes:
        view = ByteStream.of(plain)
        for piece in cut(view.data, classes):
            if piece.made is not None:
                found.setdefault(piece.made.label, []).append((view.time_ns(piece.end), piece.content))
    return found


def _measure(
    result: Comparison,
    stream: Stream,
    answered: Mapping[str, Answered],
    exchanges: Sequence[Any],
    later: Timed,
    began: Timed,
    presses: Sequence[Press],
) -> None:
    """Measure rest and noise of all channels, and check the presses."""
    timed: list[tuple[FrameClass, list[tuple[int, bytes]]]] = []
    for made in stream.classes:
        own = list(zip(stream.times_ns.get(made.label, []), stream.contents.get(made.label, [])))
        timed.append((made, own + later.get(made.label, [])))
    timed += [(made, began.get(made.label, [])) for made in result.model.started]
    for name, got in answered.items():
        made = result.model.answers[name].made
        times = [exchange.sent_ns for exchange in exchanges if exchange.name == name]
        if made is not None:
            timed.append((made, list(zip(times, got.contents))))
    courses: dict[int, list[Course]] = {}
    for made, frames in timed:
        contents = [(t, each) for t, data in frames for each in opened(data, made.envelope)[:1]]
        _add_courses(made, [(t, each) for t, each in contents if len(each) == made.size], courses)
    result.specimen.channels = measure(courses, result.model.channels)
    if presses:
        by_taxel: dict[int, list[Course]] = {}
        for channel, of in courses.items():
            what, _, rest = result.model.channels[channel].partition(" ")
            if what == "taxel":
                by_taxel.setdefault(int(rest.split()[0]), []).extend(of)
        result.specimen.peaks = check_presses(presses, by_taxel, result.verdicts)
    elif len(result.model.make().layout) > 1:
        result.verdicts.unjudged.append("the order of the taxels: none was pressed in a known place; --press")


def _add_courses(made: FrameClass, frames: Sequence[tuple[int, bytes]], courses: dict[int, list[Course]]) -> None:
    if not frames or not made.numbers:
        return
    table = matrix([content for _, content in frames])
    times = np.array([t_ns for t_ns, _ in frames]) * 1e-9
    for each in made.numbers:
        courses.setdefault(each.channel, []).append(Course(times, each.numbers(table)))
