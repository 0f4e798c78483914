"""One driver against one fault: before, during, after; and what came of it.

The driver runs in a process of its own (``endure.py``). Everything it reports is compared with the truth log: a reading
is *right* if it is, number for number, one of the samples.
"""

from __future__ import annotations

import contextlib
import json
import re
import signal
import subprocess
import sys
import threading
import time
from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tactemu
from tactemu.serving import Served
from tests.cli.command import environment
from tests.drivers.matrix.drivers import Driver
from tests.drivers.matrix.endure import digest
from tests.drivers.matrix.trials import Trial
from tests.drivers.test_through_the_emulator import SCENE

SCRIPT = Path(__file__).with_name("endure.py")
START_S = 30.0
"""For a driver to be imported, connect and read, on a busy machine."""
WIRE_COUNTERS = ("sent", "received", "dropped_readings", "dropped_unread")
HIT_S = 5.0
"""How much longer than planned a fault of some of the frames may last until it has hit one, on a busy machine."""
SETTLED = 10
"""Right readings in a row that say that a driver is well."""


@dataclass
class Outcome:
    """What a driver reported from when the fault was switched on. Times in seconds."""

    driver: str
    fault: str
    injected: int = 0
    readings: int = 0
    wrong: int = 0
    """Readings handed to the user that are no sample, without a word."""
    refused: int = 0
    """Readings that the driver itself marks as bad."""
    older: int = 0
    """Right readings of an older sample than the one before."""
    lost: int = 0
    """Samples of which no reading came, though readings of earlier and of later ones did; of a driver that asks, what
    it counts itself: commands less answers, more than the one that may be on its way."""
    again: int = 0
    """Right readings of the same sample as the one before."""
    errors: Counter[str] = field(default_factory=Counter)
    """Exceptions by name."""
    texts: list[str] = field(default_factory=list)
    """What they said."""
    gap: float = 0.0
    """Longest time without a right reading."""
    recovered: float | None = None
    """From the end of the fault to the first of ten right readings in a row; ``None``: not while it was watched."""
    stuck: str = ""
    """Where the driver is, if it did not recover."""
    restart_helps: bool | None = None
    """Asked only of drivers that did not recover."""
    counters: dict[str, int] = field(default_factory=dict)
    """The driver's own, and those of the wire: growth since the fault was switched on."""


class Process:
    """A driver at work; ``lines`` is what it has said so far."""

    def __init__(self, name: str, port: str, folder: Path, baud: int | None = None):
        command = [sys.executable, "-u", str(SCRIPT), name, port, *([str(baud)] if baud else [])]
        self.lines: list[dict[str, Any]] = []
        self._log = open(folder / "driver.log", "w+")
        self._process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=self._log, text=True, cwd=folder, env=environment()
        )
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            with contextlib.suppress(json.JSONDecodeError):  # cut off when it was killed
                self.lines.append(json.loads(line))

    def where(self) -> str:
        """The functions that the driver's threads are in, as ``file:function``, ours left out."""
        self._process.send_signal(signal.SIGUSR1)
        time.sleep(0.3)
        self._log.seek(0)
        stack = re.findall(r'File ".*/site-packages/([^"]+)", line \d+ in (\w+)', self._log.read())
        return ", ".join(dict.fromkeys(f"{file}:{name}" for file, name in stack))

    def kill(self) -> None:
        self._process.kill()
        self._process.wait(10)
        self._thread.join(10)
        self._log.close()


def until(condition: Callable[[], bool], seconds: float, look_s: float = 0.02) -> bool:
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(look_s)
    return True


@contextlib.contextmanager
def served(driver: Driver, folder: Path, seed: int = 0) -> Iterator[Served]:
    """The driver's device on a port; every taxel carries noise, so that each reading names its sample."""
    path = folder / "scene.toml"
    scene = SCENE.format(device=driver.device, rate_hz=driver.rate_hz, noise=driver.noise, device_options="")
    path.write_text(scene + driver.more)
    with tactemu.serve(path, driver.port, seed=seed) as dev:
        yield dev


