"""``python -m tests.judge.planted [WORD...]``: judge drivers with planted mistakes; each mistake must be named.

A row is a mistake in a driver, and the kind of finding that the judge must report. WORDs choose rows: those in which
each word is the line, the driver, the mistake or an expected kind (``planted udp``, ``planted udp scale``). The command
runs one judge after the other, in real time, and prints a table; it fails when fewer than 95 % of the rows are named.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import signal
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from pathlib import Path

from tactemu import cli

DRIVERS_FOLDER = Path(__file__).with_name("drivers")
REQUIRED_SHARE = 0.95
ROW_TIMEOUT_S = 300.0
"""Longest time for one row; a judge that hangs is a row that is not named."""
STOP_TIMEOUT_S = 10.0
"""Time that an interrupted judge has to end its driver."""


@dataclass(frozen=True)
class Driver:
    """A script in ``drivers``, and the device that it reads."""

    line: str
    script: str
    device: str
    options: tuple[str, ...] = ()
    """JudgeOptions of the device."""
    words: tuple[str, ...] = ("{port}",)
    """Arguments of the script behind the variant."""
    port: str | None = None

    def command(self, variant: str) -> list[str]:
        """Return the command line of the driver, with the port left open."""
        return [sys.executable, str(DRIVERS_FOLDER / self.script), variant, *self.words]


DRIVERS = {
    "stream": Driver("stream", "over_stream.py", "optoforce", ("axes=6",), ("{port}", "6")),
    "polled": Driver("polled", "over_polled.py", "weiss_wts"),
    "letters": Driver("polled", "over_letters.py", "dynpick"),
    "resultant": Driver("polled", "over_resultant.py", "paxini_px6ax"),
    "modbus": Driver("modbus", "over_modbus.py", "dfrobot_tactile"),
    "wrench": Driver("modbus", "over_modbus.py", "robotiq_ft300", ("streams=false",), ("{port}", "ft300")),
    "tcp": Driver("tcp", "over_tcp.py", "inspire_rh56dftp", port="tcp:127.0.0.1:0"),
    "can": Driver("can", "over_can.py", "xela_uskin"),
    "hand": Driver("can", "over_can_hand.py", "dexrobot_dexhand", words=("{interface}", "{channel}")),
    "gauges": Driver("can", "over_can_asked.py", "ati_netcanoem"),
    "udp": Driver("udp", "over_udp.py", "ati_net_ft", ("records_per_second=125",)),
    "records": Driver("udp", "over_udp.py", "ati_net_ft", ("records_per_second=125",), ("{port}", "asked")),
}

NO_FAULT = ("clean",)
OUTAGES = ("hang", "silence", "unplug")
MISTAKES: list[tuple[str, str, Sequence[str], str]] = [
    # variant: what is wrong; kinds that name it; trials that can show it; drivers in which it is planted
    ("mask: upper bits lost", "wrong", NO_FAULT, "stream polled modbus can udp"),
    ("clip: values stop at a limit", "clipped", NO_FAULT, "stream polled modbus wrench can hand udp"),
    ("unsigned: sign lost", "wrong", NO_FAULT, "stream wrench gauges udp"),
    ("magnitude: sign dropped", "wrong", NO_FAULT, "stream letters wrench gauges udp"),
    ("endian: bytes of one value turned", "wrong", NO_FAULT, "stream polled modbus can udp"),
    ("ten: ten times the unit", "scale", NO_FAULT, "stream wrench hand udp"),
    ("thousand: a thousand times the unit", "scale", NO_FAULT, "letters wrench hand udp"),
    ("kilogram: kilograms for newtons", "scale", NO_FAULT, "stream letters hand udp"),
    ("percent: three percent too large", "scale", NO_FAULT, "letters udp"),
    ("flip: sign of the last axis turned", "scale|order|wrong", NO_FAULT, "stream letters wrench udp"),
    ("exchanged: two axes exchanged", "order", NO_FAULT, "stream letters wrench can hand udp"),
    ("missing: last channel not handed out", "unread", NO_FAULT, "stream polled modbus can udp"),
    ("halfmissing: half of the channels not handed out", "unread", NO_FAULT, "polled can"),
    ("zero: last channel always 0", "unread|clipped", NO_FAULT, "stream polled modbus can udp"),
    ("twice: last channel is the one before", "unread|order", NO_FAULT, "polled modbus can udp"),
    ("frozen: last channel stays at its first value", "unread|clipped", NO_FAULT, "stream letters wrench can udp"),
    ("frozenresultant: the resultant stays at its first value", "unread|clipped", NO_FAULT, "resultant"),
    ("before: always the answer before", "stale", NO_FAULT, "polled letters modbus wrench gauges records"),
    ("behind: always twenty readings late", "late", NO_FAULT, "stream can udp"),
    ("slow: takes longer than a period", "late|loses", NO_FAULT, "stream udp"),
    ("hundredth: each hundredth reading lost", "loses", NO_FAULT, "stream can udp"),
    ("leak: memory grows with readings", "leaks", ("high rate", "memory"), "stream polled modbus can udp"),
    ("leakforeign: memory grows with foreign frames", "leaks", ("foreign frames",), "can"),
    ("second: survives one outage, not two", "died|lost sync", (*OUTAGES, "bus off", "reset"),
     "stream polled modbus can udp"),
    ("wrap: dead when a counter is full", "lost sync", ("wraps",), "stream polled udp"),
    ("samplewrap: dead when the other counter is full", "lost sync", ("wraps",), "udp"),
    ("reordered: datagrams out of order", "again", ("reordered",), "udp"),
    ("old: an old datagram is new", "again", ("old frame",), "udp"),
    ("noresync: never looks for the head again", "lost sync|wrong",
     ("byte lost", "one cut", "garbage", "late answer"), "stream polled letters modbus"),
    ("stale: the last reading while nothing comes", "stale", OUTAGES, "stream can udp"),
    ("timeout: the last reading when no answer comes", "stale", ("dropped", "burst", *OUTAGES),
     "polled letters modbus gauges records"),
    ("nosum: no sum is checked", "wrong", ("flipped",), "stream"),
    ("nocrc: no CRC is checked", "wrong", ("flipped",), "polled modbus wrench"),
    ("deaf: waits for ever", "lost sync", ("dropped", "requests lost", "reset", "hang"),
     "polled modbus can gauges udp"),
    ("dies: an exception that nobody catches", "died", ("dropped", "burst", "exception", "error frames"),
     "stream polled modbus can udp"),
    ("diesshort: a short datagram kills it", "died", ("cut",), "udp"),
    ("short: short frames are filled up", "wrong", ("cut", "short"), "modbus can udp"),
    ("blocks: no word while nothing comes", "blocks", ("hang", "silence"), "stream can udp"),
    ("spins: a whole core while nothing comes", "spins", ("hang", "silence"), "can udp"),
    ("late: a late answer is taken for the next", "lost sync|stale", ("late answer",), "polled"),
    ("anyreply: answers to other commands are readings", "wrong", ("another answer",), "polled"),
    ("unit: answers of other units are readings", "wrong", ("unit",), "modbus"),
    ("exception: the last reading for an exception", "stale", ("exception",), "modbus"),
    ("transaction: answers to other transactions", "wrong", ("transaction", "late answer"), "tcp"),
    ("mixed: any sixteen frames are a scan", "wrong", ("dropped", "doubled", "busy bus"), "can"),
    ("oldrow: rows of an earlier scan", "wrong", ("dropped",), "can"),
    ("foreign: frames of others are taxels", "wrong", ("foreign frames",), "can"),
]  # fmt: skip


@dataclass(frozen=True)
class Row:
    """A mistake in a driver."""

    driver: str
    variant: str
    about: str
    kinds: tuple[str, ...]
    trials: tuple[str, ...]

    @property
    def name(self) -> str:
        """The driver and the mistake."""
        return f"{self.driver} {self.variant}"

    def is_chosen(self, words: Sequence[str]) -> bool:
        """Return True if every word is the line, driver, mistake or an expected kind."""
        mine = {DRIVERS[self.driver].line, self.driver, self.variant, *self.kinds}
        return all(word in mine for word in words)


def rows(words: Sequence[str] = ()) -> list[Row]:
    """Return the rows that the words choose, those of one driver together."""
    every = [
        Row(driver, variant, about, tuple(kinds.split("|")), tuple(trials))
        for text, kinds, trials, drivers in MISTAKES
        for variant, about in [text.split(": ")]
        for driver in drivers.split()
    ]
    places = list(DRIVERS)
    return sorted((row for row in every if row.is_chosen(words)), key=lambda row: places.index(row.driver))


# -- one judge ---------------------------------------------------------------------------------------------------------


CONTEXT = multiprocessing.get_context("forkserver")
CONTEXT.set_forkserver_preload(["tactemu.cli", "tactemu.cli.judge_output", "tactemu.judge.trial_runner"])


def judge_words(driver: Driver, variant: str, report: Path, *more: str) -> list[str]:
    """Return the command line of the judge, with the program's name left out."""
    port = [f"--port={driver.port}"] if driver.port else []
    options = [f"--json={report}", *port, *more]
    return ["judge", driver.device, *driver.options, *options, "--", *driver.command(variant)]


