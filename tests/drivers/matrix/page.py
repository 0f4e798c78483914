"""The page that users read: how each driver copes with each fault, from the outcomes of a run."""

from __future__ import annotations

import platform
from collections.abc import Iterable, Mapping
from textwrap import fill

from tests.drivers.matrix.bout import Outcome
from tests.drivers.matrix.drivers import DRIVERS, Driver
from tests.drivers.matrix.trials import TRIALS

Results = Mapping[tuple[str, str], Outcome]

LONG_GAP_S = 0.75
"""A silence that is not the fault's own half second."""

INTRO = """\
# Drivers under faults

How the published drivers of tactile skins cope with what goes wrong on a wire. Each driver is unmodified, runs in a
process of its own and reads a simulated skin whose every sample is known, so that each reading it hands out is *right*
(number for number one of the samples) or is not. Faults are switched on in the middle of a stream and off again.

This page is written by the run that it describes; nothing in the tables was entered by hand:

```sh
python -m tests.drivers.matrix --page docs/drivers-under-faults.md      # all of it, about ten minutes
python -m tests.drivers.matrix --driver optoforce --fault flip          # one of it
```

Run on {machine}. Faults of frames hit 10 % of them for 1.5 s, at random but by seed
(`plusml-rh56dftp`: {plusml}; `linkerbot`: {linkerbot}, because sixty frames make a reading). The
reader around each driver reopens the port when the driver says that it is gone, and does nothing else.
`tests/drivers/test_under_faults.py` holds the drivers to the rows that are exact.

## At a glance

* **stops**: no right reading within {patience:.0f} s of the end of the fault, until the program is restarted
* **wrong**: hands out readings that the skin never sent, without a word
* **error**: raises, or marks the reading as bad; every reading it does hand out as good is right
* **mixes**: right readings, but old ones again or out of order, as if they were new
* **loses**: samples are missing, or nothing comes for more than {gap} s; the driver does not say so
* **ok**: every sample arrives

"""

SPEED = """
## At the wrong speed

On a UART the driver's baud rate must be the device's; on USB, TCP and CAN nothing depends on it. At half the rate
(`ability-hand`: twice) bytes come out as noise, both ways. `ability-hand`, `pymodbus` and `modbus_tk` hand out nothing;
`flexitac` nothing right, but noise that holds `AA 55` is an image to it. At the right rate again, all of them read
everything (`tests/drivers/test_baud_and_plug.py`).
"""

LEGEND = """\
Columns: faults *injected*; *readings* handed out from the start of the fault until the driver was well again; of these
*wrong* and silent about it, *marked* bad by the driver, *again* the sample before, *older* than the sample before;
samples *lost* (of streams, or by the driver's own count); exceptions; the longest time without a right reading; and
when, after the end of the fault, ten right readings in a row began. A busy machine adds some hundredths of a second.
"""


def page(results: Results) -> str:
    """The whole page. Cells of pairs that were not run stay empty."""
    names = [name for name in DRIVERS if any(name == driver for driver, _ in results)]
    machine = f"{platform.system()} {platform.machine()}, Python {platform.python_version()}"
    shares = {name.partition("-")[0]: _share(DRIVERS[name]) for name in ("plusml-rh56dftp", "linkerbot")}
    parts = [
        INTRO.format(machine=machine, patience=Driver.patience_s, gap=LONG_GAP_S, **shares),
        _glance(results, names),
        SPEED + "\n## Driver by driver\n\n" + LEGEND,
    ]
    return "".join([*parts, *(_driver(name, results) for name in names)])


def _share(driver: Driver) -> str:
    return f"{driver.share.removesuffix('%')} % for {driver.seconds:g} s"


def verdict(outcome: Outcome, driver: Driver) -> str:
    """The worst that happened, in one word."""
    if not outcome.injected and outcome.fault != "none":
        return "not hit"
    if outcome.recovered is None:
        return "**stops**"
    if outcome.wrong:
        return "**wrong**"
    if outcome.errors or outcome.refused:
        return "error"
    if outcome.older or (outcome.again and driver.judge_again):
        return "mixes"
    if outcome.lost or outcome.gap > LONG_GAP_S:
        return "loses"
    return "ok"


def _glance(results: Results, names: list[str]) -> str:
    rows = [[f"`{label}`", *(_cell(results.get((name, label)), DRIVERS[name]) for name in names)] for label in TRIALS]
    return _table(["fault", *names], rows)


def _cell(outcome: Outcome | None, driver: Driver) -> str:
    return verdict(outcome, driver) if outcome else ""


def _driver(name: str, results: Results) -> str:
    driver = DRIVERS[name]
    rows = [_row(label, results[name, label], driver) for label in TRIALS if (name, label) in results]
    head = ["fault", "injected", "readings", "wrong", "marked", "again", "older", "lost", "raises", "gap", "well after"]
    notes = "".join(
        fill(f"* {note}", 120, subsequent_indent="  ", break_on_hyphens=False) + "\n" for note in driver.notes
    )
    stuck = [results[name, label] for label in TRIALS if (name, label) in results and results[name, label].stuck]
    where = "".join(
        f"\nAfter `{each.fault}` it is in {_inner(each.stuck)}; a new process "
        f"{'reads again' if each.restart_helps else 'does not read either'}.\n"
        for each in stuck
    )
    return f"\n### {name} {driver.version} on `{driver.device}`\n\n{notes}\n{_table(head, rows)}{where}"


def _inner(stuck: str) -> str:
    return " < ".join(f"`{each}`" for each in stuck.split(", ")[:4])


def _row(label: str, outcome: Outcome, driver: Driver) -> list[str]:
    logged = outcome.counters.get("checksum failed", 0)
    errors = ", ".join(
        [
            *(f"{count} {name}" for name, count in outcome.errors.items() if count),
            *([f"{logged} checksums in its log"] if logged else []),
        ]
    )
    after = "never" if outcome.recovered is None else f"{outcome.recovered:.2f} s"
    again = outcome.again if driver.judge_again else 0
    return [
        f"`{TRIALS[label].against(driver).fault or label}`",
        *map(
            _count,
            (outcome.injected, outcome.readings, outcome.wrong, outcome.refused, again, outcome.older, outcome.lost),
        ),
        errors,
        f"{outcome.gap:.2f} s",
        after,
    ]


def _count(number: int) -> str:
    return str(number) if number else ""


def _table(head: list[str], rows: Iterable[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)