class Ring:
    """Where a driver meets its device; one process of the driver lives from bout to bout for as long as it is well."""

    def __init__(self, name: str, driver: Driver, folder: Path, seed: int = 0):
        self.name, self.driver, self.folder = name, driver, folder
        self._scene = contextlib.ExitStack()
        self.dev = self._scene.enter_context(served(driver, folder, seed))
        self.judge = Judge(self.dev, driver)
        self.process: Process | None = None

    def __enter__(self) -> Ring:
        return self

    def __exit__(self, *_) -> None:
        self.dismiss()
        self._scene.close()

    def dismiss(self) -> None:
        """Kill the driver."""
        if self.process is not None:
            self.process.kill()
            self.process = None

    def bout(self, label: str, trial: Trial) -> Outcome:
        """Let the driver settle, spoil, undo, and see."""
        process = self.process = self.process or Process(self.name, self.dev.port, self.folder)
        if not self._settles():
            raise RuntimeError(f"{self.name} reads nothing before any fault: {process.lines[-3:]}")
        wire = self.dev.emulator.channels[0].wire
        before, injected, own = dict(wire.counters), self.dev.truth.injected.total(), _latest_counters(process.lines)
        on_ns = _do(self.dev, lambda: _begin(self.dev, label, trial))
        time.sleep(trial.seconds)
        if label != "none":
            until(lambda: self.dev.truth.injected.total() > injected, HIT_S)
        off_ns = _do(self.dev, lambda: _end(self.dev, trial))
        well = self._recovers(off_ns)
        after = _latest_counters(process.lines)
        outcome = self.judge.outcome(self.name, label, process.lines, on_ns, off_ns)
        outcome.injected = self.dev.truth.injected.total() - injected
        outcome.counters = {key: after[key] - own.get(key, 0) for key in after}
        if (missing := outcome.counters.get("writes", 0) - outcome.counters.get("reads", 0)) > 1:
            outcome.lost = missing
        outcome.counters |= {f"wire {key}": wire.counters[key] - before.get(key, 0) for key in WIRE_COUNTERS}
        if not well:
            outcome.stuck = process.where()
            outcome.restart_helps = self.restart()
        return outcome

    def restart(self) -> bool:
        """Whether a new process of the driver reads."""
        self.dismiss()
        self.process = Process(self.name, self.dev.port, self.folder)
        return self._settles()

    def _settles(self) -> bool:
        """Ten right readings in a row from now on."""
        assert self.process is not None
        lines, now = self.process.lines, time.monotonic_ns()
        return until(lambda: self.judge.recovered(lines, now) is not None, START_S, look_s=0.1)

    def _recovers(self, off_ns: int) -> bool:
        assert self.process is not None
        lines = self.process.lines
        return until(lambda: self.judge.recovered(lines, off_ns) is not None, self.driver.patience_s, look_s=0.1)


def _do(dev: Served, action: Callable[[], None]) -> int:
    """Run ``action`` in the emulator's loop; the monotonic time [ns] at which it was done."""
    done: list[int] = []

    def act() -> None:
        action()
        done.append(time.monotonic_ns())

    dev.emulator.call(act)
    assert until(lambda: bool(done), 10), "the emulator does not turn"
    return done[0]


def _begin(dev: Served, label: str, trial: Trial) -> None:
    emulator = dev.emulator
    if trial.fault:
        emulator.channels[0].wire.add_fault(trial.fault)
    elif label == "hang":
        emulator.hang(emulator.clock.now_ns() + round(trial.seconds * 1e9))
    else:
        emulator.reset()


def _end(dev: Served, trial: Trial) -> None:
    wire = dev.emulator.channels[0].wire
    for fault in wire.faults:
        if trial.fault == str(fault):
            wire.remove_fault(fault)


