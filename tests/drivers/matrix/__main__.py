"""``python -m tests.drivers.matrix``: every driver against every fault, and the page that says what came of it."""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

from tests.drivers.matrix.bout import Outcome, Ring
from tests.drivers.matrix.drivers import DRIVERS
from tests.drivers.matrix.page import page
from tests.drivers.matrix.trials import TRIALS

PAGE = Path("docs/drivers-under-faults.md")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.drivers.matrix", description=__doc__)
    parser.add_argument("--driver", action="append", choices=DRIVERS, help="only this one; repeatable")
    parser.add_argument("--fault", action="append", choices=TRIALS, help="only this one; repeatable")
    parser.add_argument("--results", type=Path, default=Path("build/matrix.json"), help="added to, then read")
    parser.add_argument("--page", type=Path, help=f"write the page from all results, such as {PAGE}")
    parser.add_argument("--no-run", action="store_true", help="only write the page")
    options = parser.parse_args()
    results = _load(options.results)
    if not options.no_run:
        for name in options.driver or DRIVERS:
            results |= _run(name, options.fault or list(TRIALS))
            _save(results, options.results)
    if options.page:
        options.page.write_text(page(results), encoding="utf-8")


def _run(name: str, labels: list[str]) -> dict[tuple[str, str], Outcome]:
    driver = DRIVERS[name]
    if not driver.installed:
        print(f"{name}: {driver.package} is not installed", file=sys.stderr)
        return {}
    results: dict[tuple[str, str], Outcome] = {}
    with tempfile.TemporaryDirectory() as folder, Ring(name, driver, Path(folder)) as ring:
        for label in labels:
            if TRIALS[label].fits(driver):
                results[name, label] = outcome = ring.bout(label, TRIALS[label].against(driver))
                print(outcome, flush=True)
    return results


def _load(path: Path) -> dict[tuple[str, str], Outcome]:
    if not path.exists():
        return {}
    outcomes = [Outcome(**entry) for entry in json.loads(path.read_text())]
    return {(outcome.driver, outcome.fault): outcome for outcome in outcomes}


def _save(results: dict[tuple[str, str], Outcome], path: Path) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps([vars(outcome) for outcome in results.values()], indent=1))


if __name__ == "__main__":
    main()
