"""The guest's part of ``test_usb_matrix.py``: the tests of the drivers, on a USB device of each chip.

``usb_matrix_guest.py CHIP... -- TEST...`` prints a JSON object for each chip.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
REPORT = "/run/report.json"


class Results:
    """A plugin that keeps what became of each test, and how many readings it has compared."""

    def __init__(self):
        self.results = {}

    def pytest_configure(self, config):
        config.addinivalue_line("markers", "timeout: none here; a guest is slow")

    def pytest_runtest_logreport(self, report):
        if report.when == "call" or report.outcome != "passed":
            self.results[report.nodeid] = [report.outcome, str(report.longrepr)[-1500:] if report.failed else ""]
            print(report.nodeid, *self.results[report.nodeid], file=sys.stderr, flush=True)

    def pytest_sessionfinish(self):
        Path(REPORT).write_text(json.dumps(self.results))


def tested(chip: str, tests: list[str]) -> dict:
    import pytest

    os.environ["TACTEMU_RIG_CHIP"] = chip
    os.chdir(ROOT)
    pytest.main(
        ["-p", "no:cacheprovider", "-p", "no:timeout", "-q", "--judges", "all", "--devices", "all", *tests],
        plugins=[Results()],
    )
    return json.loads(Path(REPORT).read_text())


if __name__ == "__main__":
    cut = sys.argv.index("--")
    chips, tests = sys.argv[1:cut], sys.argv[cut + 1 :]
    if len(chips) == 1:
        tested(chips[0], tests)
    for chip in chips if len(chips) > 1 else ():
        Path(REPORT).unlink(missing_ok=True)
        one = [sys.executable, "-m", "tests.transports.usb_matrix_guest", chip, "--", *tests]
        subprocess.run(one, cwd=ROOT, stdout=sys.stderr, check=False)
        print(json.dumps({"chip": chip, "results": json.loads(Path(REPORT).read_text())}), flush=True)
