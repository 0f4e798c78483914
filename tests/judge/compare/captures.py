"""Captures of sensors on the bench, in virtual time: the same dialogue as with a real one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import firmware_protocols as fp
from firmware_protocols import Command, Device
from firmware_protocols.frames import frame_of
from tactemu.judge.compare.bench import Bench, Readings
from tactemu.judge.compare.comparison import Comparison, compare
from tactemu.judge.compare.model import Model, learn_model
from tactemu.judge.compare.presses import Press
from tactemu.truth.entries import Passage

LISTENING_S = 6.0
PRESS_S = 0.6


def safe_commands(device: Device, port: str) -> list[Command]:
    """Return the safe commands of one port."""
    return [c for c in device.commands if c.safe and (c.port or device.ports[0].name) == port]


def model_of(name: str, port: int = 0, commands: Sequence[Command] | None = None) -> Model:
    """Return the model of a device with its safe commands."""
    device = fp.create(name)
    connector = device.ports[port]
    asked = safe_commands(device, connector.name) if commands is None else commands
    return learn_model(name, lambda **options: fp.create(name, **options), connector, asked)


def capture_of(
    model: Model, make: Callable[[], Device], readings: Readings, *, skew_ppm: float = 150.0, presses: bool = False
) -> tuple[list[Passage], float, list[Press]]:
    """Return the capture of a sensor, its length [s] and its presses."""
    device = make()
    connector = next(each for each in device.ports if each.name == model.connector.name)
    start_s = device.boot_s + 0.05
    pressed: list[Press] = []
    if presses:
        pressed = [Press(k, LISTENING_S + k, LISTENING_S + k + PRESS_S) for k in range(len(device.layout))]
        held = {p.taxel: (p.begin_s + start_s, p.end_s + start_s) for p in pressed}
        readings = replace(readings, pressed=held)
    with Bench(device, connector, readings, shown_ns=7_000_000_000, skew_ppm=skew_ppm) as bench:
        bench.run(start_s)
        begin_ns, begin = bench.now_ns, len(bench.log.entries)
        bench.run(LISTENING_S + (len(device.layout) if presses else 0))
        for k in range(26):
            for answer in model.answers.values():
                if k < 6 or (answer.made is not None and answer.made.numbers):
                    bench.ask([frame_of(each) for each in answer.command.after], 0.05)
                    bench.ask([answer.command.frame], answer.wait_s[1] + 0.05)
        passed = [each for each in bench.log.entries[begin:] if isinstance(each, Passage) and each.kind != "drop"]
        return [each._replace(t_ns=each.t_ns - begin_ns) for each in passed], (bench.now_ns - begin_ns) * 1e-9, pressed


def compared(model: Model, make: Callable[[], Device], readings: Readings, **more) -> Comparison:
    """Return the comparison of a sensor on the bench with a model."""
    entries, seconds, presses = capture_of(model, make, readings, **more)
    return compare(model, entries, seconds=seconds, presses=presses)
