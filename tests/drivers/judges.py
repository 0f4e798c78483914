"""``scripts/judges``: run judges, and say of every device who has read it."""

import argparse
import json
import shutil
import subprocess
import sys
from collections import defaultdict

import firmware_protocols as fp
from tests.clients.recording import FOLDER as FOLDER_OF_RECORDINGS
from tests.judging import ROOT

FOLDER = ROOT / "build" / "judges"
TRIES = 2
"""Of a judge that fails: drivers have time-outs, and a machine may be busy."""

Verdict = dict[str, str | int | list[str]]


def run(names: list[str]) -> tuple[list[Verdict], int]:
    """What the judges found, and pytest's status."""
    shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir(parents=True)
    file = FOLDER / "verdicts.jsonl"
    pytest = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--judges", ",".join(names) or "all"]
    pytest += ["--judges-to", str(file), "-m"]
    can = [str(ROOT / "scripts" / "vcan-run"), "-o", str(FOLDER), "--"]
    parts = [[*pytest, "judge and not vcan"], [*can, *pytest, "judge and vcan"]]
    statuses, verdicts = [], {}
    for part in parts:
        tests = ["tests/drivers"]
        for _ in range(TRIES):
            status = subprocess.run([*part, *tests], check=False, cwd=ROOT).returncode
            lines = file.read_text().splitlines() if file.exists() else []
            verdicts |= {verdict["test"]: verdict for verdict in map(json.loads, lines)}
            file.unlink(missing_ok=True)
            tests = [test for test, verdict in verdicts.items() if verdict["outcome"] == "failed"]
            if status != 1 or not tests:
                break
        statuses.append(status)
    return list(verdicts.values()), max((s for s in statuses if s != 5), default=0)  # 5: no test of these devices


def rows(verdicts: list[Verdict], names: list[str]) -> list[tuple[str, str, str, str, str]]:
    """Device, driver, carrier, readings, result: a line for each driver and carrier, and for each device without."""
    found = defaultdict(list)
    for verdict in verdicts:
        for device in verdict["devices"]:
            found[device, verdict["driver"], verdict["carrier"]].append(verdict)
    lines = []
    for name in names:
        of_it = sorted(key for key in found if key[0] == name)
        for key in of_it:
            outcomes = [verdict["outcome"] for verdict in found[key]]
            fewest = min((v["readings"] for v in found[key] if v["readings"]), default=0)
            lines.append((*key, readings(fewest), result(outcomes, fewest)))
        if not of_it:
            lines.append((name, fp.create(name).judge, "", "", without_test(name)))
    return lines


def without_test(name: str) -> str:
    """Of a device that no packaged driver reads: its recordings are tests of every run (``tests/clients``)."""
    return "recorded" if any(FOLDER_OF_RECORDINGS.glob(f"{name}-*.mcap")) else "not read"


def readings(count: int) -> str:
    """Whole hundreds, so that they are the same from run to run."""
    return str(count if count < 100 else count // 100 * 100) if count else ""


def result(outcomes: list[str], fewest: int) -> str:
    """Of all tests of one driver and carrier."""
    if bad := outcomes.count("failed"):
        return f"FAILED {bad} of {len(outcomes)}"
    if "passed" not in outcomes:
        return "NOT RUN"
    return "equal" if fewest else "passed, not counted"


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(prog="scripts/judges", description=__doc__)
    parser.add_argument("device", nargs="*", help="only the judges of these devices")
    parser.add_argument("--all", action="store_true", help="every judge of every device")
    given = parser.parse_args()
    if bool(given.device) == given.all:
        parser.error("name devices, or --all")
    if unknown := set(given.device) - set(fp.DEVICES):
        parser.error(f"no such device: {', '.join(sorted(unknown))}")
    verdicts, status = run(given.device)
    lines = rows(verdicts, sorted(given.device or fp.DEVICES))
    table = ["| device | read by | carrier | readings | result |", "| --- | --- | --- | --- | --- |"]
    table += [f"| `{name}` | {' | '.join(rest)} |" for name, *rest in lines]
    print("\n".join(table))
    return 1 if status or any(line[-1].isupper() or line[-1].startswith("FAILED") for line in lines) else 0


if __name__ == "__main__":
    sys.exit(main())
