"""Judging a driver: it is started, learned, and put through one trial after the other; each becomes a tape."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from tactemu.errors import TactemuError
from tactemu.judge import smallest
from tactemu.judge.columns import Columns
from tactemu.judge.driver import Driver, command_of
from tactemu.judge.excitation import STEP
from tactemu.judge.following import Reading, left_times, recovered
from tactemu.judge.learning import Unlearnable, learn
from tactemu.judge.outcome import FAILING, Known, Outcome
from tactemu.judge.plan import Facts, Plan, Trial
from tactemu.judge.stand import Stand
from tactemu.judge.tape import Tape
from tactemu.judge.verdicts import judged, known_of

START_S = 15.0
"""For a driver to be imported, connect and print a row."""
CLEAN_ROWS, CLEAN_S, SLOW_S = 320, 4.0, 12.0
"""Of the run without faults: so many rows, in this time; a slow driver gets more of it until there are enough."""
ENOUGH_ROWS = 60
HOLDS, HOLDS_S = 24, 12.0
"""Samples that are held, of a driver that filters, and the time for them."""
PATIENCE_S, LONGEST_S = 1.5, 8.0
"""How long a driver may take to be well again; and one that says nothing at all, once: it may have a time-out."""
BEFORE_S = 3.0
"""How much of what was before a trial is on its tape."""
LOOK_S = 0.02
MOST_COUNTS = 200_000
"""Counts a second that a device is made to convert, where it is sampled faster than by itself."""


@dataclass
class Options:
    """How a driver is judged."""

    rest_s: float = 1.0
    """How long the skin feels nothing after the first row: drivers tare."""
    seed: int = 0
    budget_s: float | None = None
    every: bool = False
    """Every position of a frame, not only some of the values'."""
    fail_on: Sequence[str] = FAILING
    shrink: bool = True
    only: Sequence[str] = ()
    """Trials whose names hold one of these words."""
    columns: Path | None = None
    record: Path | None = None
    """Folder for the recorded trials."""
    patience_s: float = PATIENCE_S
    start_s: float = START_S
    """How long the driver may take to print its first row."""
    device_options: Mapping[str, Any] = field(default_factory=dict)
    port: str | Mapping[str, str] | None = None
    rate_hz: float | None = None


