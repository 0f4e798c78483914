"""Mutation tests: each defect is put into a copy of the tree, and the test that it names must fail.

The mutants alter what no golden frame shows: the loop's accounting, timers, clocks, statistics, the timing of lines and
the counts of the log. The tests that they name must pass in the unaltered copy, which is tried first.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

TREE = Path(__file__).parent.parent
COPIED = "tactemu", "firmware_protocols", "tests", "benchmarks", "docs", "examples", "scripts", "pyproject.toml"
"""Folders and files of the tree that the tests need."""
PASSED, FAILED = 0, 1
"""Exit codes of pytest: all tests passed, or some failed; any other is no verdict."""
MAX_SECONDS = 300
"""Maximum time of one run of pytest [s]; a mutant that exceeds it counts as killed, because its loop never ends."""


class Mutant(NamedTuple):
    """One defect: a replacement in one file, and the test that must fail with it."""

    name: str
    """The defect in words, a part of which chooses the mutant."""
    file: str
    old: str
    """The text that it replaces; it occurs once in the file."""
    new: str
    test_file: str
    test: str
    """The name of the test that must fail, in one of its cases at least."""

    @property
    def test_id(self) -> str:
        """The test as pytest takes it."""
        return f"{self.test_file}::{self.test}"


LOOP = "tests/emulator/test_loop.py"
SAMPLING = "tests/emulator/test_sampling.py"
CLOCKS = "tests/emulator/test_lockstep.py"
STATISTICS = "tests/emulator/test_statistics.py"
CAN_BITS = "tests/wire/test_can_bits.py"
UART = "tests/wire/test_uart.py"
PACING = "tests/wire/test_pacing.py"
TRUTH = "tests/truth/test_truth.py"

MUTANTS = (
    # -- the loop's accounting -----------------------------------------------------------------------------------------
    Mutant(
        "missed: one more whenever late",
        "tactemu/emulator/emulator.py",
        "missed = max(0, past_ns // timer.sampling.period_ns)",
        "missed = max(0, past_ns // timer.sampling.period_ns + 1)",
        LOOP,
        "test_a_stall_misses_the_samples_that_are_late_by_a_period_and_no_other",
    ),
    Mutant(
        "missed: counted, but made up",
        "tactemu/emulator/emulator.py",
        "timer.next(missed)",
        "timer.next(0)",
        LOOP,
        "test_a_stall_misses_the_samples_that_are_late_by_a_period_and_no_other",
    ),
    Mutant(
        "restart: the first sample after a new period is skipped",
        "tactemu/emulator/emulator.py",
        "if timer.running and timer.due_ns == due:",
        "if timer.running:",
        LOOP,
        "test_a_device_that_changes_its_period_with_a_sample_skips_none",
    ),
    Mutant(
        "silent: a sample at the end of a hang",
        "tactemu/emulator/emulator.py",
        "if due < channel.silent_until_ns:",
        "if due <= channel.silent_until_ns:",
        LOOP,
        "test_a_hang_ends_at_its_time_and_a_shorter_one_does_not_end_it",
    ),
    Mutant(
        "silent: a shorter hang ends a longer one",
        "tactemu/emulator/actions.py",
        "channel.silent_until_ns = max(channel.silent_until_ns, until_ns)",
        "channel.silent_until_ns = until_ns",
        LOOP,
        "test_a_hang_ends_at_its_time_and_a_shorter_one_does_not_end_it",
    ),
    Mutant(
        "stretched: only the last sample",
        "tactemu/emulator/emulator.py",
        "channel.statistics.stretched += self",
        "channel.statistics.stretched = self",
        LOOP,
        "test_only_samples_late_by_a_period_take_few_steps_and_each_is_counted",
    ),
    Mutant(
        "deadlines: a late sample takes all steps",
        "tactemu/emulator/emulator.py",
        "most = self.catch_up_steps if is_late else max(",
        "most = max(",
        LOOP,
        "test_only_samples_late_by_a_period_take_few_steps_and_each_is_counted",
    ),
    # -- timers of streams ---------------------------------------------------------------------------------------------
    Mutant(
        "refresh: by our clock, not the device's",
        "tactemu/emulator/channel.py",
        "number = self.local_ns(t_ns) // self.refresh_ns",
        "number = t_ns // self.refresh_ns",
        LOOP,
        "test_registers_are_refreshed_by_the_devices_own_clock",
    ),
    Mutant(
        "burst: readings not evenly spaced",
        "tactemu/emulator/channel.py",
        "* left // self.burst",
        "* left // (self.burst + 1)",
        LOOP,
        "test_a_burst_is_spread_evenly_over_the_period",
    ),
    Mutant(
        "timer: no sample is left out by the device",
        "tactemu/emulator/channel.py",
        "self.sampling.first_taken(count) if self.sampling.missed else count",
        "count",
        LOOP,
        "test_a_firmware_that_leaves_samples_out_takes_the_others_on_time",
    ),
    Mutant(
        "alarm: by our clock, not the device's",
        "tactemu/emulator/sampling.py",
        "return self.start_ns + counted + (self._lateness_ns(counted) if counted > 0 else 0)",
        "return self.start_ns + counted",
        SAMPLING,
        "test_an_alarm_rings_when_the_devices_clock_shows_its_time",
    ),
    # -- clocks --------------------------------------------------------------------------------------------------------
    Mutant(
        "drift: a second restart counts the first one's time again",
        "tactemu/emulator/sampling.py",
        "seconds = max(0, start_ns - self.start_ns) * 1e-9",
        "seconds = max(0, start_ns) * 1e-9",
        SAMPLING,
        "test_the_skew_has_grown_by_the_time_since_the_last_change_of_rate",
    ),
    Mutant(
        "drift: an oscillator without a bound",
        "tactemu/emulator/sampling.py",
        "counted * max(ppm, -1e5)",
        "counted * ppm",
        SAMPLING,
        "test_an_oscillator_that_drifts_for_long_stays_within_a_tenth",
    ),
    Mutant(
        "virtual clock: a deadline of the past turns time back",
        "tactemu/base/clock.py",
        "self._now = max(self._now, deadline_ns)",
        "self._now = deadline_ns",
        CLOCKS,
        "test_a_deadline_of_the_past_does_not_turn_time_back",
    ),
    Mutant(
        "lockstep clock: an earlier end takes time back",
        "tactemu/base/clock.py",
        "self._end = max(self._end, until_ns)",
        "self._end = until_ns",
        CLOCKS,
        "test_an_earlier_end_changes_nothing",
    ),
    Mutant(
        "lockstep clock: a deadline beyond its end",
        "tactemu/base/clock.py",
        "min(deadline_ns, self._end)",
        "deadline_ns",
        CLOCKS,
        "test_time_goes_on_to_its_end_and_no_further",
    ),
    # -- statistics ----------------------------------------------------------------------------------------------------
    Mutant(
        "lateness: percentile over unused slots",
        "tactemu/base/statistics.py",
        "kept = self._values[: min(self.count, len(self._values))]\n        if not",
        "kept = self._values\n        if not",
        STATISTICS,
        "test_percentiles_are_those_of_the_deadlines_so_far",
    ),
    Mutant(
        "lateness: the oldest values stay",
        "tactemu/base/statistics.py",
        "self._values[self.count % len(self._values)]",
        "self._values[min(self.count, len(self._values) - 1)]",
        STATISTICS,
        "test_percentiles_are_over_the_latest_values_and_the_maximum_over_all",
    ),
    Mutant(
        "lateness: a copy that changes with its original",
        "tactemu/base/statistics.py",
        "self._values[: max(kept, 1)].copy()",
        "self._values[: max(kept, 1)]",
        STATISTICS,
        "test_a_copy_keeps_the_values_of_its_time",
    ),
    Mutant(
        "lateness: another percentile under the name p99",
        "tactemu/base/statistics.py",
        "self.lateness.percentile_ns(99)",
        "self.lateness.percentile_ns(95)",
        STATISTICS,
        "test_every_figure_is_under_its_name",
    ),
    # -- lines ---------------------------------------------------------------------------------------------------------
    Mutant(
        "CAN-FD: the short CRC up to 20 bytes",
        "tactemu/wire/can_bits.py",
        "if size <= 16",
        "if size <= 20",
        CAN_BITS,
        "test_fd_stuff_bits_bit_by_bit",
    ),
    Mutant(
        "CAN: a short error frame",
        "tactemu/wire/can_bits.py",
        "_ERROR_FRAME = 6 + 6 + 8",
        "_ERROR_FRAME = 6 + 8",
        CAN_BITS,
        "test_an_error_frame_adds_two_flags_and_a_delimiter",
    ),
    Mutant(
        "serial: one and a half stop bits as one",
        "tactemu/wire/uart.py",
        "math.ceil(sent.stopbits)",
        "int(sent.stopbits)",
        UART,
        "test_one_and_a_half_stop_bits_are_a_gap_too",
    ),
    Mutant(
        "line: busy with what it has settled",
        "tactemu/wire/line.py",
        "        self.free_ns = min(self.free_ns, now_ns)\n",
        "",
        PACING,
        "test_a_line_that_has_settled_is_free_at_once",
    ),
    # -- the log -------------------------------------------------------------------------------------------------------
    Mutant(
        "log: frames that leave together count as one",
        "tactemu/truth/truth.py",
        'self.counts["tx"] += len(frames)',
        'self.counts["tx"] += 1',
        TRUTH,
        "test_frames_that_leave_together_count_one_by_one",
    ),
    Mutant(
        "log: a skin has the faults of all whose names contain its own",
        "tactemu/truth/truth.py",
        'device == name or device in name.split("+")',
        "device in name",
        TRUTH,
        "test_faults_belong_to_a_skin_and_its_bus_not_to_names_that_contain_its_own",
    ),
)


def copy_tree(folder: Path) -> None:
    """Copy what the tests need into a folder, without compiled files."""
    for name in COPIED:
        source = TREE / name
        if source.is_dir():
            shutil.copytree(source, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy2(source, folder / name)


def altered(mutant: Mutant, text: str) -> str:
    """Return the text of the mutant's file with the defect.

    Raises:
        ValueError: the text that it replaces is not there, or more than once.
    """
    if (count := text.count(mutant.old)) != 1:
        raise ValueError(f"{mutant.name}: expected {mutant.old!r} once in {mutant.file}, got {count} times; adapt it")
    return text.replace(mutant.old, mutant.new)


def run_tests(folder: Path, tests: Iterable[str]) -> tuple[int, str]:
    """Run tests in a copy of the tree; return pytest's exit code and its last lines."""
    environment = {**os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    options = ["-x", "-q", "-p", "no:cacheprovider"]
    try:
        done = subprocess.run(
            [sys.executable, "-m", "pytest", *options, *tests],
            cwd=folder, env=environment, capture_output=True, text=True, timeout=MAX_SECONDS, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return FAILED, f"no end after {MAX_SECONDS} s"
    found = re.search(r"^(FAILED|ERROR) (\S+)", done.stdout, re.MULTILINE)
    return done.returncode, found[2] if found else (done.stdout + done.stderr)[-500:]


def is_killed(folder: Path, mutant: Mutant) -> tuple[bool, str]:
    """Return True and the test that fails, or False, with the defect in the copy of the tree, which is then restored.

    Raises:
        RuntimeError: pytest could not run the tests.
        ValueError: the mutant's text is not in its file.
    """
    file = folder / mutant.file
    text = file.read_text()
    file.write_text(altered(mutant, text))
    try:
        code, end = run_tests(folder, [mutant.test_id])
    finally:
        file.write_text(text)
    if code not in (PASSED, FAILED):
        raise RuntimeError(f"{mutant.name}: pytest ended with {code}: {end}")
    return code == FAILED, end if code == FAILED else ""


def run(echo: Callable[[str], None], only: str = "") -> bool:
    """Try every mutant, or those whose names contain ``only``; return True if all are killed.

    Raises:
        RuntimeError: a test fails without a mutant, or pytest could not run it.
        ValueError: a mutant's text is not in its file, or no mutant is chosen.
    """
    chosen = [mutant for mutant in MUTANTS if only in mutant.name]
    if not chosen:
        raise ValueError(f"no mutant's name contains {only!r}; names: {'; '.join(mutant.name for mutant in MUTANTS)}")
    for mutant in chosen:  # before anything takes time
        altered(mutant, (TREE / mutant.file).read_text())
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        copy_tree(folder)
        code, end = run_tests(folder, dict.fromkeys(mutant.test_id for mutant in chosen))
        if code != PASSED:
            raise RuntimeError(f"the tests must pass without a mutant, but pytest ended with {code}: {end}")
        lived = 0
        for mutant in chosen:
            killed, test = is_killed(folder, mutant)
            lived += not killed
            echo(f"killed  {mutant.name}  ({test})" if killed else f"LIVED   {mutant.name}")
    echo(f"{len(chosen) - lived} of {len(chosen)} mutants are killed")
    return not lived
