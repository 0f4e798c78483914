"""Which judges are run, and what they found. A test in which somebody else's program reads a device says so::

    @pytest.mark.judge("ability_hand", driver="ability-hand", carrier="serial, PPP", every_run=True)

``driver`` is its distribution, in ``environment`` if it needs one of its own; devices, driver and environment may be
names of the test's parameters.

A run of all tests has the judges that stand for a carrier and framing (``every_run``), and those a change concerns:
the device's file has changed, or one beside it that it imports, or the test and scripts that it names. Changed is what
differs from the commit where this branch left main; on main, from the commit before the last. Who names a file, a word
(``-k``) or a mark (``-m``) gets all that is in it, and ``scripts/judges`` runs the rest.

A test of every device that takes long, parametrized by its ``name``, is marked ``each_device``: a run of all tests has
it for one device on each kind of line, and for those whose files have changed; ``--devices all`` has it for all.
"""

from __future__ import annotations

import functools
import importlib.metadata
import json
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

import firmware_protocols as fp
from firmware_protocols.registry import DEVICES
from tests.drivers import rig
from tests.drivers.environments import locked

ROOT = Path(__file__).parents[1]
MAINS = ("origin/main", "main")


@dataclass(frozen=True)
class Judge:
    """The mark of one test, with its parameters filled in."""

    devices: tuple[str, ...]
    driver: str
    carrier: str
    environment: str = ""
    every_run: bool = False


def judge_of(item: pytest.Item) -> Judge | None:
    """What the test is marked with."""
    mark = item.get_closest_marker("judge")
    if mark is None:
        return None
    given = item.callspec.params if isinstance(item, pytest.Function) and hasattr(item, "callspec") else {}
    filled = {key: given.get(value, value) for key, value in mark.kwargs.items()}
    judge = Judge(devices=tuple(given.get(name, name) for name in mark.args), **filled)
    if unknown := set(judge.devices) - set(DEVICES):
        raise pytest.UsageError(f"{item.nodeid}: judges {', '.join(unknown)}, which is no device")
    return judge


# -- which are run -----------------------------------------------------------------------------------------------------


def git(*words: str) -> list[str]:
    """Lines of what git says; none where it fails or is missing."""
    try:
        return subprocess.run(
            ["git", *words], cwd=ROOT, check=True, capture_output=True, text=True, timeout=60
        ).stdout.splitlines()
    except (OSError, subprocess.SubprocessError):
        return []


@functools.cache
def changed_files() -> frozenset[str]:
    """Paths from the root; empty where no history is at hand."""
    head = git("rev-parse", "HEAD")
    for main in MAINS:
        base = git("merge-base", "HEAD", main)
        if base and base != head:
            break
    else:
        base = git("rev-parse", "HEAD~1")
    if not base:
        return frozenset()
    return frozenset(git("diff", "--name-only", base[0]) + git("ls-files", "--others", "--exclude-standard"))


@functools.cache
def files_of(device: str) -> frozenset[str]:
    """The file of a device, and those beside it that it imports."""
    module = DEVICES[device].partition(":")[0]
    path = module.replace(".", "/") + ".py"
    folder = module.rpartition(".")[0]
    beside = re.findall(rf"{re.escape(folder)}\.(\w+)", (ROOT / path).read_text())
    return frozenset({path, *(f"{folder.replace('.', '/')}/{name}.py" for name in beside)})


def concerns(changed: frozenset[str], judge: Judge, test: Path) -> bool:
    """Whether a change is one for a judge in the file ``test``."""
    ours = frozenset[str]().union(*map(files_of, judge.devices))
    scripts = {Path(path).name for path in changed if path.startswith("tests/drivers/")}
    named = any(f'"{name}"' in test.read_text() for name in scripts)
    return named or not changed.isdisjoint(ours | {str(test.relative_to(ROOT))})


def is_run(judge: Judge, test: Path, wanted: str) -> bool:
    """``wanted`` is ``all``, ``changed``, or devices by name."""
    if wanted == "changed":
        return judge.every_run or concerns(changed_files(), judge, test)
    return wanted == "all" or not set(wanted.split(",")).isdisjoint(judge.devices)


def device_of(item: pytest.Item) -> str:
    """Of a test of every device, the one that it is about."""
    assert isinstance(item, pytest.Function)
    return item.callspec.params["name"]


@functools.cache
def ports_of(device: str) -> tuple[type, ...]:
    """The kinds of its ports; devices are made for it once, as some take 10 ms."""
    return tuple(map(type, fp.create(device).ports))


@functools.cache
def standing() -> frozenset[str]:
    """One device, the first, on each kind of line."""
    first: dict[tuple[type, ...], str] = {}
    for name in fp.names():
        first.setdefault(ports_of(name), name)
    return frozenset(first.values())


def is_tried(device: str, test: Path) -> bool:
    """Whether a test of every device is run for this one when nobody asks."""
    changed = changed_files()
    return device in standing() or not changed.isdisjoint(files_of(device) | {str(test.relative_to(ROOT))})


def named_files(config: pytest.Config) -> set[Path]:
    """Those that the command line names."""
    return {path for word in config.args if (path := Path(str(word).partition("::")[0]).resolve()).is_file()}


def deselect(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out the judges that are not run."""
    wanted = config.getoption("--judges")
    if wanted == "changed" and (config.option.keyword or config.option.markexpr):
        return
    named = named_files(config) if wanted == "changed" else set()
    judges = {item: judge for item in items if (judge := judge_of(item))}
    left_out = [
        item for item, judge in judges.items() if item.path not in named and not is_run(judge, item.path, wanted)
    ]
    if config.getoption("--devices") == "changed":
        each = [item for item in items if item.get_closest_marker("each_device") and item.path not in named]
        left_out += [item for item in each if not is_tried(device_of(item), item.path)]
    if left_out:
        items[:] = [item for item in items if item not in set(left_out)]
        config.hook.pytest_deselected(items=left_out)


def rule(config: pytest.Config) -> str:
    """What was left out and why, in a line; empty where nothing was."""
    if config.getoption("--judges") != "changed" or config.option.keyword or config.option.markexpr:
        return ""
    devices = sorted(name for name in DEVICES if files_of(name) & changed_files())
    return (
        "judges: one for each carrier and framing, and those whose test or device has changed"
        f" ({', '.join(devices) or 'no device has'}); the others are deselected: scripts/judges --all, --devices all"
    )


# -- what they found ---------------------------------------------------------------------------------------------------


def version_of(driver: str, environment: str = "") -> str:
    """With its version, if it is a package."""
    if environment:
        return f"{driver} {locked(environment)[driver]}"
    try:
        package = importlib.metadata.distribution(driver)
        return f"{package.metadata['Name']} {package.version}"
    except importlib.metadata.PackageNotFoundError:
        return driver


def verdict(judge: Judge, report: pytest.TestReport) -> dict[str, Any]:
    """Of one test, for the table."""
    return {
        "test": report.nodeid,
        "devices": judge.devices,
        "driver": version_of(judge.driver, judge.environment),
        "carrier": judge.carrier,
        "readings": max(rig.EQUAL, default=0),
        "outcome": report.outcome,
    }


class Verdicts:
    """A plugin that writes a line of JSON for each judge that was run."""

    def __init__(self, file: Path):
        self.file = file

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """In the process that hears of all tests."""
        for name, found in report.user_properties:
            if name == "judge":
                with self.file.open("a") as file:
                    print(json.dumps(found), file=file)
