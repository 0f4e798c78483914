"""The judge of a driver: it learns the columns in a clean run, runs the trials, and confirms their findings."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import asdict, replace

from tactemu.judge import smallest_case
from tactemu.judge.budget import EVERY_POSITION_BUDGET_S, BudgetSpentError, ordered
from tactemu.judge.column_learning import UnlearnableError, learn
from tactemu.judge.columns import Columns
from tactemu.judge.driver_session import POLL_PERIOD_S, DriverSession
from tactemu.judge.excitation import STEP
from tactemu.judge.options import JudgeOptions
from tactemu.judge.outcome import ABOUT, CleanRun, Outcome
from tactemu.judge.plan import CLEAN, LineFacts, Plan, Trial
from tactemu.judge.rollover_counter import RolloverCounter
from tactemu.judge.trial_choice import chosen
from tactemu.judge.trial_record import TrialRecord
from tactemu.judge.verdicts import judge_record, measure_clean_run
from tactemu.truth import Injection

CLEAN_ROWS = 320
"""Number of rows after which the run without faults ends."""
CLEAN_TIMEOUT_S = 4.0
"""Time after which it ends with :data:`ENOUGH_ROWS` [s]."""
SLOW_TIMEOUT_S = 12.0
"""Time after which it ends with fewer [s]."""
ENOUGH_ROWS = 60
"""Number of rows that suffices when the time is over."""
MAX_HELD_SAMPLES = 24
"""Number of samples that are held for a driver that filters."""
HELD_SAMPLES_TIMEOUT_S = 12.0
"""Time after which the run with held samples ends with :data:`ENOUGH_ROWS` [s]."""
BEFORE_S = 3.0
"""Time before a trial that its record covers [s]."""
MAX_COUNTS_PER_S = 200_000
"""Maximum number of counts per second where a device is sampled faster than at its own rate; bounds the load."""


class Judge(DriverSession):
    """A judge of one driver at one device; use it in a ``with`` statement."""

    # -- all trials ----------------------------------------------------------------------------------------------------

    def run(self) -> Iterator[Outcome]:
        """Yield the outcome of the run without faults, then that of every trial as it ends."""
        outcome = self.clean()
        yield outcome
        if not self.columns.values:
            return
        self.waiting = self.plan()
        while self.waiting:
            outcome = self.judge(self.waiting[0])
            self.waiting.pop(0)
            yield outcome

    def left_out(self, why: str) -> Iterator[Outcome]:
        """Yield the outcomes of the trials that were not run; ``why`` is the reason where they have no other."""
        for trial in self.waiting:
            trial.skipped = trial.skipped or why
            yield judge_record(TrialRecord(trial.name, trial.as_dict()))

    def plan(self) -> list[Trial]:
        """Return the trials after the clean run, the most valuable first."""
        opts = self.options
        every = opts.every or (opts.budget_s or 0.0) >= EVERY_POSITION_BUDGET_S
        trials = ordered(Plan(self.facts, opts.seed, every).trials())
        return chosen(trials, opts.only) if opts.only else trials

    def judge(self, trial: Trial) -> Outcome:
        """Run a trial and confirm its findings; if edits of frames cause them, search for the smallest case."""
        expected = trial.takes_s + self._restart_s()
        if not trial.skipped:
            trial.skipped = self.budget.lacks(expected, times=2)
            trial.lacks_time = bool(trial.skipped)
        if trial.skipped:
            return judge_record(TrialRecord(trial.name, trial.as_dict()))
        began = time.monotonic()
        try:
            self.budget.begin()
            record = self.run_trial(trial)
        except BudgetSpentError:
            trial.skipped, trial.lacks_time = "the budget was spent during the trial", True
            return judge_record(TrialRecord(trial.name, trial.as_dict()))
        finally:
            self.budget.end(expected, time.monotonic() - began)
        outcome = judge_record(record)
        if outcome.has(*self.options.fail_on) and self.options.shrink:
            self._confirm(outcome, trial, record, time.monotonic() - began)
        return outcome

    def _confirm(self, outcome: Outcome, trial: Trial, record: TrialRecord, took_s: float) -> None:
        """Confirm a trial's findings by its smallest case or by a second run, as long as the budget lasts."""
        kinds = self.options.fail_on
        try:
            self.budget.begin(reserve_s=1.5 * took_s)
            if smallest_case.may_be(trial):
                outcome.case = smallest_case.find(
                    trial, record, outcome, self._repeat, self.target, self.command, kinds
                )
        except BudgetSpentError:
            self.report_progress("no time is left to search for the smallest case")
        outcome.confirmed = outcome.case is not None
        try:
            self.budget.begin()
            if not outcome.confirmed:
                outcome.seen_again(judge_record(self.run_trial(trial)), kinds)
        except BudgetSpentError:
            outcome.untried = "no time was left for a second run"
        finally:
            self.budget.end()

    def _repeat(self, trial: Trial) -> tuple[TrialRecord, Outcome]:
        record = self.run_trial(trial, keep=False)
        return record, judge_record(record)

    def _restart_s(self) -> float:
        """Return the time for a new start of the driver if it has ended, else 0 [s]."""
        if self.driver is not None and self.driver.exit is None:
            return 0.0
        return max(self.starts[-3:], default=0.5) + self.options.no_contact_s + 0.3 + 12 * self.facts.row_s

    # -- the run without faults ----------------------------------------------------------------------------------------

    def clean(self) -> Outcome:
        """Start the driver, learn its columns, and judge it without faults.

        A second run, with the driver started and learned anew, must confirm the findings.
        """
        began = time.monotonic()
        first = self._clean()
        kept = self.columns, self.known, self.facts
        if not first.findings or not self.options.shrink:
            return self._save_columns(first)
        if why := self.budget.lacks(1.2 * (time.monotonic() - began)):
            first.confirmed, first.untried = False, f"a second run {why}"
            return self._save_columns(first)
        self.report_progress("running without faults again")
        again = self._clean()
        if not again.findings:
            again.verdict += f" (not counted, as only the first of two runs showed it: {first.verdict})"
            return self._save_columns(again)
        nothing, nothing_again = not kept[0].values, not self.columns.values
        if nothing and nothing_again:
            again.confirmed = True
            return again
        if nothing or not nothing_again:
            again.seen_again(first, ABOUT)
            return self._save_columns(again)
        self.columns, self.known, self.facts = kept
        first.seen_again(again, ABOUT)
        return self._save_columns(first)

    def _save_columns(self, outcome: Outcome) -> Outcome:
        """Write the columns to the file of --columns if it does not exist, and return the outcome."""
        path = self.options.columns
        if path is not None and self.columns.values and not path.exists():
            self.columns.save(path)
        return outcome

    def _clean(self) -> Outcome:
        """Run once without faults, and return the outcome."""
        self.columns, self.known, self.facts = Columns(), CleanRun(), LineFacts()
        began = time.monotonic()
        if why := self.start():
            return self._unjudgeable(why)
        assert self.driver is not None
        self.report_progress("running without faults")
        time.sleep(0.3)
        since = time.monotonic_ns()
        self._collect(since, 12, 1.0)
        self.facts = self.rig.facts(since, self._rows_since(since))
        if self.facts.asks and not self.facts.sets_rate and not self.options.rate_hz:
            self._sample_faster()
        on = time.monotonic_ns()
        self._collect(on, CLEAN_ROWS, CLEAN_TIMEOUT_S)
        record = self._clean_record(on)
        if record.exit is None and (trouble := self._learn(record)):
            self.report_progress("running again with held samples, as the driver may filter")
            self.rig.excite(steps=True)
            on = time.monotonic_ns()
            self._collect(on, (MAX_HELD_SAMPLES + 2) * STEP, HELD_SAMPLES_TIMEOUT_S)
            record = self._clean_record(on)
            if record.exit is None and self._learn(record, steps=True):
                return self._unjudgeable(trouble)
        self.known = measure_clean_run(
            record, self.columns, asks=self.facts.asks, period_ms=1e3 * self.rig.period_s, numbered=self.facts.numbered
        )
        self.facts = self.rig.facts(on, self._rows_since(on))
        record = self._complete(record)
        if record.exit is not None:
            return self._unjudgeable(self._why_silent(self.driver))
        self._write(record)
        outcome = judge_record(record)
        outcome.seconds = time.monotonic() - began
        return outcome

    def _learn(self, record: TrialRecord, steps: bool = False) -> str:
        """Learn the columns from the clean run, or read them from their file; return why there are none, else ""."""
        channels = self.rig.channels()
        if self.options.columns is not None and self.options.columns.exists():
            self.columns = Columns.load(self.options.columns, channels)
        else:
            try:
                rows = [printed for printed in record.rows if printed.t_ns > record.on]
                self.columns = learn(rows, record.samples, record.frames, channels, self.options.seed, steps)
            except UnlearnableError as why:
                return f"no row can be judged: {why}"
        if self.columns.values:
            return ""
        names = ", ".join(column.name for column in self.columns.columns[:8])
        return f"no row is a reading that was sent: none of the columns {names} follows a channel of the device"

    def _sample_faster(self) -> None:
        """Raise the sampling rate so that each answer holds a new sample."""
        own = 1.0 / self.rig.period_s
        wide = max((len(sample.counts) for sample in self.rig.recorder.samples[-1:]), default=1)
        hz = min(1000.0, MAX_COUNTS_PER_S / max(1, wide), 6.0 / max(1e-4, self.facts.row_s))
        if hz > 1.2 * own:
            self.rig.speed_up(round(hz))
            time.sleep(0.1)

    def _collect(self, since: int, rows: int, seconds: float) -> None:
        assert self.driver is not None
        began = time.monotonic()
        while self.driver.exit is None and not self.driver.flooded:
            time.sleep(POLL_PERIOD_S)
            count, took = self._rows_since(since), time.monotonic() - began
            if count >= rows or took > SLOW_TIMEOUT_S or (took > seconds and count >= min(rows, ENOUGH_ROWS)):
                return

    def _clean_record(self, on: int) -> TrialRecord:
        record = self._observed(on - round(BEFORE_S * 1e9))
        record.name, record.on = CLEAN, on
        record.off = record.end = time.monotonic_ns()
        record.trial = {"name": CLEAN, "action": "clean", "why": "no fault", "recovers": False}
        return record

    def _unjudgeable(self, why: str) -> Outcome:
        record = TrialRecord(CLEAN, {"name": CLEAN, "action": "clean"}, asdict(self.known), trouble=why)
        if self.driver is not None:
            record.rows, record.notes = self.driver.rows[:50], self.driver.notes[:50]
            record.exit = self.driver.exit
        self._write(record)
        return judge_record(record)

    # -- a trial -------------------------------------------------------------------------------------------------------

    def run_trial(self, trial: Trial, keep: bool = True) -> TrialRecord:
        """Run a trial and return its record."""
        self.report_progress(trial.name)
        record = TrialRecord(trial.name, trial.as_dict(), asdict(self.known), self.columns.as_dict())
        counter = RolloverCounter(self.rig, trial.preset, self.budget.sleep) if trial.action == "wrap" else None
        record.trouble, why = self._bring_near_rollover(counter) if counter else (self._ensure_reading(), "")
        if record.trouble:
            return record
        if why:
            record.trial["skipped"] = why
            return record
        driver = self.driver
        assert driver is not None
        unread, events = self.rig.recorder.unread, len(driver.notes)
        on, off = self._inject(trial, counter)
        has_recovered = self._wait_for_recovery(off, trial)
        for _ in range(trial.times - 1):
            if has_recovered:
                _, off = self._inject(trial)
                has_recovered = self._wait_for_recovery(off, trial)
        found = self._observed(on - round(BEFORE_S * 1e9))
        found.name, found.trial = record.name, record.trial
        found.on, found.off, found.end = on, off, time.monotonic_ns()
        found.exit, found.unread = driver.exit, self.rig.recorder.unread - unread
        if driver.flooded:
            found.trouble = "floods: it prints more than 8 MB in 5 s that is no reading"
        found.notes = [note for note in driver.notes[events:] if note.t_ns > on]
        found = self._complete(found)
        if keep:
            self._write(found)
        return found

    def _inject(self, trial: Trial, counter: RolloverCounter | None = None) -> tuple[int, int]:
        """Inject the trial's faults and action once; return the times of its begin and of its end [ns]."""
        driver = self.driver
        assert driver is not None
        on = self.rig.begin(trial)
        try:
            if trial.action == "stop":
                driver.stop(True)
            if counter is not None:
                self._wait_for_wrap(counter, trial)
            else:
                self._wait_for_edits(trial, on)
        finally:
            if trial.action == "stop":
                driver.stop(False)
            off = self.rig.finish()
        changes = [change.t_ns for change in self.rig.recorder.injected_faults[-2000:] if on <= change.t_ns]
        return on, max(changes, default=off) if trial.faults and not trial.action else off

    def _wait_for_edits(self, trial: Trial, on: int) -> None:
        """Wait until the action is over and every edit is made, or no more frames come."""
        assert self.driver is not None
        end = time.monotonic() + trial.seconds
        longest = end + 3 * trial.takes_s + 1.0 + self._silent_timeout_s
        recorder = self.rig.recorder
        edits = sum(last - first + 1 for fault in trial.edits for first, last in fault.frames)
        progress, seen = time.monotonic(), 0
        while self.driver.exit is None and not self.driver.flooded and time.monotonic() < longest:
            now = time.monotonic()
            made = sum(change.t_ns >= on for change in recorder.injected_faults[-2000:])
            if made > seen:
                progress, seen = now, made
            if now >= end and (made >= edits or now - progress > self._recovery_timeout_s + 8 * self.facts.row_s):
                return
            self.budget.sleep(min(POLL_PERIOD_S / 2, max(0.001, end - now)) if now < end else POLL_PERIOD_S / 4)

    @property
    def _recovery_timeout_s(self) -> float:
        return max(self.options.patience_s, 14 * self.facts.row_s, 1.5e-3 * self.known.p99_ms + 0.5)

    def _wait_for_recovery(self, off: int, trial: Trial) -> bool:
        """Return True once the driver has recovered, or False after the timeout."""
        assert self.driver is not None
        driver, timeout_s = self.driver, self._recovery_timeout_s
        has_recovered = self._recovers(off, timeout_s)
        if has_recovered or driver.exit is not None:
            time.sleep(0.03 + 0.5 * self.facts.row_s)  # for a row on its way, and for last messages
            return has_recovered
        if not any(printed.t_ns > off for printed in driver.rows[-100:]) and self._silent_timeout_s > timeout_s:
            # A silent driver may wait for a long timeout of its own. The judge waits for it once.
            begun = time.monotonic()
            has_recovered = self._recovers(off, self._silent_timeout_s - timeout_s)
            if has_recovered:
                self.options = replace(self.options, patience_s=1.5 * (timeout_s + time.monotonic() - begun))
            else:
                self._silent_timeout_s = timeout_s
        return has_recovered

    def _bring_near_rollover(self, counter: RolloverCounter) -> tuple[str, str]:
        """Start the driver and bring the counter close to its rollover while the driver reads correctly.

        Return why the driver does not read, and why the counter cannot be brought there; both "" on success.
        """
        trouble, why = "", ""
        own_s = 0.4 + 20 * self.facts.row_s + 20e-3 * self.known.p99_ms
        for slack_s in (own_s, 3 * own_s):  # a busy machine may need more time than the driver showed before
            self.end()
            counter.set_ahead(max(self.starts[-3:], default=0.5) + self.options.no_contact_s + 0.3 + 2 * slack_s)
            if trouble := self.start():
                return trouble, ""
            if not self._recovers(time.monotonic_ns(), 2.0 + slack_s):
                trouble = "died: prints no right rows after a new start"
                continue
            why = counter.bring_near(slack_s, 2.0 + 2 * slack_s)
            if not why and (not counter.jumps or self._recovers(time.monotonic_ns(), slack_s)):
                return "", ""
        return trouble, why or f"the driver does not read on when the {counter.name} jumps"

    def _wait_for_wrap(self, counter: RolloverCounter, trial: Trial) -> None:
        """Wait until the counter has rolled over, and record that as an injected fault."""
        driver = self.driver
        assert driver is not None
        if passed := counter.wait_until_full(lambda: driver.exit is None, trial.seconds):
            before, after = map(str, passed)
            change = Injection(time.monotonic_ns(), "", "wrap", f"{counter.name} wraps", before, (after,))
            self.rig.recorder.injected_faults.append(change)


__all__ = ["Judge", "JudgeOptions"]
