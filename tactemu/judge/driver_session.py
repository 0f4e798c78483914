"""A driver at its device: start, observation and end of its process, and records of what both sides did."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Self

from tactemu.base.errors import TactemuError
from tactemu.base.files import check_folder, check_writable
from tactemu.judge.budget import Budget
from tactemu.judge.columns import Columns
from tactemu.judge.driver import Driver, command_of
from tactemu.judge.driver_rig import DriverRig
from tactemu.judge.lateness import DriverTimeout, late_ms
from tactemu.judge.options import JudgeOptions
from tactemu.judge.outcome import CleanRun
from tactemu.judge.plan import LineFacts, Trial
from tactemu.judge.row_tracking import RowTracker, left_times, recovered
from tactemu.judge.trial_counts import shortened, without_tracebacks
from tactemu.judge.trial_record import SIGN, TrialRecord

POLL_PERIOD_S = 0.02
"""Time between two checks of the driver's output [s]."""
SILENT_TIMEOUT_S = 8.0
"""Time in which a silent driver may recover, granted once, since it may have a long timeout of its own [s]."""


class DriverSession:
    """One driver at one device; use it in a ``with`` statement.

    Args:
        target: a device's name, a device file, or a scene file.
        command: of the driver, with ``{port}`` for the port.
        options: of the run.
        report_progress: called with a description of each step.
    """

    def __init__(
        self,
        target: str,
        command: Sequence[str],
        options: JudgeOptions | None = None,
        report_progress: Callable[[str], object] = lambda text: None,
    ):
        self.target, self.command, self.report_progress = target, list(command), report_progress
        opts = self.options = options or JudgeOptions()
        self.budget = Budget(opts.budget_s)
        self.rig = DriverRig(target, opts.port, seed=opts.seed, options=opts.device_options, rate_hz=opts.rate_hz)
        self.driver: Driver | None = None
        self.columns, self.known, self.facts = Columns(), CleanRun(), LineFacts()
        self.starts: list[float] = []
        """Times from each start of the driver to its first row [s]."""
        self.waiting: list[Trial] = []
        """The trials that have not ended."""
        self.is_command_wrong = False
        """True if the driver ended at its first start, before it opened the port or printed a reading."""
        self.left_behind = 0
        """Largest number of processes that had left the driver's session."""
        self._silent_timeout_s = SILENT_TIMEOUT_S
        self._numbers = 0

    def __enter__(self) -> Self:
        check_folder(self.options.record, "the recorded trials", ("[0-9]*-*.jsonl",), SIGN)
        if self.options.columns is not None and not self.options.columns.exists():
            check_writable(self.options.columns, "the columns")
        self.rig.__enter__()
        return self

    def __exit__(self, *_) -> None:
        try:
            self.end()
        finally:
            self.rig.__exit__()

    # -- start and end -------------------------------------------------------------------------------------------------

    def end(self) -> None:
        """End the driver and all processes that it started."""
        if self.driver is not None:
            self.left_behind = max(self.left_behind, self.driver.end())
            self.driver = None

    def start(self) -> str:
        """Start the driver anew and let it tare; return why it prints no rows, "" if it does.

        Raises:
            TactemuError: the command cannot be run at its first start.
        """
        self.end()
        self.is_command_wrong = False
        self.rig.release()
        ports = self.rig.ports
        try:
            driver = self.driver = Driver(command_of(self.command, ports), ports)
        except TactemuError as error:
            if not self.starts:  # the command is wrong, and not the driver
                raise
            return f"died: {error}"
        timeout = DriverTimeout(self.options.start_s)
        while not driver.rows and driver.exit is None and not driver.flooded and not timeout.is_over():
            self.budget.sleep(POLL_PERIOD_S / 2)
        if not driver.rows:
            return self._why_silent(driver)
        self.starts.append((driver.rows[0].t_ns - driver.started) / 1e9)
        end = time.monotonic() + self.options.no_contact_s
        while time.monotonic() < end and driver.exit is None and not driver.flooded:
            self.budget.sleep(POLL_PERIOD_S)
        self.rig.excite(self.columns.steps)
        time.sleep(0.1 + 2 * self.facts.row_s)
        if driver.flooded or driver.exit is not None:
            return self._why_silent(driver)
        return ""

    def _why_silent(self, driver: Driver) -> str:
        time.sleep(0.05)  # for its last messages
        last = [shortened(text) for text in without_tracebacks([note.text for note in driver.notes])[-3:]]
        words = f": {' | '.join(last)}" if last else ""
        if driver.flooded:
            return "floods: it prints more than 8 MB in 5 s that is no reading"
        if driver.exit is not None:
            self.is_command_wrong = not (self.starts or driver.rows or self.rig.recorder.was_opened)
            if self.is_command_wrong:
                words += " (it ends before it reads anything: the command is likely wrong)"
            return f"exits with status {driver.exit} before it is judged{words}"
        if driver.notes:
            return f"prints nothing that holds numbers within {self.options.start_s:g} s{words}"
        silent = "" if self.rig.recorder.was_opened else ", and does not open the port"
        return f"prints nothing within {self.options.start_s:g} s{silent}"

    def _recovers(self, since: int, seconds: float, tracker: RowTracker | None = None) -> bool:
        """Return True once ten consecutive right rows have come for samples after ``since``, False after a timeout.

        The timeout is extended by the time for which the driver and this process wait for a processor, within limits.
        """
        assert self.driver is not None
        tracker = tracker or RowTracker(self.columns, self.known)
        timeout = DriverTimeout(seconds)
        while True:
            record = self._observed(since - 500_000_000)
            fresh = RowTracker(self.columns, self.known)
            fresh.feed(record)
            if recovered(record, fresh.matches, self.known, since, left_times(record)) is not None:
                return True
            if self.driver.exit is not None or timeout.is_over():
                return False
            self.budget.sleep(POLL_PERIOD_S + 0.5 * self.facts.row_s)

    def _ensure_reading(self) -> str:
        """Make sure that the driver reads correctly, with a new start if needed; return why it does not, "" if so."""
        now = time.monotonic_ns()
        if (
            self.driver is not None
            and self.driver.exit is None
            and self._recovers(now - 50_000_000, 1.0 + 12 * self.facts.row_s)
        ):
            return ""
        for _ in range(2):  # a busy machine may make the first attempt fail
            if why := self.start():
                return why
            if self._recovers(time.monotonic_ns(), 2.0 + 12 * self.facts.row_s):
                return ""
        return "died: prints no right rows after a new start"

    def _rows_since(self, t: int) -> int:
        assert self.driver is not None
        return sum(printed.t_ns > t for printed in self.driver.rows[-5000:])

    # -- records -----------------------------------------------------------------------------------------------------

    def _observed(self, since: int) -> TrialRecord:
        """Return a record of both sides since a time."""
        recorder, driver = self.rig.recorder, self.driver
        record = TrialRecord()
        if driver is not None:  # rows first, so that the sample of each row is there
            record.rows, record.notes = _since(driver.rows, since), _since(driver.notes, since)
            record.resource_usage = _since(driver.resource_usage, since)
            record.exit = driver.exit
        record.samples, record.frames = _since(recorder.samples, since), _since(recorder.frames, since)
        record.injected_faults = _since(recorder.injected_faults, since)
        return record

    def _complete(self, record: TrialRecord) -> TrialRecord:
        record.known, record.columns = asdict(self.known), self.columns.as_dict()
        record.late_ms = late_ms(record, self.driver.delays if self.driver is not None else ())
        return record

    def _write(self, record: TrialRecord) -> None:
        if self.options.record is not None:
            self.options.record.mkdir(parents=True, exist_ok=True)
            name = record.name.replace(" ", "-")
            record.write(self.options.record / f"{self._numbers:02d}-{name}.jsonl")
            self._numbers += 1


def _since(entries: list, t: int) -> list:
    """Return the entries from a time on; they are sorted by time, and another thread may add more."""
    entries = list(entries)
    low, high = 0, len(entries)
    while low < high:
        middle = (low + high) // 2
        low, high = (middle + 1, high) if entries[middle].t_ns < t else (low, middle)
    return entries[low:]