class Judge:
    """Judges one driver at one device; use it in a ``with`` statement.

    Args:
        target: a device's name, a device file, or a scene file.
        command: the driver's, ``{port}`` where it takes the port.
        options: how.
        say: told what is going on.
    """

    def __init__(
        self,
        target: str,
        command: Sequence[str],
        options: Options | None = None,
        say: Callable[[str], object] = lambda text: None,
    ):
        self.target, self.command, self.options, self.say = target, list(command), options or Options(), say
        opts = self.options
        self.stand = Stand(target, opts.port, seed=opts.seed, options=opts.device_options, rate_hz=opts.rate_hz)
        self.driver: Driver | None = None
        self.columns, self.known, self.facts = Columns(), Known(), Facts()
        self.starts: list[float] = []
        """How long the driver took to print its first row [s]."""
        self.left_behind = 0
        """Processes that had left the driver's session."""
        self._longest = LONGEST_S
        self._numbers = 0

    def __enter__(self) -> Judge:
        self.stand.__enter__()
        return self

    def __exit__(self, *_) -> None:
        try:
            self.end()
        finally:
            self.stand.__exit__()

    # -- the whole -----------------------------------------------------------------------------------------------------

    def run(self) -> Iterator[Outcome]:
        """Every trial's outcome, as it comes; first that of the run without faults."""
        outcome = self.clean()
        yield outcome
        if not self.columns.values:
            return
        for trial in self.plan():
            yield self.judge(trial)

    def plan(self) -> list[Trial]:
        """The trials after the clean run."""
        opts = self.options
        every = opts.every or (opts.budget_s or 0.0) > 120
        trials = Plan(self.facts, opts.seed, every).trials(opts.budget_s)
        if opts.only:
            trials = [trial for trial in trials if any(word in trial.name for word in opts.only)]
        return trials

    def judge(self, trial: Trial) -> Outcome:
        """Try it; what it finds must come again. Where a fault causes it, the smallest case is looked for."""
        if trial.skipped:
            return judged(Tape(trial.name, trial.as_dict()))
        tape = self.record(trial)
        outcome = judged(tape)
        if not outcome.has(*self.options.fail_on) or not self.options.shrink:
            return outcome
        if smallest.may_be(trial):
            kinds = self.options.fail_on
            outcome.case = smallest.find(trial, tape, outcome, self._again, self.target, self.command, kinds)
            outcome.confirmed = outcome.case is not None
        if not outcome.confirmed:
            again = judged(self.record(trial))
            kinds = {finding.kind for finding in outcome.findings if finding.kind in self.options.fail_on}
            outcome.confirmed = again.has(*kinds)
        return outcome

    def _again(self, trial: Trial) -> tuple[Tape, Outcome]:
        tape = self.record(trial, keep=False)
        return tape, judged(tape)

    # -- the driver's life ---------------------------------------------------------------------------------------------

    def end(self) -> None:
        """End the driver and all that it started."""
        if self.driver is not None:
            self.left_behind = max(self.left_behind, self.driver.end())
            self.driver = None

    def start(self) -> str:
        """Start the driver anew and let it tare; returns why it does not read, or nothing.

        Raises:
            TactemuError: the command cannot be run, and never could.
        """
        self.end()
        self.stand.rest()
        ports = self.stand.ports
        try:
            driver = self.driver = Driver(command_of(self.command, ports), ports)
        except TactemuError as error:
            if not self.starts:  # the command is wrong, and not the driver
                raise
            return f"died: {error}"
        deadline = time.monotonic() + self.options.start_s
        while not driver.rows and driver.exit is None and not driver.flooded and time.monotonic() < deadline:
            time.sleep(LOOK_S / 2)
        if not driver.rows:
            return self._why_nothing(driver)
        self.starts.append((driver.rows[0].t - driver.started) / 1e9)
        end = time.monotonic() + self.options.rest_s
        while time.monotonic() < end and driver.exit is None and not driver.flooded:
            time.sleep(LOOK_S)
        self.stand.excite(self.columns.steps)
        time.sleep(0.1 + 2 * self.facts.row_s)
        if driver.flooded or driver.exit is not None:
            return self._why_nothing(driver)
        return ""

    def _why_nothing(self, driver: Driver) -> str:
        time.sleep(0.05)  # for the last words
        last = [note.text for note in driver.notes][-3:]
        words = f": {' | '.join(last)}" if last else ""
        if driver.flooded:
            return "floods: it prints more than 8 MB in 5 s that is no reading"
        if driver.exit is not None:
            return f"exits with status {driver.exit} before it is judged{words}"
        opened = any(what == "opened" for _, what in self.stand.recorder.events)
        if driver.notes:
            return f"prints nothing that holds numbers within {self.options.start_s:g} s{words}"
        return f"prints nothing within {self.options.start_s:g} s{'' if opened else ', and does not open the port'}"

    def _well(self, since: int, seconds: float, reading: Reading | None = None) -> bool:
        """Whether ten right rows in a row come of samples after ``since``, within some seconds."""
        assert self.driver is not None
        reading = reading or Reading(self.columns, self.known)
        deadline = time.monotonic() + seconds
        while True:
            tape = self._tape(since - 500_000_000)
            fresh = Reading(self.columns, self.known)
            fresh.feed(tape)
            if recovered(tape, fresh.matches, self.known, since, left_times(tape)) is not None:
                return True
            if self.driver.exit is not None or time.monotonic() > deadline:
                return False
            time.sleep(LOOK_S + 0.5 * self.facts.row_s)

    def _ready(self) -> str:
        """Have a driver that reads well; returns why there is none."""
        now = time.monotonic_ns()
        if (
            self.driver is not None
            and self.driver.exit is None
            and self._well(now - 50_000_000, 1.0 + 12 * self.facts.row_s)
        ):
            return ""
        for _ in range(2):  # a busy machine may have it slip once
            if why := self.start():
                return why
            if self._well(time.monotonic_ns(), 2.0 + 12 * self.facts.row_s):
                return ""
        return "died: does not read well after a new start"

    # -- the run without faults ----------------------------------------------------------------------------------------

    def clean(self) -> Outcome:
        """Start the driver, learn its columns, and see how it does when nothing is wrong."""
        began = time.monotonic()
        if why := self.start():
            return self._nothing(why)
        assert self.driver is not None
        self.say("looking at how it reads")
        time.sleep(0.3)
        since = time.monotonic_ns()
        self._collect(since, 12, 1.0)
        self.facts = self.stand.facts(since, self._rows_since(since))
        if self.facts.asks and not self.facts.sets_rate and not self.options.rate_hz:
            self._sample_faster()
        on = time.monotonic_ns()
        self._collect(on, CLEAN_ROWS, CLEAN_S)
        tape = self._clean_tape(on)
        if tape.exit is None and (trouble := self._learn(tape)):
            self.say("looking again, at samples that are held: it may filter")
            self.stand.excite(steps=True)
            on = time.monotonic_ns()
            self._collect(on, (HOLDS + 2) * STEP, HOLDS_S)
            tape = self._clean_tape(on)
            if tape.exit is None and self._learn(tape, steps=True):
                return self._nothing(trouble)
        self.known = known_of(tape, self.columns, asks=self.facts.asks, period_ms=1e3 * self.stand.period_s)
        self.facts = self.stand.facts(on, self._rows_since(on))
        tape = self._filled(tape)
        if tape.exit is not None:
            return self._nothing(self._why_nothing(self.driver))
        self._write(tape)
        outcome = judged(tape)
        outcome.seconds = time.monotonic() - began
        return outcome

    def _learn(self, tape: Tape, steps: bool = False) -> str:
        """The columns from the clean run, or from the file; returns why there are none."""
        channels = self.stand.channels()
        if self.options.columns is not None and self.options.columns.exists():
            self.columns = Columns.load(self.options.columns, channels)
        else:
            try:
                rows = [said for said in tape.rows if said.t > tape.on]
                self.columns = learn(rows, tape.samples, tape.frames, channels, self.options.seed, steps)
            except Unlearnable as why:
                return f"no row can be judged: {why}"
            if self.options.columns is not None:
                self.columns.save(self.options.columns)
        if self.columns.values:
            return ""
        names = ", ".join(column.name for column in self.columns.columns[:8])
        return f"no row is a reading that was sent: none of the columns {names} follows a channel of the device"

    def _sample_faster(self) -> None:
        """So fast that each answer holds a sample of its own."""
        own = 1.0 / self.stand.period_s
        wide = max((len(sample.counts) for sample in self.stand.recorder.samples[-1:]), default=1)
        hz = min(1000.0, MOST_COUNTS / max(1, wide), 6.0 / max(1e-4, self.facts.row_s))
        if hz > 1.2 * own:
            self.stand.speed_up(round(hz))
            time.sleep(0.1)

    def _rows_since(self, t: int) -> int:
        assert self.driver is not None
        return sum(said.t > t for said in self.driver.rows[-5000:])

    def _collect(self, since: int, rows: int, seconds: float) -> None:
        assert self.driver is not None
        began = time.monotonic()
        while self.driver.exit is None and not self.driver.flooded:
            time.sleep(LOOK_S)
            count, took = self._rows_since(since), time.monotonic() - began
            if count >= rows or took > SLOW_S or (took > seconds and count >= min(rows, ENOUGH_ROWS)):
                return

    def _clean_tape(self, on: int) -> Tape:
        tape = self._tape(on - round(BEFORE_S * 1e9))
        tape.name, tape.on = "clean", on
        tape.off = tape.end = time.monotonic_ns()
        tape.trial = {"name": "clean", "action": "clean", "why": "nothing is wrong", "recovers": False}
        return tape

    def _nothing(self, why: str) -> Outcome:
        tape = Tape("clean", {"name": "clean", "action": "clean"}, asdict(self.known), trouble=why)
        if self.driver is not None:
            tape.rows, tape.notes = self.driver.rows[:50], self.driver.notes[:50]
            tape.exit = self.driver.exit
        self._write(tape)
        return judged(tape)

    # -- a trial -------------------------------------------------------------------------------------------------------

    def record(self, trial: Trial, keep: bool = True) -> Tape:
        """Have it happen; the tape of it."""
        self.say(trial.name)
        tape = Tape(trial.name, trial.as_dict(), asdict(self.known), self.columns.as_dict())
        why = self._wrap(trial) if trial.action == "wrap" else self._ready()
        if why:
            tape.trouble = why
            return tape
        driver = self.driver
        assert driver is not None
        unread, events = self.stand.recorder.unread, len(driver.notes)
        on = self.stand.begin(trial)
        try:
            if trial.action == "stop":
                driver.stop(True)
            self._wait_for_edits(trial, on)
        finally:
            if trial.action == "stop":
                driver.stop(False)
            off = self.stand.finish()
        changes = [change.t for change in self.stand.recorder.changes[-2000:] if on <= change.t]
        off = max(changes, default=off) if trial.faults and not trial.action else off
        self._wait_until_well(off, trial)
        found = self._tape(on - round(BEFORE_S * 1e9))
        found.name, found.trial = tape.name, tape.trial
        found.on, found.off, found.end = on, off, time.monotonic_ns()
        found.exit, found.unread = driver.exit, self.stand.recorder.unread - unread
        if driver.flooded:
            found.trouble = "floods: it prints more than 8 MB in 5 s that is no reading"
        found.notes = [note for note in driver.notes[events:] if note.t > on]
        found = self._filled(found)
        if keep:
            self._write(found)
        return found

    def _wait_for_edits(self, trial: Trial, on: int) -> None:
        """Until the action is over and every edit was made, or no more frames come."""
        assert self.driver is not None
        end = time.monotonic() + trial.seconds
        longest = end + 3 * trial.takes_s + 1.0 + self._longest
        recorder = self.stand.recorder
        edits = _edits(trial)
        progress, seen = time.monotonic(), 0
        while self.driver.exit is None and not self.driver.flooded and time.monotonic() < longest:
            now = time.monotonic()
            made = sum(change.t >= on for change in recorder.changes[-2000:])
            if made > seen:
                progress, seen = now, made
            if now >= end and (made >= edits or now - progress > self._patience + 8 * self.facts.row_s):
                return
            time.sleep(min(LOOK_S / 2, max(0.001, end - now)) if now < end else LOOK_S / 4)

    @property
    def _patience(self) -> float:
        return max(self.options.patience_s, 14 * self.facts.row_s, 1.5e-3 * self.known.p99_ms + 0.5)

    def _wait_until_well(self, off: int, trial: Trial) -> None:
        assert self.driver is not None
        driver, patience = self.driver, self._patience
        if self._well(off, patience) or driver.exit is not None:
            time.sleep(0.03 + 0.5 * self.facts.row_s)  # for a row that is on its way, and last words
            return
        if not any(said.t > off for said in driver.rows[-100:]) and self._longest > patience:
            # It says nothing at all: it may wait for a time-out of its own. One is waited for, once.
            begun = time.monotonic()
            if self._well(off, self._longest - patience):
                self.options = replace(self.options, patience_s=1.5 * (patience + time.monotonic() - begun))
            else:
                self._longest = patience

    def _wrap(self, trial: Trial) -> str:
        """Start the driver so that the counter is full soon after it reads well."""
        bits = next((bits for name, bits in self.facts.rollovers if name == trial.preset), 16)
        start_s = max(self.starts[-3:], default=0.5)
        ahead = start_s + self.options.rest_s + 0.7 + 14 * self.facts.row_s
        frames = round(ahead / max(1e-4, self.facts.period_s))
        if frames >= 1 << bits:
            return self._ready()  # it is full several times anyway
        self.end()
        self.stand.preset(trial.preset, bits, frames)
        if why := self.start():
            return why
        return "" if self._well(time.monotonic_ns(), 2.0) else "died: does not read well after a new start"

    # -- tapes ---------------------------------------------------------------------------------------------------------

    def _tape(self, since: int) -> Tape:
        """What was seen since a time, on both sides."""
        recorder, driver = self.stand.recorder, self.driver
        tape = Tape()
        if driver is not None:  # rows first: no row is there before its sample
            tape.rows, tape.notes = _since(driver.rows, since), _since(driver.notes, since)
            tape.weights = _since(driver.weights, since)
            tape.exit = driver.exit
        tape.samples, tape.frames = _since(recorder.samples, since), _since(recorder.frames, since)
        tape.changes = _since(recorder.changes, since)
        return tape

    def _filled(self, tape: Tape) -> Tape:
        tape.known, tape.columns = asdict(self.known), self.columns.as_dict()
        tape.late_ms = late_ms(tape)
        return tape

    def _write(self, tape: Tape) -> None:
        if self.options.record is not None:
            try:
                self.options.record.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise TactemuError(f"{self.options.record}: cannot be made: {error.strerror}") from None
            name = tape.name.replace(" ", "-")
            tape.write(self.options.record / f"{self._numbers:02d}-{name}.jsonl")
            self._numbers += 1


def late_ms(tape: Tape) -> float:
    """How late our own loop was with the samples of a tape, but for one in a hundred, beyond the quickest [ms]."""
    at = {sample.number: sample.t for sample in tape.samples}
    waits = sorted(
        f.t - at[f.sample]
        for f in tape.frames
        if f.way == "tx" and not f.answer and f.sample in at and f.t >= tape.on and tape.on
    )
    return (waits[len(waits) * 99 // 100] - waits[0]) / 1e6 if waits else 0.0


def _since(entries: list, t: int) -> list:
    """Entries from a time on; they are in the order of time, and another thread adds more."""
    entries = list(entries)
    low, high = 0, len(entries)
    while low < high:
        middle = (low + high) // 2
        low, high = (middle + 1, high) if entries[middle].t < t else (low, middle)
    return entries[low:]


def _edits(trial: Trial) -> int:
    """How many frames the trial's faults hit in all."""
    count = 0
    for fault in trial.faults:
        words = fault.split()
        if "frame" in words:
            for part in words[words.index("frame") + 1].split(","):
                first, _, last = part.partition("-")
                count += int(last or first) - int(first) + 1
    return count