def run_judge(words: Sequence[str], stderr: str) -> None:
    """Run the command line in this process, with stderr in a file."""
    file = os.open(stderr, os.O_WRONLY | os.O_CREAT)
    for number, of in ((0, os.open(os.devnull, os.O_RDONLY)), (1, os.open(os.devnull, os.O_WRONLY)), (2, file)):
        os.dup2(of, number)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.argv = ["tactemu", *words]
    cli.main()


def run(words: Sequence[str], timeout_s: float) -> str:
    """Run a judge; return the end of what it writes on stderr. An interrupt ends the judge, too."""
    with tempfile.NamedTemporaryFile("r") as stderr:
        process = CONTEXT.Process(target=run_judge, args=(words, stderr.name))
        process.start()
        try:
            process.join(timeout_s)
            late = process.is_alive()
        finally:
            stop(process)
        last = "\n".join(stderr.read().splitlines()[-12:])
        return f"takes longer than {timeout_s:g} s\n{last}" if late else last


def stop(process: BaseProcess) -> None:
    """End a judge as its user would, and by force if it does not end."""
    for number in (signal.SIGINT, signal.SIGKILL):
        if process.is_alive() and process.pid:
            os.kill(process.pid, number)
            process.join(STOP_TIMEOUT_S)


@dataclass(frozen=True)
class Result:
    """The findings of one judge."""

    row: Row
    found: tuple[tuple[str, str], ...]
    """Kind and trial of each finding that came again."""
    about: str
    """The verdicts of the trials, or the end of the judge's output."""
    seconds: float

    @property
    def is_named(self) -> bool:
        """True if a finding is of the expected kind."""
        return any(kind in self.row.kinds for kind, _ in self.found)

    @property
    def got(self) -> str:
        """The kinds that were found."""
        return ", ".join(dict.fromkeys(kind for kind, _ in self.found)) or "nothing"