def _latest_counters(lines: list[dict[str, Any]]) -> dict[str, int]:
    return next((line["counters"] for line in reversed(list(lines)) if "counters" in line), {})


class Judge:
    """Knows every sample that was taken, and tells right readings from wrong ones."""

    def __init__(self, dev: Served, driver: Driver):
        self.dev, self.driver = dev, driver
        self._times: list[int] = []
        """When each sample was taken [ns, emulation time], oldest first."""
        self._places: list[dict[str, list[int]]] = []

    def places(self, line: dict[str, Any]) -> list[int] | None:
        """Of each part of a reading the time of the last sample that it equals; ``None`` if one equals none."""
        if (found := self._find(line["parts"])) is None:
            self._catch_up()
            found = self._find(line["parts"])
        return found

    def _find(self, parts: list[str]) -> list[int] | None:
        found = [known.get(part) for known, part in zip(self._places, parts)]
        return [at[-1] for at in found if at] if found and all(found) else None

    def _catch_up(self) -> None:
        """Learn the samples that were taken since."""
        last = self._times[-1] if self._times else -1
        for sample in [sample for sample in list(self.dev.truth.samples) if sample.t_ns > last]:
            self._times.append(sample.t_ns)
            parts = self.driver.parts(sample.counts)
            self._places = self._places or [{} for _ in parts]
            for known, part in zip(self._places, parts):
                known.setdefault(digest(part), []).append(sample.t_ns)

    def _latest_before(self, lines: list[dict[str, Any]], t_ns: int) -> set[int]:
        """The sample of the last right reading until then."""
        earlier = (self.places(line) for line in reversed(list(lines)) if line["t"] <= t_ns and self.right(line))
        return set(next(earlier, ()) or ())

    def right(self, line: dict[str, Any]) -> bool:
        return "parts" in line and not line.get("refused") and self.places(line) is not None

    def recovered(self, lines: list[dict[str, Any]], off_ns: int) -> float | None:
        """Seconds from the end of the fault to the first of ten right readings in a row, all of samples after it."""
        run: list[int] = []
        start_ns = time.monotonic_ns() - self.dev.emulator.clock.now_ns()
        for line in list(lines):
            if line["t"] <= off_ns:
                continue
            if not self.right(line):
                run = []
                continue
            if start_ns + min(self.places(line) or [0]) < off_ns:  # had been waiting in a buffer
                continue
            run.append(line["t"])
            if len(run) == SETTLED:
                return (run[0] - off_ns) / 1e9
        return None

    def outcome(self, name: str, label: str, lines: list[dict[str, Any]], on_ns: int, off_ns: int) -> Outcome:
        """Everything since the fault was switched on."""
        result = Outcome(name, label, recovered=self.recovered(lines, off_ns))
        last, last_right = None, on_ns
        seen = self._latest_before(lines, on_ns)
        now = time.monotonic_ns()
        for line in list(lines):
            if line["t"] <= on_ns:
                continue
            if "error" in line:
                if not line.get("opening") and not line.get("closing"):
                    result.errors[line["error"]] += 1
                    result.texts.append(line["text"])
                continue
            result.readings += 1
            if line.get("refused"):
                result.refused += 1
                continue
            places = self.places(line)
            if places is None:
                result.wrong += 1
                continue
            result.older += last is not None and min(places) < min(last)
            result.again += places == last
            last = places
            seen.update(places)
            result.gap, last_right = max(result.gap, (line["t"] - last_right) / 1e9), line["t"]
        result.gap = max(result.gap, (now - last_right) / 1e9)
        if seen and not self.driver.asks:
            between = bisect_right(self._times, max(seen)) - bisect_left(self._times, min(seen))
            unsent = label == "reset"  # the sample of the restart itself, which no stream sends
            result.lost = max(0, between - len(seen) - unsent)
        return result
