"""The pytest plugin: ``tactile_device`` puts a simulated sensor on a fresh port. Imports nothing until it is used.

::

    def test_my_driver(tactile_device):
        with tactile_device("anyskin", rate_hz=100, faults=["flip 5%"], seed=7) as dev:
            driver = MyDriver(dev.port)
            dev.press(depth=1e-3, seconds=2)
            assert driver.bad_frames == dev.truth.injected["flip"]

``--tactemu-seed N`` is the seed of devices whose test names none. ``--tactemu-truth-dir DIR`` keeps the truth logs of
tests that fail, and the report of such a test names them. Both may stand in pytest's ini file, as ``tactemu_seed`` and
``tactemu_truth_dir``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import pytest

if TYPE_CHECKING:
    from tactemu.serving import Served

_LOGS = pytest.StashKey[list[Path]]()
"""Truth logs of a test that are ours to remove."""
_FAILED = pytest.StashKey[bool]()


class TactileDevice(Protocol):
    """The type of the fixture, to annotate a test with: ``tactile_device: TactileDevice``."""

    def __call__(self, target: str | Path, port: str | None = None, **options: Any) -> Served:
        """A device that runs already. Arguments are those of :func:`tactemu.serve`."""
        ...


def pytest_addoption(parser: pytest.Parser) -> None:
    """Our options, and the same as keys of the ini file."""
    group = parser.getgroup("tactemu", "simulated tactile skins")
    seed = "seed of tactile devices whose test names none"
    group.addoption("--tactemu-seed", metavar="N", default=None, help=seed)
    parser.addini("tactemu_seed", help=seed)
    folder = "folder where the truth logs of tests that fail are kept"
    group.addoption("--tactemu-truth-dir", metavar="DIR", default=None, help=folder)
    parser.addini("tactemu_truth_dir", help=folder)


def pytest_configure(config: pytest.Config) -> None:
    """Refuse a seed that is none before any test runs."""
    _seed(config)


@pytest.fixture
def tactile_device(request: pytest.FixtureRequest) -> Iterator[TactileDevice]:
    """Start devices: ``tactile_device(name_or_scene, **options)`` is :func:`tactemu.serve`, already running.

    Whatever a test leaves running is stopped after it, and an error in the background fails the test.
    """
    started: list[Served] = []
    logs = request.node.stash.setdefault(_LOGS, [])

    def start(target: str | Path, port: str | None = None, **options: Any) -> Served:
        from tactemu.serving import serve

        if "seed" not in options and (seed := _seed(request.config)) is not None:
            options["seed"] = seed
        if "truth" not in options and (folder := _setting(request.config, "tactemu_truth_dir")):
            options["truth"] = _log(Path(folder), request.node.nodeid, len(logs) + 1)
            logs.append(options["truth"])
        device = serve(target, port, **options).start()
        started.append(device)
        return device

    yield start
    try:
        for device in reversed(started):
            device.stop()
    except BaseException:
        request.node.stash[_FAILED] = True
        raise
    finally:
        if not request.node.stash.get(_FAILED, False):
            for log in logs:
                log.unlink(missing_ok=True)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[Any]:
    """Note that a test has failed, and name its truth logs in the report."""
    report = yield
    if report.failed:
        item.stash[_FAILED] = True
        kept = [str(log) for log in item.stash.get(_LOGS, []) if log.exists()]
        if kept:
            report.sections.append(("truth logs of tactile devices", "\n".join(kept)))
    return report


def _setting(config: pytest.Config, name: str) -> str | None:
    return config.getoption(f"--{name.replace('_', '-')}") or config.getini(name) or None


def _seed(config: pytest.Config) -> int | None:
    text = _setting(config, "tactemu_seed")
    if text is None:
        return None
    try:
        return int(text)
    except ValueError:
        raise pytest.UsageError(f"--tactemu-seed: expected a whole number, got {text!r}") from None


def _log(folder: Path, nodeid: str, number: int) -> Path:
    """A file for the ``number``-th device of a test, in a folder that is there."""
    folder.mkdir(parents=True, exist_ok=True)
    return folder.absolute() / f"{re.sub(r'[^A-Za-z0-9.]+', '-', nodeid)[-150:].strip('-')}-{number}.mcap"