def judge_record(row: Row, more: Sequence[str] = ()) -> Result:
    """Judge the driver of a row."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        only = [f"--only={trial}" for trial in row.trials]
        words = judge_words(DRIVERS[row.driver], row.variant, report, "--fail-on=all", "--rest=0.3", *only, *more)
        last = run(words, ROW_TIMEOUT_S)
        trials = json.loads(report.read_text())["trials"] if report.exists() else []
    found = [
        (finding["kind"], trial["name"])
        for trial in trials
        if trial["confirmed"] is not False
        for finding in trial["findings"]
    ]
    verdicts = "; ".join(f"{trial['name']}: {trial['verdict']}" for trial in trials)
    return Result(row, tuple(found), verdicts or last or "no report", time.monotonic() - began)


def end_on_signals() -> None:
    """Make SIGTERM end the program as Ctrl-C does, also if the shell has told it to ignore Ctrl-C."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)


# -- the command -------------------------------------------------------------------------------------------------------


def results(chosen: Sequence[Row], more: Sequence[str]) -> Iterator[Result]:
    """Judge one row after the other, and print each as it comes."""
    print(f"{'':>7} {'driver, mistake':30} {'expected':18} {'got':30} named")
    for number, row in enumerate(chosen, 1):
        if sys.stderr.isatty():
            print(f"{number:3}/{len(chosen):3} {row.name} ...", end="\r", file=sys.stderr, flush=True)
        result = judge_record(row, more)
        named = "yes" if result.is_named else "NO"
        words = f"{row.name:30} {'|'.join(row.kinds):18} {result.got:30} {named:5} {result.seconds:4.0f} s"
        print(f"{number:3}/{len(chosen):3} {words}", flush=True)
        yield result


def summary(found: Sequence[Result], total: int) -> bool:
    """Print the rows that are not named, and the count; return True if enough are."""
    for result in found:
        if not result.is_named:
            expected = " or ".join(result.row.kinds)
            print(f"\n{result.row.name} ({result.row.about}): {expected} expected\n  {result.about}")
    named = sum(result.is_named for result in found)
    stopped = f"; stopped after {len(found)} of {total} rows" if len(found) < total else ""
    print(f"\n{named} of {len(found)} planted mistakes are named{stopped}")
    return named >= REQUIRED_SHARE * len(found) and len(found) == total


def main() -> int:
    """Judge the rows that the command line chooses."""
    parser = argparse.ArgumentParser(prog="python -m tests.judge.planted", description=__doc__)
    parser.add_argument("words", nargs="*", metavar="WORD", help="a line, driver, mistake or expected kind")
    parser.add_argument("--list", action="store_true", help="list the rows, and judge none")
    parser.add_argument("--seed", type=int, default=0, help="seed of the judge")
    given = parser.parse_args()
    chosen = rows(given.words)
    if not chosen:
        parser.error(f"no row is {' '.join(given.words)}; --list shows all")
    if given.list:
        for row in chosen:
            print(f"{row.name:30} {'|'.join(row.kinds):18} {', '.join(row.trials):40} {row.about}")
        print(f"{len(chosen)} rows")
        return 0
    found: list[Result] = []
    end_on_signals()
    try:
        for result in results(chosen, [f"--seed={given.seed}"]):
            found.append(result)
    except KeyboardInterrupt:
        summary(found, len(chosen))
        return 130
    return 0 if summary(found, len(chosen)) else 1


if __name__ == "__main__":
    sys.exit(main())
