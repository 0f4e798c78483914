"""Captures of sensors on the bench: the dialogue with a real sensor, in virtual time."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace

import firmware_protocols as fp
from firmware_protocols import Command, Device
from tactemu.judge.compare.bench import Bench, Readings
from tactemu.judge.compare.comparison import Comparison, compare, late_commands
from tactemu.judge.compare.dialogue import Dialogue
from tactemu.judge.compare.model import Model, learn_model
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


class BenchLink:
    """A line to a sensor on the bench: time passes only while the dialogue waits."""

    is_over = False
    kept_bytes = 0

    def __init__(self, bench: Bench):
        self.bench = bench
        self._begin_ns, self._begin = bench.now_ns, len(bench.log.entries)

    @property
    def now_ns(self) -> int:
        return self.bench.now_ns - self._begin_ns

    @property
    def entries(self) -> list[Passage]:
        kept = self.bench.log.entries[self._begin :]
        passed = [each for each in kept if isinstance(each, Passage) and each.kind != "drop"]
        return [each._replace(t_ns=each.t_ns - self._begin_ns) for each in passed]

    def send(self, frame) -> None:
        self.bench.port.driver.write(frame)

    def receive(self, until_ns: int, enough: Callable[[], bool] = bool) -> None:
        while (left_ns := until_ns - self.now_ns) > 0:
            self.bench.run(min(left_ns, 5_000_000) * 1e-9)
            if enough():
                return


def compared(
    model: Model, make: Callable[[], Device], readings: Readings, *, skew_ppm: float = 150.0, presses: bool = False
) -> Comparison:
    """Return the comparison of a sensor on the bench with a model; with ``presses``, somebody obeys the prompts."""
    device = make()
    connector = next(each for each in device.ports if each.name == model.connector.name)
    with Bench(device, connector, readings, shown_ns=7_000_000_000, skew_ppm=skew_ppm) as bench:
        bench.run(device.boot_s + 0.05)
        link = BenchLink(bench)
        dialogue = Dialogue(link, model)  # type: ignore[arg-type]
        dialogue.listen(LISTENING_S)
        dialogue.ask_all([answer.command for answer in model.answers.values()])
        dialogue.ask_again(lambda: late_commands(model, link.entries, 0.0))

        def obey(prompt: str) -> None:
            pressed = {}
            if found := re.search(r"press taxel (\d+)", prompt):
                now_s = bench.now_ns * 1e-9
                pressed = {int(found[1]): (now_s + 0.1, now_s + PRESS_S)}
            bench.source.readings = replace(readings, pressed=pressed)

        pressed = dialogue.press(device, range(len(device.layout)), PRESS_S, obey) if presses else []
        return compare(model, link.entries, seconds=link.now_ns * 1e-9, presses=pressed)
